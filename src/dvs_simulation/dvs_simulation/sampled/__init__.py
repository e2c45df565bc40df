"""The sampled loop of the nodes in one process, without ROS."""
