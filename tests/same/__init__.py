"""One artemis against another, compiled or of another Python: `python -m tests.same` compares their recordings."""
