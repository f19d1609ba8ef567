"""Starts nunetd as a node of ROS 2."""
