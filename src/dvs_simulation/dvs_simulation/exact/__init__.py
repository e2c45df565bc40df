"""Exact event-driven simulation of plant, pixels, estimator and controller; no ROS inside."""

from dvs_simulation.exact.automaton import simulate
from dvs_simulation.exact.loop import ClosedLoop
from dvs_simulation.exact.trajectory import Outcome, Trajectory

__all__ = ['ClosedLoop', 'Outcome', 'Trajectory', 'simulate']
