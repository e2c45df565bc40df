"""Compiled pixels: the events of those that have news."""

from __future__ import annotations

from typing import Any

import numpy as np

from dvs_common.kernel_cache import kernel
from dvs_event_camera.pixels.event_flood import MOST_STEPS as _MOST_STEPS

_NEVER = np.iinfo(np.int64).max // 4
# Keeps a border away from its threshold by far more than a logarithm is rounded.
_MARGIN = 1e-12
# Pixels whose state is fetched at a time, into the first-level cache.
_GROUP = 256


@kernel
def _put(keys: Any, used: int, elapsed: Any, low: Any, shift: int) -> None:
    """One event as one key, or as two words where the time does not fit beside the pixel."""
    if shift > 0:
        keys[used] = (elapsed << shift) | low
    else:
        keys[2 * used] = elapsed
        keys[2 * used + 1] = low


@kernel
def _room(keys: Any, shift: int) -> Any:
    return keys.size if shift > 0 else keys.size // 2


@kernel
def _inside(edge: float, sign: float) -> float:
    return edge - sign * _MARGIN * (1.0 + abs(edge))


@kernel
def _fetched(found: Any, origin: Any, counts: Any) -> tuple[Any, Any]:
    """Origins and counts of the pixels, in a loop of its own whose cache misses overlap."""
    base, count = np.empty(found.size), np.empty(found.size)
    for k in range(found.size):
        base[k] = origin[found[k]]
        count[k] = counts[found[k]]
    return base, count


@kernel
def _courses(now: Any, before: Any, base: Any, count: Any, step: float, edges: Any) -> Any:
    """Level at the start and rise, in steps, and the count after the interval, shape (3, k).

    Without a branch, so that the compiler makes vector instructions of it. `edges` as in
    `fire_ideal`.
    """
    courses = np.empty((3, now.size))
    start, rise, rest = courses[0], courses[1], courses[2]
    lower, upper = edges[0], edges[1]
    for k in range(now.size):
        end = (now[k] - base[k]) / step
        start[k] = (before[k] - base[k]) / step
        rise[k] = end - start[k]
        fallen = np.ceil(end) if end <= count[k] - 1.0 else count[k]
        rest[k] = np.floor(end) if end >= count[k] + 1.0 else fallen
        lower[k] = _inside(base[k] + (rest[k] - 1.0) * step, -1.0)
        upper[k] = _inside(base[k] + (rest[k] + 1.0) * step, 1.0)
    return courses


@kernel
def _slopes(
    start: Any, rise: Any, older: Any, oldest: Any, base: Any, step: float, a1: float, a2: float
) -> Any:
    """Slopes of the cubic at both ends over the mean one, as in `hermite`, shape (2, k)."""
    slopes = np.empty((2, start.size))
    for k in range(start.size):
        second, third = 0.0, 0.0
        if a1 > 0:
            second_last = (older[k] - base[k]) / step
            older_rise = (start[k] - second_last) / a1
            second = (rise[k] - older_rise) / (1.0 + a1)
            if a2 > 0:
                oldest_rise = (second_last - (oldest[k] - base[k]) / step) / a2
                older_second = (older_rise - oldest_rise) / (a1 + a2)
                third = (second - older_second) / (1.0 + a1 + a2)
        least, most = min(0.0, 3.0 * rise[k]), max(0.0, 3.0 * rise[k])
        slopes[0, k] = min(max(rise[k] - second - third * a1, least), most) / rise[k]
        slopes[1, k] = min(max(rise[k] + second + third * (1.0 + a1), least), most) / rise[k]
    return slopes


@kernel
def _needed(rest: Any, count: Any, used: int) -> int:
    """Events that the buffer must be able to hold; of a flood, its steps."""
    needed = used
    for k in range(rest.size):
        if abs(rest[k]) > _MOST_STEPS:
            return int(min(abs(rest[k]), 1e18))
        needed += int(abs(rest[k] - count[k]))
    return needed


