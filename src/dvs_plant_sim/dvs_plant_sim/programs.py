"""Executables of the package, which import nothing before signals are handled."""

from __future__ import annotations

from dvs_common.program import run_program


def plant_sim() -> int:
    """Run the node `plant_sim`."""
    return run_program('dvs_plant_sim.plant_sim_node')


def pendulum_sim() -> int:
    """Run the node `pendulum_sim`."""
    return run_program('dvs_plant_sim.pendulum_sim_node')
