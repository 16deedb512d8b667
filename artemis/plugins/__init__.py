"""What others may add: input devices, followers, observers."""
