"""Faults that other simulators are known for: a copy of each fails the check that we pass.

Every check takes a simulator, a function from stamps (ns) and log luminosities (one pixel) to the
stamps (s) and polarities of its events.
"""

import math

import numpy as np
import pytest

from dvs_common.errors import ParameterError
from dvs_common.scenario.parameters import SCHEMA
from dvs_common.wire import topics
from dvs_event_camera.pixels.imperfections import Imperfections
from dvs_event_camera.pixels.pixel_array import PixelArray

MS = 1_000_000
H = 0.1


def ours(**imperfections):
    def simulate(stamps, levels):
        array = PixelArray(event_threshold=H, imperfections=Imperfections(**imperfections))
        found = [array.update(int(t), [math.exp(v)]) for t, v in zip(stamps, levels, strict=True)]
        t = np.concatenate([events.t for events in found])
        return t * 1e-9, np.concatenate([events.polarity for events in found])

    return simulate


# -- the checks -----------------------------------------------------------------------------------


def pixel_stays_alive_on_a_ramp(simulate):
    levels = np.linspace(0, 4, 400)
    t, polarity = simulate(np.arange(400) * MS, levels)
    # Events come until the very end, at about their rate.
    return t.size > 0 and t[-1] > 0.9 * 0.4 and 20 < polarity.sum() < 80


def no_polarity_is_lost(simulate):
    stamps = np.arange(0, 600) * MS
    levels = np.minimum(stamps / (20 * MS), 2.0)  # 2.0 in 40 ms, then a pause
    _, polarity = simulate(stamps, levels)
    return abs(polarity.sum() * H - 2.0) < H + 1e-9


def stamps_lie_between_the_frames(simulate):
    stamps = np.array([0, 100]) * MS
    t, _ = simulate(stamps, [0.0, 1.05])
    return t.size == 10 and np.allclose(t, 0.1 * H * np.arange(1, 11) / 1.05, atol=2e-9)


def stamps_resolve_nanoseconds_after_an_hour(simulate):
    hour = 3600 * 1000 * MS
    t, _ = simulate(hour + np.array([0, 1, 2]) * MS, [0.0, 0.15, 0.25])
    expected = np.array([2 / 3 * 1e-3, 1.5e-3])
    return t.size == 2 and np.allclose(t - 3600.0, expected, atol=1e-8)


def more_light_is_on(simulate):
    _, polarity = simulate(np.array([0, 1]) * MS, [0.0, 0.55])
    return np.all(polarity == 1)


def time_zero_is_a_time_as_any_other(simulate):
    # An event at 0; the pixel must be silent for 5 ms after it.
    t, _ = simulate(np.array([-1, 0, 1, 2, 20]) * MS, [0.0, H + 1e-9, 0.25, 0.35, 0.35])
    return t.size == 3 and np.all(np.diff(t) >= 5e-3 - 1e-9)


def crossings_are_those_of_the_logarithm(simulate):
    stamps = np.arange(0, 11) * 10 * MS
    t, _ = simulate(stamps, -30.0 * stamps * 1e-9)  # an exponential decay of the luminosity
    return np.allclose(t, H * np.arange(1, t.size + 1) / 30.0, atol=2e-9)


# -- copies of the faults -------------------------------------------------------------------------


def noisy_threshold_every_frame(stamps, levels):
    """The reference jumps by a threshold drawn anew and may come to lie beyond the samples."""
    rng = np.random.default_rng(3)
    reference, t, polarity = levels[0], [], []
    for before, after, stamp in zip(levels[:-1], levels[1:], stamps[1:], strict=True):
        threshold = H * (1 + 40 * abs(rng.standard_normal()))
        if before < reference + threshold / 40 <= after or before > reference > after:
            reference += threshold
            t.append(stamp * 1e-9)
            polarity.append(1)
    return np.array(t), np.array(polarity, int)


def refractory_that_moves_the_reference(stamps, levels, period_ns=3 * MS):
    """An event within the refractory period is dropped, but its step of the reference is not."""
    reference, last, t, polarity = levels[0], -(10**18), [], []
    for level, stamp in zip(levels, stamps, strict=True):
        while abs(level - reference) >= H:
            step = math.copysign(H, level - reference)
            reference += step
            if stamp - last >= period_ns:
                last = stamp
                t.append(stamp * 1e-9)
                polarity.append(int(np.sign(step)))
    return np.array(t), np.array(polarity, int)


def stamped_at_the_frame(stamps, levels):
    t, polarity = ours()(stamps, levels)
    later = np.asarray(stamps) * 1e-9
    return later[np.searchsorted(later, t - 1e-12)], polarity


def spread_evenly_over_four_instants(stamps, levels):
    t, polarity = ours()(stamps, levels)
    later = np.asarray(stamps) * 1e-9
    quarter = np.min(np.diff(later)) / 4
    return np.ceil(t / quarter) * quarter, polarity


