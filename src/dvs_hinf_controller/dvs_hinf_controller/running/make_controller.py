"""The running controller of a design and a scenario."""

from __future__ import annotations

from dvs_common.scenario.scenario import Scenario
from dvs_hinf_controller.design.design import Design
from dvs_hinf_controller.running.event_controller import EventController
from dvs_hinf_controller.sensor_uncertainty import SensorUncertainty


def event_controller(design: Design, scenario: Scenario) -> EventController:
    """Controller at its start, with what the scenario holds on the sensor.

    Parameters
    ----------
    design
        What is to run.
    scenario
        Checked parameters.

    Raises
    ------
    ParameterError
        If parameters do not fit the pixel array.
    """
    chosen = scenario.uncertainty
    return EventController(
        design.problem,
        design.controller,
        event_threshold=scenario.sensor.event_threshold,
        command_limit=scenario.command_limit,
        command_rate_limit=scenario.command_rate_limit,
        uncertainty=SensorUncertainty.of_scenario(scenario),
        pixel_mask=chosen.pixel_mask,
        holds_unknown=chosen.unknown_references == 'hold',
    )
