"""Inner loop: from event to event in closed form. Compiled by numba, or interpreted.

Between events the input e is constant, and with ``rate = d eta / dt`` every block obeys
``eta(t + tau) = eta(t) + (integral_0^tau exp(M s) ds) rate``, which needs no division by a pole.

No crossing is missed: a step of length H is accepted only with a proof that no threshold is
reached inside. Along the step every mode is either convex or concave, so that it deviates from its
chord to one side only, by at most ``min(|rise|, H^2 max|second derivative| / 8)``; summed over the
modes this encloses s(t) on the whole step. Where the enclosure touches a threshold, the step is
halved, or, where the slope has a proven sign, the one crossing is found by safeguarded Newton
steps. A threshold counts as reached within ``4 eps`` of the size of s, so that a tangency that
is within rounding of touching is an event.

All of it stands in one file, because this file as it is can be loaded a second time without numba,
and because numba's cache notices a change of the file of a function but not of its callees.
"""

from __future__ import annotations

import math

import numpy as np

from dvs_simulation.exact.compilation import jit
from dvs_simulation.exact.layout import (
    BUFFERED,
    COUNT,
    CULPRIT,
    DIVERGED,
    DONE,
    DRIFT,
    ERROR,
    ERROR_SIZE,
    ESTIMATE,
    ETA,
    EVALUATIONS,
    EVENTS,
    FORCING,
    FREQUENCY,
    FULL,
    INTEGRAL,
    LOG_NORM,
    MODULUS,
    NEW_ETA,
    NORM_0,
    NORM_1,
    NORM_2,
    OFFSET,
    PAIR_WEIGHT,
    PEAK,
    PEAK_BOUND,
    POLE,
    RATE,
    REFERENCE,
    SAMPLE,
    SIGN,
    SPARE_ETA,
    STEP,
    STEPS,
    SUM,
    SUM_LOW,
    TIME,
    TIME_LOW,
    WEIGHT,
    WINDOW,
    WINDOW_COUNT,
    WINDOW_START,
    ZENO,
    Constants,
    Events,
    Heap,
    Modes,
    Pixels,
    Samples,
)

_EPS = 2.220446049250313e-16
_TOUCH = 4.0 * _EPS
_SERIES = 1e-3  # below this |pole * tau| five terms of the series are exact to rounding
_NEWTON_STEPS = 60
# Steps that may hold a peak of the error are halved until its bound has only this room left.
_WATCH_ROOM = 1.002
_SHORTEST_WATCH = 2.0**-24

Enclosure = tuple[float, float, float, float, float, float]


@jit
def heap_update(
    keys: np.ndarray, pixels: np.ndarray, places: np.ndarray, i: int, key: float
) -> None:
    """Give pixel `i` a new key and restore the order of the min-heap."""
    size = keys.size
    start = places[i]
    place = start
    child = 2 * place + 1
    while child < size:
        if child + 1 < size and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        moved = pixels[child]
        keys[place] = keys[child]
        pixels[place] = moved
        places[moved] = place
        place = child
        child = 2 * place + 1
    while place <= start and place > 0:
        parent = (place - 1) >> 1
        if keys[parent] <= key:
            break
        moved = pixels[parent]
        keys[place] = keys[parent]
        pixels[place] = moved
        places[moved] = place
        place = parent
    keys[place] = key
    pixels[place] = i
    places[i] = place


@jit
def power_of(power: np.ndarray, log_step: float, exponent: int) -> float:
    """``b^(exponent h)``, from the table where it reaches."""
    half = power.size >> 1
    if -half <= exponent <= half:
        return float(power[exponent + half])
    return math.exp(exponent * log_step)


@jit
def add_twofold(high: float, low: float, value: float) -> tuple[float, float]:
    """Add `value` to the double-double number ``high + low``."""
    total = high + value
    shadow = total - high
    low += (high - (total - shadow)) + (value - shadow)
    high = total + low
    return high, low - (high - total)


