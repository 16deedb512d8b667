"""Benchmarks: every budget of the project, measured. `python -m tests.bench` prints the table and never fails."""
