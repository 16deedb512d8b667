"""Built-in input devices."""
