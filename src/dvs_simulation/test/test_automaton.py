import math

import numpy as np
import pytest
from closed_loop_cases import (
    OFFSETS,
    mirror_loop,
    paper_plant,
    single_pixel_loop,
    stiff_controller,
)

from dvs_common.errors import ParameterError
from dvs_simulation.exact import ClosedLoop, simulate
from dvs_simulation.exact.signals import counts_at, estimates_at, luminosities, sector_ratios

GRID = np.linspace(0, 2, 2001)


def assert_same_run(one, other):
    for name in ('event_time', 'event_pixel', 'event_polarity', 'event_sign', 'counts', 'states'):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


@pytest.mark.parametrize('signed', [False, True])
def test_interpreted_and_compiled_loops_give_identical_runs(signed):
    loop = mirror_loop(9, threshold=0.149, signed=signed)
    runs = [
        simulate(loop, duration=2.0, sample_times=GRID, tail_start=1.0, compiled=compiled)
        for compiled in (True, False)
    ]
    assert_same_run(*runs)
    assert runs[0].tail == runs[1].tail
    assert runs[0].event_count > 100


def test_samples_do_not_disturb_the_events():
    loop = mirror_loop(9)
    plain = simulate(loop, duration=2.0)
    sampled = simulate(loop, duration=2.0, sample_times=GRID)
    np.testing.assert_array_equal(plain.event_time, sampled.event_time)


def test_states_obey_the_plant_and_inputs_the_controller():
    loop = mirror_loop(3)
    run = simulate(loop, duration=2.0, sample_times=GRID)
    drive = estimates_at(loop, run, GRID).mean(axis=1) - loop.set_point_luminosity().mean()
    np.testing.assert_allclose(run.drive, drive, atol=1e-14)
    k = loop.controller
    feedback = run.controller_states @ k.output_matrix.T + np.outer(drive, k.feedthrough)
    np.testing.assert_allclose(run.inputs - loop.equilibrium.feedforward, feedback, atol=1e-12)
    quiet = np.diff(np.searchsorted(run.event_time, GRID)) == 0
    middle = 0.5 * (GRID[1] - GRID[0])
    slope = (run.states[1:] - run.states[:-1]) / (2 * middle)
    mean_state = 0.5 * (run.states[1:] + run.states[:-1])
    mean_input = 0.5 * (run.inputs[1:] + run.inputs[:-1])
    wanted = mean_state @ loop.model.state_matrix.T + mean_input @ loop.model.input_matrix.T
    np.testing.assert_allclose(slope[quiet], wanted[quiet], atol=2e-3)


def test_luminosity_stands_on_the_threshold_at_every_event():
    loop = mirror_loop(9)
    run = simulate(loop, duration=2.0)
    at = simulate(loop, duration=2.0, sample_times=run.event_time)
    y = luminosities(loop, at.states)[np.arange(run.event_count), run.event_pixel]
    counts, _ = counts_at(loop, run, run.event_time)
    count = counts[np.arange(run.event_count), run.event_pixel]
    reference = loop.reference[run.event_pixel] * np.exp(count * loop.event_threshold)
    np.testing.assert_allclose(y, reference, rtol=1e-12)


def test_twin_pixels_fire_together_in_the_order_of_their_numbers():
    offsets = np.repeat(OFFSETS[:2], 3, axis=0)
    run = simulate(mirror_loop(offsets=offsets), duration=1.0)
    twins = run.event_time.reshape(-1, 3)
    assert np.all(twins == twins[:, :1])
    pixels = run.event_pixel.reshape(-1, 3)
    assert np.all(np.diff(pixels, axis=1) == 1)
    alone = simulate(mirror_loop(offsets=OFFSETS[:2]), duration=1.0)
    np.testing.assert_allclose(twins[:, 0], alone.event_time, atol=1e-12)


def test_an_event_on_the_last_instant_belongs_to_the_run():
    loop = mirror_loop(1)
    first = simulate(loop, duration=1.0).event_time[0]
    assert simulate(loop, duration=float(first)).event_count == 1
    assert simulate(loop, duration=float(np.nextafter(first, 0)) - 1e-13).event_count == 0
    later = simulate(loop, duration=1.0, sample_times=[np.nextafter(first, 0), first, first])
    at_end = simulate(loop, duration=float(first), sample_times=[first])
    assert later.drive[0] != later.drive[1] == later.drive[2] == at_end.drive[0]


OSCILLATOR = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


def wave(amplitude, *, threshold):
    """Luminosity ``2 + amplitude sin t``, seen by a pixel with q(0) = 2."""
    return single_pixel_loop(
        OSCILLATOR,
        np.array([1.0, 0.0, 1.0]),
        np.array([0.0, amplitude, 2.0]),
        threshold=threshold,
        bounds=(1.9, 2.1),
    )


