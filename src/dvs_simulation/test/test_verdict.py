"""The figures of a verdict against runs whose figures are known by construction."""

import dataclasses
import json
import math
import warnings

import numpy as np
import pytest
from recorded_messages import recorded
from verdict_cases import promised_of

from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_common.scenario.scenario import Scenario
from dvs_hinf_controller.analysis.budget import Budget
from dvs_hinf_controller.state_space import StateSpace
from dvs_simulation.judging.trace import decode_trace
from dvs_simulation.judging.verdict import Verdict, judge, sector_ratios

H = 0.15
SCENARIO = Scenario.from_values(
    {
        'event_threshold': H,
        'reference_lower': [1.0],
        'reference_upper': [1.2],
        'set_point': [0.5, -0.2],
        'tolerance': 0.05,
    }
)
# Lemma 4 with m = 1, M = 1.2.
RHO = math.exp(-H)
Y = np.array([2.0, 3.0, 4.0])
BOUND = (1.2 - RHO**2) / (1.2 + RHO**2)

PROMISED = promised_of(SCENARIO, h_star=0.2, h_certified=0.05, delta_certified=0.3, pole=-20.0)
# h ln b + w and atanh(delta_certified) of SCENARIO and PROMISED.
USED, ALLOWED = H + 0.5 * math.log(1.2), math.atanh(0.3)


def run(errors, *, ratios=0.0, luminosity=(2.0, 3.0, 4.0)):
    """Trace with these errors of the state, and estimates off by these shares of the bound."""
    luminosity = np.array(luminosity)
    samples = [
        ([0.5, error - 0.2], luminosity, luminosity * (1 + BOUND * np.broadcast_to(ratio, 3)))
        for error, ratio in zip(errors, per_sample(ratios, len(errors)), strict=True)
    ]
    return decode_trace(recorded(samples, events_per_sample=3))


def per_sample(ratios, count):
    return ratios if np.ndim(ratios) == 2 else np.broadcast_to(ratios, count)


def judged(trace, scenario=SCENARIO, **options):
    defaults = {'name': 'test', 'promised': PROMISED, 'wall_seconds': 2.0, 'interrupted': False}
    return judge(trace, scenario, **{**defaults, **options})


def test_the_long_run_is_the_last_third():
    # Samples 0 to 9: the last third begins with sample 6.
    errors = [9, 9, 9, 9, 9, 9, 0.04, -0.03, 0.01, 0.02]
    verdict = judged(run(errors))

    assert verdict.limsup_error == pytest.approx(0.04)
    assert verdict.final_error == pytest.approx(0.02)
    assert verdict.regulated
    errors[6] = 0.051
    assert not judged(run(errors)).regulated


def test_an_error_of_exactly_the_tolerance_is_too_much():
    assert not judged(run([0.0, 0.05])).regulated


def test_a_state_that_is_no_number_is_not_regulated():
    assert not judged(run([0.0, math.nan])).regulated


def test_ratios_are_relative_to_the_sector_of_every_pixel():
    trace = run([0.0] * 4, ratios=[0.0, 0.5, -0.9, 1.0])

    np.testing.assert_allclose(
        sector_ratios(trace, SCENARIO, np.full(3, BOUND)).reshape(4, 3),
        np.outer([0, 0.5, 0.9, 1], np.ones(3)),
    )


@pytest.mark.parametrize(('ratio', 'held'), [(1.0, True), (-1.0, True), (1.00001, False)])
def test_the_sector_bound_leaves_room_for_rounding_only(ratio, held):
    verdict = judged(run([0.0, 0.0], ratios=ratio))

    assert verdict.sector_held is held
    assert verdict.passed is held
    assert ('held' in str(verdict)) is held
    assert ('VIOLATED' in str(verdict)) is not held


def test_one_sample_outside_of_the_sector_is_enough():
    assert not judged(run([0.0] * 30, ratios=[0.5] * 17 + [1.1] + [0.5] * 12)).sector_held


def test_in_the_dead_band_nothing_is_judged():
    signed = SCENARIO.replace(photoreceptor='signed_log', dead_band=1e-4)
    trace = run([0.0, 0.0], ratios=5.0, luminosity=(0.0, 0.99e-4, -0.5e-4))

    with warnings.catch_warnings():
        warnings.simplefilter('error')
        assert judged(trace, signed).sector_ratio_max == 0
        outside = run([0.0, 0.0], ratios=5.0, luminosity=(0.0, 0.99e-4, -1.0e-4))
        assert judged(outside, signed).sector_ratio_max == pytest.approx(5.0)


def test_a_wrong_sign_is_outside_of_the_sector():
    signed = SCENARIO.replace(photoreceptor='signed_log')
    assert judged(run([0.0, 0.0], ratios=-2 / BOUND), signed).sector_ratio_max > 1


