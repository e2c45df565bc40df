"""Simulation without ROS: exact automaton, sampled loop, judging, sweeps, the paper."""

import dvs_common as dvs_common
