"""One recording per run, and its replay."""
