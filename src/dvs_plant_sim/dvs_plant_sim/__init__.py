"""Exact simulation of a linear plant seen by an array of pixels, as a ROS 2 node."""
