"""Recordings of events: files of other tools, bags of ROS 1 and ROS 2, and what writes them."""
