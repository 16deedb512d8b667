"""A node of ROS 2, without ROS: DDS in a process of its own."""
