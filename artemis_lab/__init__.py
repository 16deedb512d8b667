"""Measures artemis: faults on purpose, campaigns of many runs judged from outside, followers side by side."""
