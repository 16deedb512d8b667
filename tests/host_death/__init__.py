"""Hosts that die while the robot drives: `make host-death`. The drives are simulated here, in another process."""