@jit
def fire(
    pixel: np.ndarray,
    pixel_state: np.ndarray,
    power: np.ndarray,
    log_step: float,
    dead_band: float,
    clock: np.ndarray,
    i: int,
    direction: int,
) -> tuple[int, float, float]:
    """Let pixel `i` fire as s moves in `direction`.

    Returns the polarity, or 0 for the pair of events with which the sign of the reference turns,
    and the next thresholds in s above and below.
    """
    count = pixel_state[i, COUNT]
    sign = pixel_state[i, SIGN]
    reference = pixel[i, REFERENCE]
    estimate = pixel[i, ESTIMATE]
    before = sign * estimate * power_of(power, log_step, count)
    polarity = 1 if direction == sign else -1
    if polarity < 0 and reference * power_of(power, log_step, count - 1) < dead_band:
        polarity = 0
        sign = direction
        pixel_state[i, SIGN] = sign
    count += polarity
    pixel_state[i, COUNT] = count
    after = sign * estimate * power_of(power, log_step, count)
    high, low = add_twofold(clock[SUM], clock[SUM_LOW], -before)
    clock[SUM], clock[SUM_LOW] = add_twofold(high, low, after)
    outer = reference * power_of(power, log_step, count + 1)
    inner = reference * power_of(power, log_step, count - 1)
    if inner < dead_band:  # silent inside the band: next at its far edge
        inner = -dead_band
    if sign > 0:
        return polarity, outer - pixel[i, OFFSET], inner - pixel[i, OFFSET]
    return polarity, -inner - pixel[i, OFFSET], -outer - pixel[i, OFFSET]


@jit
def record(
    times: np.ndarray, codes: np.ndarray, k: int, time: float, i: int, polarity: int, sign: int
) -> int:
    """Append one event, or the pair that turns the sign; returns the number of events."""
    times[k] = time
    codes[k, 0] = i
    codes[k, 1] = polarity if polarity != 0 else -1
    codes[k, 2] = sign if polarity != 0 else -sign
    if polarity != 0:
        return 1
    times[k + 1] = time
    codes[k + 1, 0] = i
    codes[k + 1, 1] = 1
    codes[k + 1, 2] = sign
    return 2


@jit
def too_fast(
    pixel: np.ndarray, pixel_state: np.ndarray, i: int, time: float, event_rate: float
) -> bool:
    """Count an event of pixel `i`; True if a full window of events took too little time."""
    pixel_state[i, WINDOW_COUNT] += 1
    if pixel_state[i, WINDOW_COUNT] == 1:
        pixel[i, WINDOW_START] = time
    if pixel_state[i, WINDOW_COUNT] < WINDOW:
        return False
    pixel_state[i, WINDOW_COUNT] = 0
    return bool((time - pixel[i, WINDOW_START]) * event_rate < WINDOW - 1)


