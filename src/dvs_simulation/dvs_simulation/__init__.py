"""Simulation without ROS: exact from event to event, or sampled as the nodes do; judging; sweeps.

Examples
--------
Design a controller for a scenario, and run the closed loop exactly:

>>> from dvs_common import Scenario
>>> from dvs_hinf_controller import design_from_scenario
>>> from dvs_simulation import ClosedLoop, simulate
>>> scenario = Scenario.from_values({'event_threshold': 0.1})
>>> loop = ClosedLoop.from_scenario(scenario, design_from_scenario(scenario).controller)
>>> run = simulate(loop, duration=2.0, tail_start=1.0, compiled=False)
>>> run.outcome.status, run.event_count
('completed', 58)
>>> bool(run.tail.peak_bound < scenario.objective.tolerance)
True
"""

from __future__ import annotations

from dvs_common.lazy import lazy_exports

__getattr__, __all__ = lazy_exports(__name__, __file__)