def test_counts_and_rates():
    verdict = judged(run([0.0] * 5))

    assert (verdict.cycles, verdict.pixels, verdict.events) == (5, 3, 12)
    assert verdict.events_per_pixel == 4
    assert verdict.cycles_per_second == 2.0
    assert verdict.simulated_seconds == pytest.approx(4e-3)
    assert judged(run([0.0]), wall_seconds=0.0).cycles_per_second == 0


def test_skipped_samples_are_counted():
    messages = recorded([([0.5, -0.2], [2.0] * 3, [2.0] * 3)] * 10)
    late = {topic: [*stream[:4], *stream[7:]] for topic, stream in messages.items()}

    verdict = judged(decode_trace(late))

    assert (verdict.cycles, verdict.samples_skipped) == (7, 3)
    assert '3 samples skipped' in str(verdict)
    assert 'skipped' not in str(judged(decode_trace(messages)))


def test_the_bound_is_that_of_the_widest_sector():
    bounds = ReferenceBounds(lower=np.array([1.0, 1.0, 1.0]), upper=np.array([1.0, 1.2, 1.1]))

    assert judged(run([0.0]), bounds=bounds).delta_z == pytest.approx(BOUND)


def test_the_file_has_every_figure(tmp_path):
    verdict = judged(run([0.0, 0.01]), interrupted=True)
    verdict.save(tmp_path / 'result.json')

    saved = json.loads((tmp_path / 'result.json').read_text())

    assert Verdict(**saved) == verdict
    assert saved['interrupted'] is True
    assert (saved['h'], saved['h_star'], saved['tolerance']) == (H, 0.2, 0.05)
    assert '(interrupted)' in str(verdict)


def settling(errors, pole):
    """Run of 3 ms a sample, of a loop whose start decays with this pole."""
    return judged(run(errors), promised=promised_of(SCENARIO, pole=pole))


def test_a_run_that_was_too_short_did_not_settle_yet():
    early, late = (settling([0.3, 0.3, 0.29], pole) for pole in (-0.14, -1e6))

    assert early.settling and not early.regulated
    assert 'did not settle yet: slowest pole -0.14 1/s, duration' in str(early)
    assert not late.settling
    assert 'NOT regulated: left eps' in str(late)


def test_an_error_for_which_the_start_does_not_account_has_left_eps():
    assert settling([0.3, 0.6, 0.64], -0.14).settling
    assert not settling([0.3, 0.6, 0.66], -0.14).settling


def test_the_transient_is_that_of_the_loop_and_not_of_its_slowest_pole_alone():
    """Ten times the start, on the way: an error that a triple pole alone would not leave."""
    loop = promised_of(SCENARIO).loop
    steep = StateSpace(a=np.array([[-1.0, 60.0], [0.0, -1.0]]), b=loop.b, c=loop.c, d=loop.d)
    promised = dataclasses.replace(PROMISED, loop=steep)

    assert promised.transient(np.array([0.0, 0.1]), 0.0, 9.0) == pytest.approx(
        6.0 / math.e, rel=1e-3
    )
    assert promised.transient(np.array([0.1, 0.0]), 2.0, 9.0) == pytest.approx(
        0.1 * math.exp(-2), rel=1e-6
    )


@pytest.mark.parametrize(
    ('h_certified', 'word'), [(0.05, '(nothing promised)'), (math.inf, 'any (promised)')]
)
def test_the_verdict_names_whether_the_promise_stood(h_certified, word):
    promised = dataclasses.replace(PROMISED, h_certified=h_certified)
    verdict = judged(run([0.0, 0.01]), promised=promised)

    assert verdict.certified == (h_certified > H)
    assert word in str(verdict)


def test_of_a_plant_of_its_own_nothing_but_the_model_is_promised():
    promised = dataclasses.replace(PROMISED, h_certified=math.inf)
    scenario = SCENARIO.replace(plant_executable='./reactor.py')

    verdict = judged(run([0.0, 0.01]), scenario, promised=promised)

    assert not verdict.linear_plant
    assert 'any (promised for the linear model)' in str(verdict)
    unpromised = judged(run([0.0, 0.01]), scenario)
    assert unpromised.promise == 'nothing promised'


def budget(**changes):
    start = Budget(threshold=H, ignorance=USED - H, delta_certified=0.3)
    return dataclasses.replace(start, **changes)


def certified_run(*reported, scenario=SCENARIO, **options):
    promised = dataclasses.replace(PROMISED, h_certified=1.0)
    trace = run([0.0, 0.0], **options)
    return judged(trace, scenario, promised=promised, reported=reported)


def test_the_budget_of_a_verdict_is_that_of_the_start_where_nothing_was_reported():
    verdict = certified_run()

    assert verdict.budget_used == pytest.approx(USED)
    assert verdict.budget_allowed == pytest.approx(ALLOWED)
    assert verdict.certified
    assert verdict.certificate.startswith('certified now')
    assert verdict.certificate in str(verdict)


