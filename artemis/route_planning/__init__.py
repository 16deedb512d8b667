"""Routes on a map, from where the robot is to a pose: hybrid A* with the robot's exact outline, zones, obstacles."""
