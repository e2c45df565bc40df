"""Inner loop: from event to event in closed form, until the end or a limit."""

from __future__ import annotations

import math

import numpy as np

from dvs_simulation.exact.compilation import jit

from .advance import advance
from .error_watch import watch_error
from .firing import add_twofold, fire, record, too_fast
from .heap import heap_update
from .layout import (
    BUFFERED,
    CULPRIT,
    DIVERGED,
    DONE,
    ETA,
    EVENTS,
    FULL,
    NEW_ETA,
    SAMPLE,
    SIGN,
    SPARE_ETA,
    STEP,
    STEPS,
    SUM,
    TIME,
    TIME_LOW,
    ZENO,
    Constants,
    Events,
    Heap,
    Modes,
    Pixels,
    Samples,
)
from .rates import find_rates, position
from .steps import find_step, guess_step


@jit
def run(
    modes: Modes,
    pixels: Pixels,
    upper: Heap,
    lower: Heap,
    state: np.ndarray,
    clock: np.ndarray,
    tally: np.ndarray,
    events: Events,
    samples: Samples,
    constants: Constants,
) -> int:
    """Run until the end, a full buffer, a Zeno point or divergence; may be called again.

    The keys of `lower` are the negatives of the thresholds, so that both heaps are min-heaps. The
    arguments are plain tuples with the fields of the named ones: numba's cache cannot be read any
    more once a named tuple in it has been renamed.
    """
    shape, modal, dense, dense_bound, error_basis = modes
    pixel, pixel_state, power = pixels
    upper_key, upper_pixel, upper_place = upper
    lower_key, lower_pixel, lower_place = lower
    sample_time, sample_eta, sample_drive = samples
    event_time, event_code = events
    offset, growth, log_step, dead_band, end, tail_start, tail_step, event_rate, divergence = (
        constants
    )
    while True:
        s, touch = position(modal, state, offset)
        if not abs(s - offset) <= divergence:
            return DIVERGED
        while True:
            if upper_key[0] <= s + touch:
                i = upper_pixel[0]
                direction = 1
            elif lower_key[0] <= touch - s:
                i = lower_pixel[0]
                direction = -1
            else:
                break
            if tally[BUFFERED] + 2 > event_time.size:
                return FULL
            polarity, above, below = fire(
                pixel, pixel_state, power, log_step, dead_band, clock, i, direction
            )
            heap_update(upper_key, upper_pixel, upper_place, i, above)
            heap_update(lower_key, lower_pixel, lower_place, i, -below)
            fired = record(
                event_time,
                event_code,
                tally[BUFFERED],
                clock[TIME],
                i,
                polarity,
                pixel_state[i, SIGN],
            )
            tally[BUFFERED] += fired
            tally[EVENTS] += fired
            if too_fast(pixel, pixel_state, i, clock[TIME], event_rate):
                tally[CULPRIT] = i
                return ZENO
        drive = clock[SUM] / pixel.shape[0]
        first, second, third = find_rates(shape, modal, dense, state, drive)
        left = (end - clock[TIME]) - clock[TIME_LOW]
        if left > 0.0:
            rise_to = upper_key[0] - s
            fall_to = s + lower_key[0]
            guess = guess_step(first, second, third, rise_to, fall_to, clock[STEP])
            tau = min(left, guess)
            if growth * tau > 2.0:
                tau = 2.0 / growth
            if clock[TIME] + tau > tail_start:
                tau = min(tau, tail_step)
            tau = find_step(
                shape, modal, dense, dense_bound, state, tally, rise_to, fall_to, touch, tau
            )
            if clock[TIME] + tau > tail_start:
                tau = watch_error(
                    shape, modal, dense, dense_bound, error_basis, state, clock, tau, tail_start
                )
            time, time_low = add_twofold(clock[TIME], clock[TIME_LOW], tau)
            if tau == left:
                time, time_low = end, 0.0
        else:
            time, time_low, tau = math.inf, 0.0, 0.0
        while tally[SAMPLE] < sample_time.size:
            k = tally[SAMPLE]
            if sample_time[k] >= time:
                break
            after = (sample_time[k] - clock[TIME]) - clock[TIME_LOW]
            advance(shape, modal, dense, dense_bound, state, max(after, 0.0), SPARE_ETA)
            for j in range(modal.shape[1]):
                sample_eta[k, j] = state[SPARE_ETA, j]
            sample_drive[k] = drive
            tally[SAMPLE] = k + 1
        if not left > 0.0:
            return DONE
        clock[TIME] = time
        clock[TIME_LOW] = time_low
        clock[STEP] = tau
        tally[STEPS] += 1
        for j in range(modal.shape[1]):
            state[ETA, j] = state[NEW_ETA, j]