@kernel
def _cubic_root(b0: float, b1: float, goal: float, tolerance: float, iterations: int) -> float:
    """`hermite.monotone_cubic_root` for one cubic."""
    low, high = 0.0, 1.0
    x = min(max(goal, 0.0), 1.0)
    for _ in range(iterations):
        excess = x * (b0 + x * (3.0 - 2.0 * b0 - b1 + x * (b0 + b1 - 2.0))) - goal
        if excess >= 0:
            high = x
        if excess <= 0:
            low = x
        slope = b0 + x * (2.0 * (3.0 - 2.0 * b0 - b1) + 3.0 * x * (b0 + b1 - 2.0))
        guess = x - excess / (slope if slope > 0 else 1.0)
        if not (slope > 0 and low < guess < high):
            guess = 0.5 * (low + high)
        moved = abs(guess - x)
        x = guess
        if not moved > tolerance:
            break
    return x


@kernel
def fire_ideal(
    found: Any,
    now: Any,
    before: Any,
    older: Any,
    oldest: Any,
    a1: float,
    a2: float,
    tolerance: float,
    iterations: int,
    origin: Any,
    counts: Any,
    step: float,
    duration_ns: int,
    shift: int,
    keys: Any,
    used: int,
    edges: Any,
) -> tuple[int, int, int]:
    """Events of ideal pixels; `counts` moves with them.

    Parameters
    ----------
    found
        Pixels, int32, shape (k,).
    now, before
        Levels at the end and at the start of the interval, float64, shape (k,).
    older, oldest
        Levels one and two samples before the start, float64, shape (k,).
    a1, a2
        Lengths of the two intervals before, in units of this one; 0 where there was none.
    tolerance, iterations
        When the search for a crossing of the cubic ends; no iterations: the level is linear in
        time.
    origin
        Level of the first reference of all pixels, float64.
    counts
        N of all pixels, int32; updated in place.
    step
        Threshold as a change of the level, ``h ln b``.
    duration_ns
        Length of the interval, ns.
    shift
        Where the time begins in a key, 0 for two words an event.
    keys
        int64 buffer that holds `used` events already.
    used
        Number of events in the buffer.
    edges
        Out: levels between which each pixel is silent from now on, float64, shape (2, k).

    Returns
    -------
    place, used, needed
        Pixels dealt with: none if the buffer is too small, else all; events in the buffer; events
        that it must be able to hold.
    """
    duration = float(duration_ns)
    base, count = _fetched(found, origin, counts)
    courses = _courses(now, before, base, count, step, edges)
    start, rise, rest = courses[0], courses[1], courses[2]
    needed = _needed(rest, count, used)
    if needed > _room(keys, shift):
        return 0, used, needed
    cubic = iterations > 0
    slopes = courses
    if cubic:
        slopes = _slopes(start, rise, older, oldest, base, step, a1, a2)
    pace = duration / rise
    for k in range(found.size):
        if rest[k] == count[k]:
            continue
        up = rest[k] > count[k]
        polarity = 1.0 if up else -1.0
        low = (np.int64(found[k]) << 2) | (2 if up else 0)
        counts[found[k]] = rest[k]
        for rung in range(1, int(abs(rest[k] - count[k])) + 1):
            distance = count[k] + polarity * rung - start[k]
            if cubic:
                goal = distance / rise[k]
                fraction = _cubic_root(slopes[0, k], slopes[1, k], goal, tolerance, iterations)
                elapsed = np.ceil(fraction * duration)
            else:
                elapsed = np.ceil(distance * pace[k])
            _put(keys, used, np.int64(min(max(elapsed, 1.0), duration)), low, shift)
            used += 1
    return found.size, used, used


@kernel
def _of_group(values: Any, pixels: Any, out: Any) -> None:
    """Values of some pixels, or the one of all, in a loop whose cache misses overlap."""
    same = values.size == 1
    for k in range(pixels.size):
        # Unsigned, so that no index counts from the end.
        out[k] = values[np.uint32(0 if same else pixels[k])]


