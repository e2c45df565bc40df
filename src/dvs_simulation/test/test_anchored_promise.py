"""Thresholds that are not h, held by absolute measurements: what is promised for them holds."""

from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from dvs_common.nanoseconds import as_nanoseconds
from dvs_common.scenario.scenario import load_scenario
from dvs_common.wire.anchor import Anchor
from dvs_event_camera.event_camera import EventCamera
from dvs_event_camera.streams.image_source import LuminosityFrame
from dvs_hinf_controller.analysis.reference_widths import ReferenceWidths
from dvs_hinf_controller.design.certification import held_from
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_hinf_controller.running.make_controller import event_controller
from dvs_hinf_controller.sensor_uncertainty import SensorUncertainty
from dvs_plant_sim.plant import Plant

CONFIG = Path(__file__).resolve().parents[3] / 'config'
MISMATCH, ANCHOR_ERROR, ANCHOR_PERIOD = 0.03, 0.01, 0.032
SCENARIO = load_scenario(CONFIG / 'mirror_r1.yaml').replace(
    sampling_period=4e-3,
    threshold_uncertainty=(MISMATCH,),
    anchor_uncertainty=ANCHOR_ERROR,
    anchor_period=ANCHOR_PERIOD,
)
SECONDS = 2.4


@dataclass(frozen=True, slots=True, kw_only=True)
class Adversary:
    """What is at the ends of its range in a run.

    Parameters
    ----------
    on
        Relative error of the ON threshold.
    off
        Relative error of the OFF threshold.
    anchor
        Relative error of an anchor of a luminosity above its set-point; below it the opposite.
    first
        Whether q(0) is m or M.
    """

    on: float
    off: float
    anchor: float
    first: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Worst:
    """Largest values over the second half of a run.

    Parameters
    ----------
    error
        ``||x - x_d||``.
    level
        ``atanh(|z - y| / y)``.
    counted
        ``h ln b + max w``, with the uncertainty of the thresholds, as the controller counts it.
    """

    error: float
    level: float
    counted: float


@pytest.fixture(scope='module')
def design():
    return design_from_scenario(SCENARIO)


@pytest.fixture(scope='module')
def promised(design):
    """The scenario at the certified threshold."""
    assert design.figures.h_certified > 0.02
    return SCENARIO.replace(event_threshold=0.999 * design.figures.h_certified)


