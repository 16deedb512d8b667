"""Fits on recordings: what the geometry and the calibration of a machine truly are."""