@kernel
def fire_imperfect(
    place: int,
    found: Any,
    now: Any,
    before: Any,
    origin: Any,
    present: Any,
    ladder: bool,
    on: Any,
    off: Any,
    on_thresholds: Any,
    off_thresholds: Any,
    refractory_ns: int,
    ready_ns: Any,
    shot_pixel: Any,
    shot_when: Any,
    shot_polarity: Any,
    start_ns: int,
    duration_ns: int,
    shift: int,
    keys: Any,
    used: int,
    edges: Any,
) -> tuple[int, int, int]:
    """Events of imperfect pixels, as `imperfect_comparator.ImperfectComparator` has them.

    Parameters
    ----------
    place
        First of the pixels to deal with.
    found, now, before, origin
        See `fire_ideal`.
    present
        Present references of all pixels, float64, where they are not on a ladder.
    ladder
        Whether a reference moves by a threshold at an event, or to the present level.
    on, off
        Numbers of ON and OFF events of all pixels, int32; updated in place.
    on_thresholds, off_thresholds
        Thresholds of all pixels as changes of the level, float64; one entry if all are the same.
    refractory_ns
        Refractory period, ns.
    ready_ns
        Time from which each pixel can fire, int64, ns; updated in place.
    shot_pixel, shot_when, shot_polarity
        Shot noise of the interval, sorted by pixel and time; the last pixel is none.
    start_ns
        Start of the interval, ns.
    duration_ns, shift, keys, used, edges
        See `fire_ideal`.

    Returns
    -------
    place, used, needed
        Pixels dealt with, all of them unless the buffer is full; events in the buffer; events that
        it must be able to hold to go on.
    """
    room = _room(keys, shift)
    shots = shot_pixel.size - 1
    shot = 0
    if shots and place < found.size:
        shot = np.searchsorted(shot_pixel[:shots], found[place])
    size = min(_GROUP, found.size - place)
    of_group, ready_of = np.empty((5, size)), np.empty(size, np.int64)
    for k in range(place, found.size):
        j = (k - place) % size
        if j == 0:
            pixels = found[k : k + size]
            _of_group(origin if ladder else present, pixels, of_group[0])
            _of_group(on, pixels, of_group[1])
            _of_group(off, pixels, of_group[2])
            _of_group(on_thresholds, pixels, of_group[3])
            _of_group(off_thresholds, pixels, of_group[4])
            _of_group(ready_ns, pixels, ready_of)
        i = found[k]
        start, end = before[k], now[k]
        rise = end - start
        theta_on, theta_off = of_group[3, j], of_group[4, j]
        mean, half = 0.5 * (theta_on + theta_off), 0.5 * (theta_on - theta_off)
        n_on, n_off, ready_at, written = of_group[1, j], of_group[2, j], ready_of[j], used
        reference = of_group[0, j]
        clock = 0
        while shot < shots and shot_pixel[shot] < i:
            shot += 1
        first_shot = shot
        while True:
            if ladder:
                reference = of_group[0, j] + (n_on - n_off) * mean + (n_on + n_off) * half
            upper, lower = reference + theta_on, reference - theta_off
            ready = max(clock, ready_at - start_ns)
            while shot < shots and shot_pixel[shot] == i and shot_when[shot] < ready:
                shot += 1
            level = start + rise * (min(ready, duration_ns) / duration_ns)
            at_once = level >= upper or level <= lower
            up = level >= upper if at_once else end >= upper
            when = _NEVER
            if ready <= duration_ns:
                if at_once:
                    when = max(ready, 1)
                elif end >= upper or end <= lower:
                    fraction = ((upper if up else lower) - start) / (rise if rise != 0 else 1.0)
                    fraction = min(max(fraction, 0.0), 1.0)
                    when = max(max(np.int64(np.ceil(fraction * duration_ns)), ready), 1)
            is_shot = (
                shot < shots
                and shot_pixel[shot] == i
                and shot_when[shot] <= when
                and shot_when[shot] <= duration_ns
            )
            if is_shot:
                when, up = shot_when[shot], shot_polarity[shot] > 0
                shot += 1
            if when > duration_ns:
                break
            if written >= room:
                # Not committed: the pixel is done again in a larger buffer.
                shot = first_shot
                return k, used, written + 1
            low = (np.int64(i) << 2) | (2 if up else 0) | (1 if is_shot else 0)
            _put(keys, written, when, low, shift)
            written += 1
            n_on += 1 if up else 0
            n_off += 0 if up else 1
            if not ladder:
                reference = start + rise * (when / duration_ns)
            clock = when
            ready_at = start_ns + clock + max(refractory_ns, 1 if is_shot else 0)
        on[i], off[i], ready_ns[i], used = n_on, n_off, ready_at, written
        if not ladder:
            present[i] = reference
        if lower < end < upper:
            edges[0, k], edges[1, k] = _inside(lower, -1.0), _inside(upper, 1.0)
        else:
            # Refractory and behind: news whatever comes.
            edges[0, k], edges[1, k] = np.inf, -np.inf
    return found.size, used, used