@pytest.mark.parametrize(
    ('excess', 'fires'), [(1e-13, True), (1e-6, True), (-1e-6, False), (-1e-13, False)]
)
def test_grazing_crossings_are_neither_missed_nor_invented(excess, fires):
    threshold = float(np.log1p(0.25))
    run = simulate(wave(0.5 + excess, threshold=threshold), duration=3.0)
    if not fires:
        assert run.event_count == 0
        return
    assert run.event_polarity[0] == 1
    assert run.event_time[0] == pytest.approx(np.arcsin(0.5 / (0.5 + excess)), abs=1e-7)


def test_exact_tangency_counts_as_reached():
    run = simulate(wave(0.5, threshold=float(np.log1p(0.25))), duration=2.0)
    assert run.event_count == 1
    assert run.event_time[0] == pytest.approx(np.pi / 2, abs=1e-6)


def test_events_of_a_wave_stand_at_the_arcsine():
    h = 0.05
    run = simulate(wave(0.5, threshold=h), duration=np.pi / 2)
    levels = 2 * np.exp(h * np.arange(1, run.event_count + 1))
    np.testing.assert_allclose(run.event_time, np.arcsin((levels - 2) / 0.5), atol=1e-13)
    assert run.event_count == int(np.log(2.5 / 2) / h)


def test_a_short_spike_of_a_fast_mode_is_seen():
    # y = 0.99 + 0.3 (e^-1e5 t - e^-1e6 t) / peak: up and down again within microseconds.
    a = np.diag([-1e5, -1e6, 0.0])
    peak = 0.1 ** (1 / 9) - 0.1 ** (10 / 9)
    loop = single_pixel_loop(
        a, np.ones(3), np.array([0.3 / peak, -0.3 / peak, 0.99]), threshold=0.25, bounds=(0.9, 1.1)
    )
    loop = changed(loop, initial_reference=[1.0])
    run = simulate(loop, duration=1.0)
    assert run.event_polarity.tolist() == [1, -1]
    assert run.event_time[-1] < 5e-5


def test_defective_plant_has_polynomial_events():
    # Two integrators: y = 1 + t + t^2 / 2 with the state (1, 1, 1).
    a = np.array([[0.0, 1, 0], [0, 0, 1], [0, 0, 0]])
    loop = single_pixel_loop(
        a, np.array([1.0, 0, 0]), np.ones(3), threshold=0.1, bounds=(0.95, 1.05)
    )
    run = simulate(loop, duration=3.0)
    levels = np.exp(0.1 * np.arange(1, run.event_count + 1))
    np.testing.assert_allclose(run.event_time, np.sqrt(2 * levels - 1) - 1, atol=1e-13)


def test_luminosity_towards_zero_is_reported_and_does_not_hang():
    loop = single_pixel_loop(
        np.array([[0.0, 1.0], [0.0, 0.0]]),
        np.array([1.0, 0.0]),
        np.array([1.0, -1.0]),
        threshold=0.1,
        bounds=(0.95, 1.05),
    )
    run = simulate(loop, duration=2.0)
    assert run.outcome.status == 'zeno'
    assert run.outcome.pixel == 0
    assert run.outcome.time == pytest.approx(1.0, abs=1e-4)
    assert 'max_event_rate' in run.outcome.message
    assert run.event_count < 1000


def test_an_unstable_loop_is_reported():
    loop = single_pixel_loop(
        np.array([[30.0]]), np.array([1.0]), np.array([1.0]), threshold=0.5, bounds=(0.95, 1.05)
    )
    assert simulate(loop, duration=10.0).outcome.status == 'diverged'


def test_max_events_ends_a_run():
    run = simulate(mirror_loop(9), duration=1e4, max_events=100_000)
    assert run.outcome.status == 'max_events'
    assert 100_000 <= run.event_count < 300_000


def test_signed_pixels_turn_their_sign_in_pairs():
    loop = mirror_loop(9, threshold=0.149, signed=True)
    run = simulate(loop, duration=3.0)
    assert run.outcome.completed
    for pixel in range(9):
        mine = run.event_pixel == pixel
        time, polarity, sign = (
            column[mine] for column in (run.event_time, run.event_polarity, run.event_sign)
        )
        turned = np.flatnonzero(np.diff(sign)) + 1
        assert turned.size % 2 == 1
        assert np.all(time[turned] == time[turned - 1])
        assert np.all(polarity[turned - 1] == -1)
        assert np.all(polarity[turned] == 1)
        at = simulate(loop, duration=3.0, sample_times=time[turned])
        y = luminosities(loop, at.states)[:, pixel]
        np.testing.assert_allclose(y, sign[turned] * loop.dead_band, rtol=1e-9)
    assert np.all(run.signs == -1)
    assert run.counts.tolist() == counts_at(loop, run, np.array([3.0]))[0][0].tolist()