def seconds_in_float32(stamps, levels):
    t, polarity = ours()(stamps, levels)
    return t.astype(np.float32).astype(np.float64), polarity


def inverted(stamps, levels):
    t, polarity = ours()(stamps, levels)
    return t, -polarity


def zero_means_never(stamps, levels, period_ns=5 * MS):
    """A pixel whose last event is at 0 counts as one that has never fired."""
    reference, last, t, polarity = levels[0], 0, [], []
    for level, stamp in zip(levels, stamps, strict=True):
        while abs(level - reference) >= H and (last == 0 or stamp - last >= period_ns):
            reference += math.copysign(H, level - reference)
            last = stamp
            t.append(stamp * 1e-9)
            polarity.append(1)
    return np.array(t), np.array(polarity, int)


def interpolated_luminosity(stamps, levels):
    """Crossings of the luminosity, not of its logarithm, between two frames."""
    t, polarity = ours()(stamps, levels)
    seconds, light = np.asarray(stamps) * 1e-9, np.exp(levels)
    targets = np.exp(np.interp(t, seconds, levels))
    return np.interp(-targets, -light, seconds), polarity


@pytest.mark.parametrize(
    ('check', 'right', 'faulty'),
    [
        (
            pixel_stays_alive_on_a_ramp,
            ours(threshold_mismatch=0.3),
            noisy_threshold_every_frame,
        ),
        (
            no_polarity_is_lost,
            ours(refractory_period=3e-3),
            refractory_that_moves_the_reference,
        ),
        (no_polarity_is_lost, ours(), refractory_that_moves_the_reference),
        (stamps_lie_between_the_frames, ours(), stamped_at_the_frame),
        (stamps_lie_between_the_frames, ours(), spread_evenly_over_four_instants),
        (stamps_resolve_nanoseconds_after_an_hour, ours(), seconds_in_float32),
        (more_light_is_on, ours(), inverted),
        (time_zero_is_a_time_as_any_other, ours(refractory_period=5e-3), zero_means_never),
        (crossings_are_those_of_the_logarithm, ours(), interpolated_luminosity),
    ],
)
def test_check_passes_ours_and_fails_a_copy_of_the_fault(check, right, faulty):
    assert check(right)
    assert not check(faulty)


@pytest.mark.parametrize(
    ('imperfections', 'within'),
    [
        ({}, 1),
        ({'reset': 'level'}, 1),
        ({'refractory_period': 3e-3}, 1),
        ({'event_threshold_off': 0.1}, 1),
        ({'shot_noise_rate': 50.0}, 1),
        ({'cutoff_frequency': 100.0}, 1),
        ({'latency': 2e-3, 'jitter': 1e-3}, 1),
        ({'leak_rate': 1e-9, 'hot_pixel_fraction': 0.0}, 1),
        ({'threshold_mismatch': 1e-6}, 1.01),
    ],
)
@pytest.mark.parametrize('end', [2.0, -2.0])
def test_polarities_times_threshold_are_the_true_change_of_the_logarithm(
    imperfections, within, end
):
    stamps = np.arange(0, 600) * MS
    levels = np.sign(end) * np.minimum(stamps / (20 * MS), 2.0)  # 2.0 in 40 ms, then a pause
    _, polarity = ours(**imperfections)(stamps, levels)
    assert abs(polarity.sum() * H - end) < within * H + 1e-9


def test_unequal_thresholds_weigh_their_own_polarities():
    stamps = np.arange(0, 400) * MS
    levels = np.sin(stamps * 2e-8) * 2.0
    _, polarity = ours(event_threshold_off=0.25)(stamps, levels)
    change = H * np.count_nonzero(polarity > 0) - 0.25 * np.count_nonzero(polarity < 0)
    assert -H < change - levels[-1] < 0.25


def test_pause_of_a_physical_reset_loses_change_as_the_circuit_does():
    stamps = np.arange(0, 600) * MS
    levels = np.minimum(stamps / (20 * MS), 2.0)
    _, polarity = ours(refractory_period=10e-3, reset='level')(stamps, levels)
    # One event every 10 ms and one at the very end, however far the light has gone meanwhile.
    assert 4 <= polarity.sum() <= 6


def test_misspelt_parameters_are_refused_with_a_hint():
    with pytest.raises(ParameterError, match='did you mean refractory_period'):
        SCHEMA.validate({'refractory_peroid': 1e-3})


def test_events_are_never_best_effort():
    pytest.importorskip('rclpy')
    for mode in ('lockstep', 'realtime'):
        qos = topics.handshake_qos(mode)
        assert qos.reliability.name == 'RELIABLE'
        assert qos.depth >= 100
