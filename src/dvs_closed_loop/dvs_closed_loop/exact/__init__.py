"""Exact event-driven simulation of plant, pixels, estimator and controller; no ROS inside."""

from dvs_closed_loop.exact.automaton import simulate
from dvs_closed_loop.exact.loop import ClosedLoop
from dvs_closed_loop.exact.trajectory import Outcome, Trajectory

__all__ = ['ClosedLoop', 'Outcome', 'Trajectory', 'simulate']
