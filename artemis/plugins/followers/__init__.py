"""Built-in path followers."""
