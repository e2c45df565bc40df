"""Executable `composed_loop`: the three nodes of the loop in one process."""

from __future__ import annotations

from dvs_event_camera.event_camera_node import EventCameraNode
from dvs_hinf_controller.hinf_controller_node import HinfControllerNode
from dvs_interfaces.spin import run_nodes
from dvs_plant_sim.plant_sim_node import PlantSimNode


def main() -> int:
    """Run the three nodes until the plant's run ends or a signal comes."""
    return run_nodes([EventCameraNode, HinfControllerNode, PlantSimNode])
