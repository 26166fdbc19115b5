"""Depth cameras: a RealSense, and frames that were recorded as files or in a ROS bag."""
