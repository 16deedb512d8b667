"""The compiled artemis (`make fast`) against the plain one: `python -m tests.fast` compares their recordings."""