def run(scenario, design, adversary):
    h, period_ns = scenario.sensor.event_threshold, scenario.sampling_period_ns
    camera = EventCamera.of_scenario(
        scenario.replace(
            event_threshold=h * (1 + adversary.on),
            event_threshold_off=h * (1 + adversary.off),
            initial_reference=adversary.first,
        )
    )
    plant = Plant(scenario.model, initial_state=scenario.initial_state, period_ns=period_ns)
    controller = event_controller(design, scenario)
    target = scenario.equilibrium.state
    at_set_point = scenario.scene.luminosity(scenario.model, target)
    found = []
    for stamp_ns in range(0, as_nanoseconds(SECONDS), period_ns):
        y = scenario.scene.luminosity(scenario.model, plant.state)
        exposure = camera.take(
            LuminosityFrame(stamp_ns=stamp_ns, pixels=y.reshape(1, -1), darkest=0.0)
        )
        if not stamp_ns:
            controller.take_keyframe(replace(camera.keyframe(), event_threshold=h))
        if stamp_ns % as_nanoseconds(ANCHOR_PERIOD) == 0:
            seen = y * (1 + adversary.anchor * np.sign(y - at_set_point))
            controller.take_anchor(Anchor(stamp_ns=stamp_ns, luminosity=seen))
        for packet in exposure.packets:
            controller.take(packet)
        known = controller.references.intervals
        found.append(
            (
                np.linalg.norm(plant.state - target),
                np.arctanh(np.max(np.abs(controller.estimate - y) / y)),
                known.log_thresholds + known.width,
            )
        )
        plant.advance(period_ns, controller.command)
    error, level, counted = np.max(found[len(found) // 2 :], axis=0)
    assert controller.references.anchors.contradictions == 0
    return Worst(error=error, level=level, counted=counted)


ADVERSARIES = [
    Adversary(on=on * MISMATCH, off=off * MISMATCH, anchor=anchor * ANCHOR_ERROR, first=first)
    for on, off, (anchor, first) in product((-1, 1), (-1, 1), ((-1, 'lower'), (1, 'upper')))
]


@pytest.fixture(scope='module')
def runs(promised, design):
    return [run(promised, design, adversary) for adversary in ADVERSARIES]


@pytest.mark.ensemble
def test_no_threshold_within_its_error_and_no_anchor_within_its_own_breaks_the_promise(
    runs, promised
):
    errors = [found.error for found in runs]

    assert max(errors) <= promised.objective.tolerance
    assert max(errors) > 0.15 * promised.objective.tolerance


@pytest.mark.ensemble
def test_no_interval_of_a_run_opens_farther_than_the_promise_counts_with(runs, promised, design):
    problem, h = design.problem, promised.sensor.event_threshold
    held = held_from(problem, design.controller, h)
    widths = ReferenceWidths(problem, from_start=False)
    level = widths.level(h * np.log(problem.log_base), held.log_rate)
    counted = max(found.counted for found in runs)

    assert max(found.level for found in runs) <= counted <= level
    assert counted > 0.6 * level


def opened(design, *, rate, on, off, period, late=0.0, leak=0.0):
    """Largest ``h ln b + w`` while ln y goes to and fro at a rate, and what is counted with."""
    scenario = SCENARIO.replace(
        event_threshold=0.05,
        latency_uncertainty=late,
        leak_uncertainty=leak,
        reference_uncertainty=1e-3,
    )
    h, period_ns = scenario.sensor.event_threshold, scenario.sampling_period_ns
    camera = EventCamera.of_scenario(
        scenario.replace(
            event_threshold=h * (1 + on),
            event_threshold_off=h * (1 + off),
            latency=late,
            leak_rate=leak,
        )
    )
    controller = event_controller(design, scenario)
    found = []
    for stamp_ns in range(0, as_nanoseconds(2.0), period_ns):
        # A triangle of three thresholds.
        phase = (stamp_ns * 1e-9 * rate / h + 0.05) % 6.1
        y = np.array([0.3 * np.exp(h * min(phase, 6.1 - phase))])
        exposure = camera.take(LuminosityFrame(stamp_ns=stamp_ns, pixels=y[None], darkest=0.0))
        if not stamp_ns:
            controller.take_keyframe(replace(camera.keyframe(), event_threshold=h))
        if stamp_ns % as_nanoseconds(period) == 0:
            controller.take_anchor(Anchor(stamp_ns=stamp_ns, luminosity=y * (1 - ANCHOR_ERROR)))
        for packet in exposure.packets:
            controller.take(packet)
        if stamp_ns > as_nanoseconds(0.5):
            known = controller.references.intervals
            found.append(known.log_thresholds + known.width)
    operation = replace(
        design.problem.operation,
        sensor=SensorUncertainty.of_scenario(scenario),
    )
    widths = ReferenceWidths(replace(design.problem, operation=operation), from_start=False)
    assert controller.references.anchors.contradictions == 0
    return max(found), widths.level(h, rate)


@pytest.mark.parametrize(
    ('rate', 'late', 'leak', 'least'),
    [(1.0, 0.0, 0.0, 0.65), (4.0, 0.0, 0.0, 0.8), (4.0, 0.004, 0.0, 0.55), (1.0, 0.0, 1.0, 0.7)],
)
def test_intervals_open_as_far_as_is_counted_and_no_farther(design, rate, late, leak, least):
    reached = []
    for on, off in ((-MISMATCH, -MISMATCH), (-MISMATCH, MISMATCH)):
        largest, counted = opened(
            design, rate=rate, on=on, off=off, period=ANCHOR_PERIOD, late=late, leak=leak
        )
        assert largest <= counted
        reached.append(largest / counted)

    assert max(reached) > least


def test_rarer_anchors_than_promised_open_the_intervals_farther(design):
    largest, counted = opened(design, rate=4.0, on=MISMATCH, off=MISMATCH, period=0.512)

    assert largest > counted
