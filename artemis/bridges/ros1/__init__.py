"""A node of ROS 1, without ROS: XML-RPC and TCPROS."""
