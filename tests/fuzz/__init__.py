"""Fuzzing of everything that reads what others wrote: frames, recordings, missions. `python -m tests.fuzz`."""
