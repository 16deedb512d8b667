"""Public helpers and contract suites for plug-in authors."""
