"""Exact simulation of a linear plant seen by an array of pixels, as a ROS 2 node."""

import dvs_common as dvs_common