@jit
def product(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Product of two small square matrices, summed in a fixed order."""
    k = right.shape[0]
    result = np.zeros((k, k))
    for i in range(k):
        for j in range(k):
            for l in range(k):
                result[i, j] += left[i, l] * right[l, j]
    return result


@jit
def dense_step(matrix: np.ndarray, k: int, tau: float) -> tuple[np.ndarray, np.ndarray]:
    """``exp(M tau)`` and its integral over [0, tau]: Taylor series, then doubling."""
    largest = 0.0
    for i in range(k):
        total = 0.0
        for j in range(k):
            total += abs(matrix[i, j])
        largest = max(largest, total)
    doublings = 0
    while largest * tau > 0.5:
        tau *= 0.5
        doublings += 1
    exponential = np.zeros((k, k))
    integral = np.zeros((k, k))
    term = np.zeros((k, k))
    for i in range(k):
        term[i, i] = 1.0
    for order in range(1, 18):
        exponential += term
        integral += term * (tau / order)
        term = product(matrix, term) * (tau / order)
    for _ in range(doublings):
        integral = integral + product(exponential, integral)
        exponential = product(exponential, exponential)
    return exponential, integral


@jit
def real_gain(pole: float, tau: float) -> tuple[float, float]:
    """``exp(pole tau)`` and its integral over [0, tau]."""
    z = pole * tau
    if abs(z) < _SERIES:
        series = 1.0 + z * (1.0 / 3.0) * (1.0 + z * 0.25 * (1.0 + z * 0.2))
        gain = tau * (1.0 + z * 0.5 * series)
        return 1.0 + pole * gain, gain
    if z < -1.0:
        factor = math.exp(z)
        return factor, (factor - 1.0) / pole
    growth = math.expm1(z)
    return 1.0 + growth, growth / pole


@jit
def pair_gain(decay: float, frequency: float, tau: float) -> tuple[float, float, float, float]:
    """``exp(pole tau)`` and its integral for ``pole = decay - i frequency``, as real numbers."""
    growth = math.expm1(decay * tau)
    angle = 0.5 * frequency * tau
    half = math.sin(angle)
    sine = 2.0 * half * math.cos(angle)
    versine = 2.0 * half * half
    real = (1.0 + growth) * (1.0 - versine)
    imag = -(1.0 + growth) * sine
    minus_one = growth * (1.0 - versine) - versine
    square = decay * decay + frequency * frequency
    return (
        real,
        imag,
        (minus_one * decay - imag * frequency) / square,
        (imag * decay + minus_one * frequency) / square,
    )


@jit
def advance_pairs(
    shape: np.ndarray, modal: np.ndarray, state: np.ndarray, tau: float, target: int
) -> Enclosure:
    """Part of `advance` for the pairs of complex poles."""
    rise, slope, above, least, largest = 0.0, 0.0, 0.0, 0.0, 0.0
    eighth = 0.125 * tau * tau
    for j in range(shape[1]):
        a = shape[0] + 2 * j
        b = a + 1
        modulus = modal[MODULUS, a]
        real, imag, gain_real, gain_imag = pair_gain(modal[POLE, a], modal[FREQUENCY, a], tau)
        first_a, first_b = state[RATE, a], state[RATE, b]
        change_a = gain_real * first_a - gain_imag * first_b
        change_b = gain_imag * first_a + gain_real * first_b
        last_a = real * first_a - imag * first_b
        last_b = imag * first_a + real * first_b
        state[target, a] = state[ETA, a] + change_a
        state[target, b] = state[ETA, b] + change_b
        state[target + 1, a] = last_a
        state[target + 1, b] = last_b
        first = modal[WEIGHT, a] * first_a + modal[WEIGHT, b] * first_b
        last = modal[WEIGHT, a] * last_a + modal[WEIGHT, b] * last_b
        rise += modal[WEIGHT, a] * change_a + modal[WEIGHT, b] * change_b
        slope += last
        size = modal[PAIR_WEIGHT, a] * math.sqrt(first_a * first_a + first_b * first_b)
        if modal[POLE, a] > 0.0:
            size *= math.exp(modal[POLE, a] * tau)
        above += min(modulus * eighth, 4.0 / modulus) * size
        bend = modulus * modulus * eighth * size
        largest += min(max(first, last) + bend, size)
        least += max(min(first, last) - bend, -size)
    return rise, slope, above, above, least, largest


@jit
def advance_dense(
    shape: np.ndarray,
    modal: np.ndarray,
    dense: np.ndarray,
    dense_bound: np.ndarray,
    state: np.ndarray,
    tau: float,
    target: int,
) -> Enclosure:
    """Part of `advance` for the dense blocks."""
    rise, slope, above, least, largest = 0.0, 0.0, 0.0, 0.0, 0.0
    eighth = 0.125 * tau * tau
    for j in range(shape[2]):
        start = shape[3 + j]
        k = shape[4 + j] - start
        exponential, integral = dense_step(dense[j], k, tau)
        first, last, size = 0.0, 0.0, 0.0
        for i in range(k):
            change, moved = 0.0, 0.0
            for l in range(k):
                change += integral[i, l] * state[RATE, start + l]
                moved += exponential[i, l] * state[RATE, start + l]
            state[target, start + i] = state[ETA, start + i] + change
            state[target + 1, start + i] = moved
            first += modal[WEIGHT, start + i] * state[RATE, start + i]
            last += modal[WEIGHT, start + i] * moved
            rise += modal[WEIGHT, start + i] * change
            size += state[RATE, start + i] * state[RATE, start + i]
        slope += last
        size = math.sqrt(size) * math.exp(max(0.0, dense_bound[j, LOG_NORM] * tau))
        above += size * min(dense_bound[j, NORM_1] * eighth, 2.0 * dense_bound[j, NORM_0] * tau)
        bend = dense_bound[j, NORM_2] * eighth * size
        size *= dense_bound[j, NORM_0]
        largest += min(max(first, last) + bend, size)
        least += max(min(first, last) - bend, -size)
    return rise, slope, above, above, least, largest


@jit
def advance(
    shape: np.ndarray,
    modal: np.ndarray,
    dense: np.ndarray,
    dense_bound: np.ndarray,
    state: np.ndarray,
    tau: float,
    target: int,
) -> Enclosure:
    """State after `tau` into the rows `target` and `target + 1`, and the enclosure of s.

    Returns the rise of s, its slope at the end, how far s may lie above and below its chord, and
    the least and largest slope on the way.
    """
    rise, slope, above, below, least, largest = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    eighth = 0.125 * tau * tau
    for j in range(shape[0]):
        pole = modal[POLE, j]
        factor, gain = real_gain(pole, tau)
        rate = state[RATE, j]
        state[target, j] = state[ETA, j] + gain * rate
        state[target + 1, j] = factor * rate
        first = modal[WEIGHT, j] * rate
        last = factor * first
        change = gain * first
        rise += change
        slope += last
        largest += max(first, last)
        least += min(first, last)
        bend = min(abs(pole) * eighth * max(abs(first), abs(last)), abs(change))
        if pole * first > 0.0:
            below += bend
        else:
            above += bend
    if shape[1] > 0:
        part = advance_pairs(shape, modal, state, tau, target)
        rise += part[0]
        slope += part[1]
        above += part[2]
        below += part[3]
        least += part[4]
        largest += part[5]
    if shape[2] > 0:
        part = advance_dense(shape, modal, dense, dense_bound, state, tau, target)
        rise += part[0]
        slope += part[1]
        above += part[2]
        below += part[3]
        least += part[4]
        largest += part[5]
    return rise, slope, above, below, least, largest


@jit
def multiply_dense(
    shape: np.ndarray, dense: np.ndarray, state: np.ndarray, row: int, i: int
) -> float:
    """Coordinate `i` of the block-diagonal matrix times ``state[row]``, for dense blocks."""
    j = 0
    while shape[4 + j] <= i:
        j += 1
    start = shape[3 + j]
    total = 0.0
    for l in range(shape[4 + j] - start):
        total += dense[j, i - start, l] * state[row, start + l]
    return total


@jit
def find_rates(
    shape: np.ndarray, modal: np.ndarray, dense: np.ndarray, state: np.ndarray, drive: float
) -> tuple[float, float, float]:
    """``rate = d eta / dt`` under the input `drive`; returns three derivatives of s."""
    first, second, third = 0.0, 0.0, 0.0
    p = shape[0]
    for j in range(p):
        pole = modal[POLE, j]
        rate = pole * state[ETA, j] + modal[FORCING, j] * drive + modal[DRIFT, j]
        state[RATE, j] = rate
        term = modal[WEIGHT, j] * rate
        first += term
        second += pole * term
        third += pole * pole * term
    first_dense = p + 2 * shape[1]
    for a in range(p, first_dense, 2):
        b = a + 1
        sigma, omega = modal[POLE, a], modal[FREQUENCY, a]
        x, y = state[ETA, a], state[ETA, b]
        x, y = (
            sigma * x + omega * y + modal[FORCING, a] * drive + modal[DRIFT, a],
            sigma * y - omega * x + modal[FORCING, b] * drive + modal[DRIFT, b],
        )
        state[RATE, a], state[RATE, b] = x, y
        first += modal[WEIGHT, a] * x + modal[WEIGHT, b] * y
        x, y = sigma * x + omega * y, sigma * y - omega * x
        second += modal[WEIGHT, a] * x + modal[WEIGHT, b] * y
        x, y = sigma * x + omega * y, sigma * y - omega * x
        third += modal[WEIGHT, a] * x + modal[WEIGHT, b] * y
    for i in range(first_dense, modal.shape[1]):
        rate = multiply_dense(shape, dense, state, ETA, i)
        rate += modal[FORCING, i] * drive + modal[DRIFT, i]
        state[RATE, i] = rate
        first += modal[WEIGHT, i] * rate
    for i in range(first_dense, modal.shape[1]):
        second += modal[WEIGHT, i] * multiply_dense(shape, dense, state, RATE, i)
    return first, second, third


@jit
def position(modal: np.ndarray, state: np.ndarray, offset: float) -> tuple[float, float]:
    """The scalar s and the distance within which it touches a threshold."""
    s = offset
    scale = abs(offset)
    for j in range(modal.shape[1]):
        term = modal[WEIGHT, j] * state[ETA, j]
        s += term
        scale += abs(term)
    return s, _TOUCH * scale


@jit
def guess_step(
    first: float, second: float, third: float, rise: float, fall: float, last: float
) -> float:
    """Time at which s reaches a threshold, from three derivatives, or twice the last step."""
    if first < 0.0:
        first, second, third = -first, -second, -third
        rise, fall = fall, rise
    root = first * first + 2.0 * second * rise
    if root < 0.0:
        root = first * first - 2.0 * second * fall
        return max(2.0 * last, (first + math.sqrt(root)) / -second)
    root = math.sqrt(root)
    if first + root <= 0.0:
        return 2.0 * last
    tau = 2.0 * rise / (first + root)
    # One Newton step on the cubic; `root` is the slope of the parabola at its crossing.
    correction = third * tau * tau * tau / 6.0
    slope = root + 0.5 * third * tau * tau
    if slope > 0.5 * root and abs(correction) < 0.25 * tau * slope:
        tau -= correction / slope
    return tau


@jit
def find_crossing(
    shape: np.ndarray,
    modal: np.ndarray,
    dense: np.ndarray,
    dense_bound: np.ndarray,
    state: np.ndarray,
    tally: np.ndarray,
    goal: float,
    touch: float,
    high: float,
    rise: float,
    slope: float,
) -> float:
    """The one instant in (0, high] at which s has risen by `goal`; the slope keeps its sign.

    `rise` and `slope` are those at `high`; the new state ends at the crossing.
    """
    low, top, tau = 0.0, high, high
    for _ in range(_NEWTON_STEPS):
        miss = rise - goal
        if abs(miss) <= touch:
            return tau
        if (miss > 0.0) == (goal > 0.0):
            top = tau
        else:
            low = tau
        tau = tau - miss / slope if slope != 0.0 else low
        if not low < tau < top:
            tau = 0.5 * (low + top)
        if tau <= low or tau >= top:
            break
        rise, slope, _, _, _, _ = advance(shape, modal, dense, dense_bound, state, tau, NEW_ETA)
        tally[EVALUATIONS] += 1
    advance(shape, modal, dense, dense_bound, state, top, NEW_ETA)
    return top


@jit
def find_step(
    shape: np.ndarray,
    modal: np.ndarray,
    dense: np.ndarray,
    dense_bound: np.ndarray,
    state: np.ndarray,
    tally: np.ndarray,
    rise_to: float,
    fall_to: float,
    touch: float,
    tau: float,
) -> float:
    """Longest proven step of at most `tau`: up to the next crossing, or free of crossings.

    `rise_to` and `fall_to` are the distances to the nearest thresholds above and below.
    """
    while True:
        rise, slope, above, below, least, largest = advance(
            shape, modal, dense, dense_bound, state, tau, NEW_ETA
        )
        tally[EVALUATIONS] += 1
        top, bottom = max(rise, 0.0), min(rise, 0.0)
        if least < 0.0 < largest:
            top += above
            bottom -= below
        if top <= rise_to and bottom >= -fall_to:
            return tau
        up = rise >= rise_to - touch and (
            least >= 0.0 or (top <= rise + touch and bottom > -fall_to)
        )
        down = rise <= touch - fall_to and (
            largest <= 0.0 or (bottom >= rise - touch and top < rise_to)
        )
        if up or down:
            goal = rise_to if up else -fall_to
            return find_crossing(
                shape, modal, dense, dense_bound, state, tally, goal, touch, tau, rise, slope
            )
        tau *= 0.5


@jit
def error_norm(error_basis: np.ndarray, state: np.ndarray, row: int) -> float:
    """``||x - x_d||``."""
    total = 0.0
    for i in range(error_basis.shape[0]):
        entry = 0.0
        for j in range(error_basis.shape[1]):
            entry += error_basis[i, j] * state[row, j]
        total += entry * entry
    return math.sqrt(total)


@jit
def error_spread(
    shape: np.ndarray,
    modal: np.ndarray,
    dense: np.ndarray,
    dense_bound: np.ndarray,
    state: np.ndarray,
    tau: float,
) -> float:
    """How far x may leave its chord within a step."""
    spread = 0.0
    eighth = 0.125 * tau * tau
    p = shape[0]
    for j in range(p):
        largest = max(abs(state[RATE, j]), abs(state[NEW_ETA + 1, j]))
        bend = min(abs(modal[POLE, j]) * eighth * largest, abs(state[NEW_ETA, j] - state[ETA, j]))
        spread += modal[ERROR_SIZE, j] * bend
    for a in range(p, p + 2 * shape[1], 2):
        size = math.hypot(state[RATE, a], state[RATE, a + 1])
        size *= math.exp(max(0.0, modal[POLE, a] * tau))
        bend = min(modal[MODULUS, a] * eighth, 4.0 / modal[MODULUS, a]) * size
        spread += bend * (modal[ERROR_SIZE, a] + modal[ERROR_SIZE, a + 1])
    for j in range(shape[2]):
        size, norm, columns = 0.0, 0.0, 0.0
        start = shape[3 + j]
        k = shape[4 + j] - start
        for i in range(k):
            size += state[RATE, start + i] ** 2
            columns += modal[ERROR_SIZE, start + i] ** 2
            for l in range(k):
                norm += dense[j, i, l] ** 2
        size = math.sqrt(size) * math.exp(max(0.0, dense_bound[j, LOG_NORM] * tau))
        spread += math.sqrt(columns) * size * min(math.sqrt(norm) * eighth, 2.0 * tau)
    return spread


@jit
def watch_error(
    shape: np.ndarray,
    modal: np.ndarray,
    dense: np.ndarray,
    dense_bound: np.ndarray,
    error_basis: np.ndarray,
    state: np.ndarray,
    clock: np.ndarray,
    tau: float,
    tail_start: float,
) -> float:
    """Largest error of the tail, attained and bounded, and its integral.

    Returns the step, shortened where it may hold a peak that its ends do not show.
    """
    before = clock[ERROR]
    if before < 0.0:
        before = error_norm(error_basis, state, ETA)
    shortest = tau * _SHORTEST_WATCH
    while True:
        after = error_norm(error_basis, state, NEW_ETA)
        largest = max(before, after)
        bound = largest + error_spread(shape, modal, dense, dense_bound, state, tau)
        if bound <= max(clock[PEAK], largest) * _WATCH_ROOM or tau <= shortest:
            break
        tau *= 0.5
        advance(shape, modal, dense, dense_bound, state, tau, NEW_ETA)
    start = clock[TIME]
    clock[ERROR] = after
    if start >= tail_start:
        clock[PEAK] = max(clock[PEAK], before)
    watched = start + tau - max(start, tail_start)
    if watched > 0.0:
        clock[PEAK] = max(clock[PEAK], after)
        clock[PEAK_BOUND] = max(clock[PEAK_BOUND], bound)
        clock[INTEGRAL] += 0.5 * (before + after) * watched
    return tau


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
