"""Executables of the package, which import nothing before signals are handled."""

from __future__ import annotations

from dvs_common.program import run_program


def hinf_controller() -> int:
    """Run the node `hinf_controller`."""
    return run_program('dvs_hinf_controller.hinf_controller_node')


def design_controller() -> int:
    """Run the tool `design_controller`."""
    return run_program('dvs_hinf_controller.design.design_tool')
