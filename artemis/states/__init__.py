"""Robot modes: pure, one file a mode."""
