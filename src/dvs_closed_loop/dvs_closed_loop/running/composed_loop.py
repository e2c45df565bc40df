"""Executable `composed_loop`: the three nodes of the loop in one process."""

from __future__ import annotations

import sys
from functools import partial

from rclpy.parameter import Parameter

from dvs_closed_loop.running.loop_plan import PLANT_WAITS
from dvs_common.node.spin import run_nodes
from dvs_event_camera.event_camera_node import EventCameraNode
from dvs_hinf_controller.hinf_controller_node import HinfControllerNode
from dvs_plant_sim.plant_sim_node import PlantSimNode


def main() -> int:
    """Run the three nodes until the plant's run ends or a signal comes."""
    waits = [Parameter('autostart', value=False)] if PLANT_WAITS in sys.argv[1:] else []
    plant = partial(PlantSimNode, parameter_overrides=waits)
    return run_nodes([EventCameraNode, HinfControllerNode, plant], options=[PLANT_WAITS])