def test_sector_ratio_stays_below_one_and_comes_near_it():
    loop = mirror_loop(9)
    first = simulate(loop, duration=2.0)
    instants = np.sort(np.concatenate([GRID, first.event_time, first.event_time - 1e-12]))
    ratios = sector_ratios(loop, simulate(loop, duration=2.0, sample_times=instants))
    assert 0.95 < ratios.max() <= 1 + 1e-9


def test_tail_bounds_enclose_the_error():
    loop = mirror_loop(3)
    run = simulate(loop, duration=2.0, sample_times=GRID, tail_start=1.0, tail_step=0.05)
    error = np.linalg.norm(run.states - loop.equilibrium.state, axis=1)[GRID >= 1.0]
    assert run.tail.peak <= run.tail.peak_bound
    assert error.max() <= run.tail.peak_bound
    fine = simulate(loop, duration=2.0, tail_start=1.0, tail_step=1e-4).tail
    assert fine.peak_bound - fine.peak < 1e-6
    assert error.max() == pytest.approx(fine.peak, rel=1e-3)
    assert fine.mean == pytest.approx(error.mean(), rel=1e-2)


def test_stiff_controllers_run():
    run = simulate(mirror_loop(9, controller=stiff_controller(paper_plant())), duration=2.0)
    plain = simulate(mirror_loop(9), duration=2.0)
    assert run.outcome.completed
    assert abs(run.event_count - plain.event_count) < 0.2 * plain.event_count
    assert run.evaluations < 12 * run.event_count


def test_many_pixels_cost_by_the_event():
    rng = np.random.default_rng(1)
    loops = [mirror_loop(offsets=rng.uniform(-0.01, 0.01, (r, 2))) for r in (100, 3000)]
    runs = [simulate(loop, duration=0.3) for loop in loops]
    assert runs[1].event_count > 20 * runs[0].event_count
    assert all(run.evaluations < 3 * run.event_count for run in runs)


@pytest.mark.parametrize(
    ('arguments', 'name'),
    [
        ({'duration': 0.0}, 'duration'),
        ({'duration': np.nan}, 'duration'),
        ({'duration': 1.0, 'sample_times': [0.5, 0.2]}, 'sample_times'),
        ({'duration': 1.0, 'sample_times': [0.5, 1.2]}, 'sample_times'),
        ({'duration': 1.0, 'tail_start': 1.0}, 'tail_start'),
        ({'duration': 1.0, 'tail_start': 0.5, 'tail_step': 0.0}, 'tail_step'),
        ({'duration': 1.0, 'max_event_rate': 0.0}, 'max_event_rate'),
        ({'duration': 1.0, 'max_events': 0}, 'max_events'),
    ],
)
def test_bad_arguments_are_named(arguments, name):
    with pytest.raises(ParameterError, match=name):
        simulate(mirror_loop(1), **arguments)


def changed(loop, **changes):
    from dataclasses import fields

    return ClosedLoop(
        **{field.name: getattr(loop, field.name) for field in fields(loop)} | changes
    )


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'initial_reference': [0.3, 0.35, 0.33]}, 'pixel 0'),
        ({'initial_reference': [1.0]}, '3 entries'),
        ({'initial_state': [0.0, 0.0]}, 'y > 0'),
        ({'initial_state': [0.0]}, 'initial_state'),
        ({'event_threshold': -1.0}, 'event_threshold'),
        ({'photoreceptor': 'linear'}, 'photoreceptor'),
        ({'photoreceptor': 'signed_log'}, 'dead_band'),
    ],
)
def test_bad_loops_are_named(changes, message):
    with pytest.raises(ParameterError, match=message):
        changed(mirror_loop(3), **changes)


def test_a_reference_that_would_fire_at_once_is_refused():
    loop = mirror_loop(1)
    with pytest.raises(ParameterError, match='fire at t = 0'):
        changed(loop, event_threshold=1e-4, initial_reference=loop.reference + 0.001)


def test_the_mean_estimate_does_not_drift_over_many_events():
    loop = mirror_loop(9)
    run = simulate(loop, duration=2000.0, sample_times=[2000.0], record_events=False)
    assert run.event_count > 50_000
    z = loop.sector().initial_estimate * np.exp(run.counts * loop.event_threshold)
    drive = math.fsum([*z, *-loop.set_point_luminosity()]) / 9
    assert abs(run.drive[0] - drive) < 1e-16
