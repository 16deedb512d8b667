"""Mutation testing of the safety core: each small change of it has to fail a test. `python -m tests.mutation`."""