def test_the_worst_report_of_a_run_decides_on_its_certificate():
    verdict = certified_run(budget(), budget(ignorance=0.2), budget(ignorance=0.01))

    assert verdict.budget_used == pytest.approx(H + 0.2)
    assert not verdict.certified
    assert verdict.certificate.startswith('not certified: h ln b + max w')


def test_a_run_with_unknown_pixels_was_not_certified():
    verdict = certified_run(budget(unknown_pixels=3), budget(ignorance=0.2))

    assert not verdict.certified
    assert verdict.certificate == 'not certified: 3 pixels unknown'


def test_the_sector_of_an_ideal_sensor_does_not_grow_with_what_was_reported():
    assert not certified_run(budget(ignorance=0.3), ratios=1.1).sector_held


def test_the_sector_of_a_sensor_in_error_is_that_of_its_worst_report():
    leaky = SCENARIO.replace(leak_uncertainty=0.1)

    assert certified_run(budget(ignorance=0.3), scenario=leaky, ratios=1.1).sector_held
    assert not certified_run(scenario=leaky, ratios=1.1).sector_held


@pytest.mark.parametrize(
    ('reported', 'stood'),
    [((), False), ((budget(),), True), ((budget(), budget(ignorance=0.2)), False)],
)
def test_of_a_sensor_in_error_what_was_known_all_along_may_stand_for_h_certified(reported, stood):
    leaky = SCENARIO.replace(leak_uncertainty=0.1)
    promised = dataclasses.replace(PROMISED, h_certified=-math.inf)
    trace = run([0.0, 0.0])

    assert judged(trace, leaky, promised=promised, reported=reported).certified == stood
    assert not judged(trace, promised=promised, reported=reported).certified


def test_a_masked_pixel_is_not_judged():
    masked = SCENARIO.replace(pixel_mask=(1,))
    ratios = [[0.0, 5.0, 0.0], [0.0, 0.0, 0.0]]

    def worst(scenario):
        samples = [([0.5, -0.2], Y, Y * (1 + BOUND * np.array(row))) for row in ratios]
        return judged(decode_trace(recorded(samples, events_per_sample=3)), scenario)

    assert not worst(SCENARIO).sector_held
    assert worst(masked).sector_held
    assert worst(masked).delta_z == pytest.approx(BOUND)


def test_a_smaller_allowance_ends_the_certificate_as_a_larger_use_does():
    # The pixels that were left promise less than those of the start.
    verdict = certified_run(budget(), budget(delta_certified=0.2, masked_pixels=(1,)))

    assert verdict.budget_allowed == math.atanh(0.2)
    assert not verdict.certified
    assert certified_run(budget(delta_certified=0.35, masked_pixels=(1,))).certified


def test_a_pixel_that_was_masked_for_a_while_does_not_count_for_the_sector():
    off = [0.0, 1.5, 0.0]
    trace = run([0.0, 0.0], ratios=[off, off])

    assert not judged(trace).sector_held
    masked = judged(trace, reported=[budget(masked_pixels=(1, 7)), budget()])
    assert masked.sector_held
    assert masked.pixels_masked == 1
    assert '3 pixels, 1 of them masked' in str(masked)
    given = judged(trace, SCENARIO.replace(pixel_mask=(1,)))
    assert given.sector_held
    assert given.pixels_masked == 1


def test_a_given_mask_leaves_the_budget_of_the_start():
    poor = ReferenceBounds(lower=np.array([1.0, 0.1, 1.0]), upper=np.full(3, 1.2))

    assert judged(run([0.0, 0.0]), bounds=poor).budget_used > 2 * USED
    masked = judged(run([0.0, 0.0]), SCENARIO.replace(pixel_mask=(1,)), bounds=poor)
    assert masked.budget_used == pytest.approx(USED)


@pytest.mark.parametrize('h_star', [math.inf, -math.inf, 0.2])
def test_the_file_of_a_run_is_json_whatever_was_promised(h_star, tmp_path):
    promised = dataclasses.replace(PROMISED, h_star=h_star, h_certified=h_star)
    judged(run([0.0, math.nan]), promised=promised).save(tmp_path / 'result.json')

    def none(token):
        raise AssertionError(token)

    saved = json.loads((tmp_path / 'result.json').read_text(), parse_constant=none)
    expected = {math.inf: None, -math.inf: 0.0}.get(h_star, h_star)
    assert (saved['h_star'], saved['h_certified']) == (expected, expected)
    assert saved['final_error'] is None


def test_no_threshold_and_any_threshold_are_words():
    for h_certified, word in ((math.inf, 'any'), (-math.inf, 'none'), (-0.001, 'none')):
        promised = dataclasses.replace(PROMISED, h_certified=h_certified, h_star=h_certified)
        text = str(judged(run([0.0, 0.01]), promised=promised))
        assert f'h_certified = {word} (' in text
        assert f'h* = {word}\n' in text
