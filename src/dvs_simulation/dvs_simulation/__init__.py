"""Simulation without ROS: exact automaton, sampled loop, judging, sweeps, the paper."""
