"""What is watched, and what follows from it: pure."""
