"""Kinematics, odometry, limits and paths: pure."""
