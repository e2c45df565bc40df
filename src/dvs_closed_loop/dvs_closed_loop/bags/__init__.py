"""Recorded runs: writing and reading rosbag2 folders."""
