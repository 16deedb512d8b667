"""Followers measured on courses of known shape."""
