"""Executables of the package, which import nothing before signals are handled."""

from __future__ import annotations

from dvs_common.program import run_program


def dvs_closed_loop() -> int:
    """Run the tools around the loop."""
    return run_program('dvs_closed_loop.cli')


def closed_loop() -> int:
    """Run a scenario."""
    return run_program('dvs_closed_loop.running.closed_loop')


def composed_loop() -> int:
    """Run the three nodes in one process."""
    return run_program('dvs_closed_loop.running.composed_loop')
