"""Masked pixels leave the design and its certificate, from the start and in the midst of a run."""

import dataclasses
import subprocess
import sys
import time

import numpy as np
import pytest

from dvs_common.errors import ParameterError
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_common.scenario.scenario import Scenario
from dvs_hinf_controller.design import live_certificate
from dvs_hinf_controller.design.design import (
    design_controller,
    design_from_scenario,
    load_design,
    measure,
    save_design,
)
from dvs_hinf_controller.design.live_certificate import LiveCertificate
from dvs_hinf_controller.problem import unmasked
from dvs_hinf_controller.synthesis.synthesis_error import Assumption, SynthesisError

SCENARIO = Scenario.from_values({})
PIXELS = np.array([True, False, True])


@pytest.fixture(scope='module')
def design():
    return design_from_scenario(SCENARIO)


def poor(problem):
    """The same problem, where next to nothing is known of the reference of pixel 1."""
    lower = np.where(PIXELS, problem.bounds.lower, problem.bounds.lower / 2)
    bounds = ReferenceBounds(lower=lower, upper=problem.bounds.upper)
    return dataclasses.replace(problem, bounds=bounds)


def test_a_masked_pixel_leaves_the_worst_ratio_and_the_mean(design):
    problem = poor(design.problem)
    left = problem.of_pixels(PIXELS)

    assert left.worst_reference_ratio > 1.5 * problem.worst_reference_ratio
    assert left.mean_luminosity == pytest.approx(
        design.problem.set_point_luminosity[PIXELS].mean()
    )
    found, all_of_them = (measure(p, design.controller) for p in (left, problem))
    assert found.pixels == 2
    assert found.h_star > all_of_them.h_star
    assert found.h_certified > all_of_them.h_certified


def test_a_design_by_itself_is_made_for_the_pixels_that_are_left(design):
    left = design_controller(poor(design.problem).of_pixels(PIXELS))

    assert left.figures.h_certified == pytest.approx(
        measure(design.problem.of_pixels(PIXELS), left.controller).h_certified
    )


def test_the_mask_of_a_scenario_reaches_its_design(design, tmp_path):
    masked = design_from_scenario(SCENARIO.replace(pixel_mask=(1,)))
    alone = measure(masked.problem.of_pixels(PIXELS), masked.controller)

    assert masked.problem.scene.pixel_count == 3
    assert masked.figures.pixels == 2
    assert masked.figures.delta_certified == alone.delta_certified
    save_design(masked, tmp_path / 'design.json')
    again = load_design(tmp_path / 'design.json', design.problem, masked=(1,))
    assert again.figures.delta_certified == alone.delta_certified


def test_all_pixels_are_the_problem_itself(design):
    assert design.problem.of_pixels(np.ones(3, bool)) is design.problem


@pytest.mark.parametrize('mask', [(3,), (0, 1, 2)])
def test_a_mask_beyond_the_array_or_of_all_pixels_is_refused(mask):
    with pytest.raises(ParameterError, match='pixel_mask'):
        unmasked(3, mask)
    with pytest.raises(ParameterError, match='pixel_mask'):
        design_from_scenario(SCENARIO.replace(pixel_mask=mask))


def settled(certificate, pixels):
    deadline = time.monotonic() + 60
    while (live := certificate.of(pixels)).reason == 'being worked out':
        assert time.monotonic() < deadline
        time.sleep(0.01)
    return live


def test_the_certificate_follows_the_pixels_that_are_used(design):
    certificate = LiveCertificate(design)
    everything = np.ones(3, bool)

    assert certificate.of(everything).figures is design.figures
    # Nothing is certified before it is worked out.
    assert certificate.of(PIXELS).delta_certified == 0
    expected = measure(design.problem.of_pixels(PIXELS), design.controller)
    assert settled(certificate, PIXELS).figures == expected
    assert expected.delta_certified != design.figures.delta_certified
    assert certificate.of(everything).figures is design.figures
    # Of several sets in a row the last one counts.
    certificate.of(np.array([True, True, False]))
    assert settled(certificate, PIXELS).figures == expected


def test_pixels_without_figures_are_named_where_the_certificate_is_read(design, monkeypatch):
    def none(problem, controller):
        raise SynthesisError(Assumption.CONFIRMATION, 'there are none')

    monkeypatch.setattr(live_certificate, 'measure', none)

    live = settled(LiveCertificate(design), PIXELS)

    assert isinstance(live.error, SynthesisError)
    assert live.delta_certified == 0
    shown = live.values(0.1)
    assert shown.pop('h') == 0.1
    assert set(shown.values()) == {f'none: {live.error}'}


ENDLESS = """
import threading
import numpy as np
from dvs_common.scenario.scenario import Scenario
from dvs_hinf_controller.design import live_certificate
from dvs_hinf_controller.design.design import design_from_scenario

begun = threading.Event()

def measure(problem, controller):
    begun.set()
    threading.Event().wait()

live_certificate.measure = measure
certificate = live_certificate.LiveCertificate(design_from_scenario(Scenario.from_values({})))
assert certificate.of(np.array([True, False, True])).figures is None
assert begun.wait(30)
print('the end')
"""


def test_a_process_ends_while_a_certificate_is_worked_out():
    ended = subprocess.run(
        [sys.executable, '-c', ENDLESS], capture_output=True, text=True, timeout=60
    )

    assert (ended.returncode, ended.stdout, ended.stderr) == (0, 'the end\n', '')
