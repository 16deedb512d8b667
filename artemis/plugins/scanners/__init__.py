"""Scanners that come with artemis."""
