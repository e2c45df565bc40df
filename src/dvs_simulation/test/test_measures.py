"""One measure of a run: the error from the equilibrium, the sector ratio, and what passes."""

import numpy as np
import pytest
from closed_loop_cases import mirror_loop
from recorded_messages import recorded
from verdict_cases import promised_of

from dvs_common.scenario.scenario import Scenario
from dvs_hinf_controller.analysis.sector import sector
from dvs_simulation.exact import simulate
from dvs_simulation.exact.signals import estimates_at, judged, luminosities, sector_ratios
from dvs_simulation.judging.measures import Judgement, error, largest, sector_ratio, settled_from
from dvs_simulation.judging.trace import decode_trace
from dvs_simulation.judging.verdict import judge

PRINTED = (-0.2321, 0.0928)
SCENARIO = Scenario.from_values({'set_point': PRINTED})


def test_the_error_counts_from_the_equilibrium_and_not_from_the_printed_set_point():
    held = SCENARIO.equilibrium

    np.testing.assert_array_equal(error(np.array([held.state]), held), [0])
    assert error(np.array(PRINTED), held) == pytest.approx(3.71e-5, rel=1e-2)
    np.testing.assert_allclose(error(held.state + [[0.3, 0.4], [0, -1]], held), [0.5, 1.0])


def test_an_exact_run_and_its_messages_are_judged_alike():
    loop = mirror_loop(3)
    times = np.arange(0, 3001) * 1e-3
    run = simulate(loop, duration=3.0, sample_times=times, tail_start=settled_from(3.0))
    y, z = luminosities(loop, run.states), estimates_at(loop, run, times)
    trace = decode_trace(recorded(list(zip(run.states, y, z, strict=True)), events_per_sample=0))
    scenario = Scenario.from_values(
        {'event_threshold': loop.event_threshold, 'set_point': [0.2321, -0.0928]}
    )
    exact = judged(loop, run, tolerance=0.05)

    verdict = judge(
        trace,
        scenario,
        name='same',
        promised=promised_of(scenario),
        wall_seconds=1.0,
        interrupted=False,
        bounds=loop.bounds,
    )

    assert verdict.limsup_error == pytest.approx(exact.limsup_error, rel=1e-3)
    assert verdict.limsup_error <= exact.limsup_error
    assert verdict.final_error == error(run.states, loop.equilibrium)[-1]
    assert verdict.sector_ratio_max == pytest.approx(exact.sector_ratio_max, rel=1e-12)
    assert (verdict.regulated, verdict.passed) == (exact.regulated, exact.passed)


def test_a_ratio_is_not_a_number_in_the_dead_band_and_infinite_at_no_light():
    y = np.array([[2.0, 0.0, 0.5, -2.0]])

    with np.errstate(all='raise'):
        inside = sector_ratio(y, 1.1 * y + 0.1, error_bound=np.full(4, 0.5), dead_band=1.0)
        outside = sector_ratio(y, 1.1 * y + 0.1, error_bound=0.5, dead_band=0.0)

    np.testing.assert_allclose(inside, [[0.3, np.nan, np.nan, 0.1]])
    np.testing.assert_allclose(outside, [[0.3, np.inf, 0.6, 0.1]])
    assert largest(inside) == pytest.approx(0.3)
    assert largest(inside[:, 1:3]) == 0


def test_an_error_of_the_tolerance_or_no_number_is_not_regulated():
    def regulates(limsup):
        return Judgement(tolerance=0.05, limsup_error=limsup, sector_ratio_max=1.0).passed

    assert regulates(0.0499)
    assert not regulates(0.05)
    assert not regulates(float('nan'))


def test_an_exact_run_never_leaves_its_sector():
    loop = mirror_loop(3)
    run = simulate(loop, duration=2.0, sample_times=np.linspace(0, 2, 500), tail_start=1.0)
    bound = sector(loop.bounds, event_threshold=loop.event_threshold, log_base=loop.log_base)

    by_hand = np.abs(estimates_at(loop, run, run.sample_time) / luminosities(loop, run.states) - 1)
    np.testing.assert_allclose(sector_ratios(loop, run), by_hand / bound.error_bound, rtol=1e-9)
