"""Executables of the package, which import nothing before signals are handled."""

from __future__ import annotations

from dvs_common.program import run_program


def dvs_simulation() -> int:
    """Run the tools that need no ROS."""
    return run_program('dvs_simulation.cli')
