"""The world on the other side of the wire."""
