"""Executables of the package, which import nothing before signals are handled."""

from __future__ import annotations

from dvs_common.program import run_program


def convert_events() -> int:
    """Run the tool `convert_events`."""
    return run_program('dvs_event_camera.tools.convert_events')


def dvs_event_camera() -> int:
    """Run the tools that need no ROS."""
    return run_program('dvs_event_camera.cli')


def event_camera() -> int:
    """Run the node `event_camera`."""
    return run_program('dvs_event_camera.event_camera_node')


def packet_bridge() -> int:
    """Run the node `packet_bridge`."""
    return run_program('dvs_event_camera.tools.packet_bridge_node')


def scene() -> int:
    """Run the node `scene`."""
    return run_program('dvs_event_camera.tools.scene_node')


def show_events() -> int:
    """Run the tool `show_events`."""
    return run_program('dvs_event_camera.tools.show_events')
