"""Where a robot with a laser scanner is on a map."""
