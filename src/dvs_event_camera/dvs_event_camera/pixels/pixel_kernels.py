"""Compiled pixels: the frame pass, and the events of the pixels that have news.

Same results as the NumPy comparators, bit for bit. No logarithm is taken here: a compiled one may
differ from NumPy's in the last bit. What is left is IEEE arithmetic in the same order, which numba
neither contracts nor reorders.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dvs_event_camera.pixels.event_flood import MOST_STEPS as _MOST_STEPS
from dvs_event_camera.pixels.kernel_cache import kernel

# Bits of a digit: as many counters stay in the first-level cache.
_DIGIT = 11
_NEVER = np.iinfo(np.int64).max // 4
# Keeps a border away from its threshold by far more than a logarithm is rounded.
_MARGIN = 1e-12
_F4_MAX = 3.4028e38
_F4_MIN = 1.2e-38


@kernel
def find_news(
    signal: Any, low: Any, high: Any, store: Any, mask: Any, first: int, found: Any, number: int
) -> int:
    """Pixels whose signal lies outside its silent band, and a copy of the signal.

    Parameters
    ----------
    signal
        Luminosities or levels of some pixels, shape (k,).
    low, high
        Smallest and largest silent value of each, shape (k,).
    store
        Out: the signal, shape (k,).
    mask
        Scratch, uint8, a multiple of 8 and at least k entries, zero from k on.
    first
        Index of the first of the pixels.
    found
        Out: indices of the pixels with news, int32; `number` of them are there already.
    number
        How many.

    Returns
    -------
    int
        Number of pixels in `found`.
    """
    size = signal.size
    # A loop without branches, which the compiler turns into vector instructions.
    for i in range(size):
        y = signal[i]
        store[i] = y
        # Negated so that NaN is news.
        mask[i] = not ((y >= low[i]) & (y <= high[i]))
    words = mask[: (size + 7) // 8 * 8].view(np.uint64)
    for word in range(words.size):
        if words[word] != 0:
            # No branch for the processor to guess wrong, unlike an `if` on every pixel.
            for i in range(8 * word, 8 * word + 8):
                found[number] = first + i
                number += int(mask[i])
    return number


@kernel
def gather(values: Any, found: Any, out: Any) -> None:
    """Values of some pixels as float64.

    Parameters
    ----------
    values
        Of all pixels.
    found
        Indices, shape (k,).
    out
        Out: float64, shape (k,).
    """
    for k in range(found.size):
        out[k] = values[found[k]]


@kernel
def hold_invalid(found: Any, now: Any, before: Any, store: Any, previous: Any, origin: Any) -> int:
    """Replace levels that are not finite by the previous ones; return how many there were.

    A pixel without light so far rests on its reference.

    Parameters
    ----------
    found
        Pixels, int32, shape (k,).
    now, before
        Their new and previous levels, float64, shape (k,); `now` is overwritten.
    store, previous
        New and previous signal of all pixels; `store` is overwritten.
    origin
        Level of the first reference of all pixels, float64.
    """
    invalid = 0
    for k in range(found.size):
        if not np.isfinite(before[k]):
            before[k] = origin[found[k]]
        if not np.isfinite(now[k]):
            now[k] = before[k]
            store[found[k]] = previous[found[k]]
            invalid += 1
    return invalid


@kernel
def store_float_borders(found: Any, lower: Any, upper: Any, low: Any, high: Any) -> None:
    """Borders of the silent bands as float32, rounded inwards.

    Parameters
    ----------
    found
        Pixels, int32, shape (k,).
    lower, upper
        Luminosities between which they are silent, float64, shape (k,).
    low, high
        Out: borders of all pixels, float32.
    """
    for k in range(found.size):
        a, b = lower[k] * (1.0 + 2e-7), upper[k] * (1.0 - 2e-7)
        if a > 0.0 and a < _F4_MIN:
            a = _F4_MIN
        if b > _F4_MAX:
            b = _F4_MAX
        low[found[k]] = a
        high[found[k]] = b


@kernel
def store_integer_borders(
    found: Any, lower: Any, upper: Any, low: Any, high: Any, largest: float
) -> None:
    """Borders of the silent bands as integers.

    Parameters
    ----------
    found
        Pixels, int32, shape (k,).
    lower, upper
        Luminosities between which they are silent, float64, shape (k,).
    low, high
        Out: smallest and largest silent value of all pixels, unsigned.
    largest
        Largest value of their type.
    """
    for k in range(found.size):
        a = max(np.ceil(lower[k] * (1.0 + 1e-9)), 0.0)
        b = min(np.floor(upper[k] * (1.0 - 1e-9)), largest)
        silent = a <= b
        low[found[k]] = a if silent else 1.0
        high[found[k]] = b if silent else 0.0


@kernel
def store_level_borders(found: Any, lower: Any, upper: Any, low: Any, high: Any) -> None:
    """Borders of the silent bands where the signal is the level itself.

    Parameters
    ----------
    found
        Pixels, int32, shape (k,).
    lower, upper
        Levels between which they are silent, float64, shape (k,).
    low, high
        Out: borders of all pixels, float64.
    """
    for k in range(found.size):
        low[found[k]] = lower[k]
        high[found[k]] = upper[k]


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
def fire_linear(
    place: int,
    found: Any,
    now: Any,
    before: Any,
    origin: Any,
    counts: Any,
    step: float,
    duration_ns: int,
    shift: int,
    keys: Any,
    used: int,
    edges: Any,
) -> tuple[int, int, int]:
    """Events of ideal pixels whose level is linear in time; `counts` moves with them.

    Parameters
    ----------
    place
        First of the pixels to deal with.
    found
        Pixels, int32, shape (k,).
    now, before
        Levels at the end and at the start of the interval, float64, shape (k,).
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
        Pixels dealt with, all of them unless the buffer is full; events in the buffer; events that
        it must be able to hold to go on.
    """
    duration = float(duration_ns)
    room = _room(keys, shift)
    for k in range(place, found.size):
        i = found[k]
        end, count = (now[k] - origin[i]) / step, counts[i]
        if end >= count + 1.0 or end <= count - 1.0:
            rest = np.floor(end) if end > count else np.ceil(end)
            if abs(rest) > _MOST_STEPS:
                return k, used, int(min(abs(rest), 1e18))
            polarity = 1 if end > count else -1
            rungs = int(abs(rest - count))
            if used + rungs > room:
                return k, used, used + rungs
            start = (before[k] - origin[i]) / step
            pace = duration / (end - start)
            low = (np.int64(i) << 2) | (polarity + 1)
            for rung in range(1, rungs + 1):
                threshold = count + polarity * (rung * 1.0)
                elapsed = min(max(np.ceil((threshold - start) * pace), 1.0), duration)
                _put(keys, used, np.int64(elapsed), low, shift)
                used += 1
            count = np.int32(rest)
            counts[i] = count
        edges[0, k] = _inside(origin[i] + (count - 1.0) * step, -1.0)
        edges[1, k] = _inside(origin[i] + (count + 1.0) * step, 1.0)
    return found.size, used, used


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
def fire_cubic(
    place: int,
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
    """Events of ideal pixels whose level is a monotone cubic; see `fire_linear` for the rest.

    Parameters
    ----------
    place, found, now, before
        See `fire_linear`.
    older, oldest
        Levels one and two samples before the start of the interval, float64, shape (k,).
    a1, a2
        Lengths of the two intervals before, in units of this one; 0 where there was none.
    tolerance, iterations
        When the search for a crossing ends.
    origin, counts, step, duration_ns, shift, keys, used, edges
        See `fire_linear`.

    Returns
    -------
    place, used, needed
        See `fire_linear`.
    """
    duration = float(duration_ns)
    room = _room(keys, shift)
    for k in range(place, found.size):
        i = found[k]
        end, count = (now[k] - origin[i]) / step, counts[i]
        if end >= count + 1.0 or end <= count - 1.0:
            rest = np.floor(end) if end > count else np.ceil(end)
            if abs(rest) > _MOST_STEPS:
                return k, used, int(min(abs(rest), 1e18))
            polarity = 1 if end > count else -1
            rungs = int(abs(rest - count))
            if used + rungs > room:
                return k, used, used + rungs
            start = (before[k] - origin[i]) / step
            rise = end - start
            second, third = 0.0, 0.0
            if a1 > 0:
                second_last = (older[k] - origin[i]) / step
                older_rise = (start - second_last) / a1
                second = (rise - older_rise) / (1.0 + a1)
                if a2 > 0:
                    oldest_rise = (second_last - (oldest[k] - origin[i]) / step) / a2
                    older_second = (older_rise - oldest_rise) / (a1 + a2)
                    third = (second - older_second) / (1.0 + a1 + a2)
            least, most = min(0.0, 3.0 * rise), max(0.0, 3.0 * rise)
            b0 = min(max(rise - second - third * a1, least), most) / rise
            b1 = min(max(rise + second + third * (1.0 + a1), least), most) / rise
            low = (np.int64(i) << 2) | (polarity + 1)
            for rung in range(1, rungs + 1):
                threshold = count + polarity * (rung * 1.0)
                fraction = _cubic_root(b0, b1, (threshold - start) / rise, tolerance, iterations)
                elapsed = min(max(np.ceil(fraction * duration), 1.0), duration)
                _put(keys, used, np.int64(elapsed), low, shift)
                used += 1
            count = np.int32(rest)
            counts[i] = count
        edges[0, k] = _inside(origin[i] + (count - 1.0) * step, -1.0)
        edges[1, k] = _inside(origin[i] + (count + 1.0) * step, 1.0)
    return found.size, used, used


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
    place, found, now, before, origin
        See `fire_linear`.
    present
        Present references of all pixels, float64, where they are not on a ladder.
    ladder
        Whether a reference moves by a threshold at an event, or to the present level.
    on, off
        Numbers of ON and OFF events of all pixels, int32; updated in place.
    on_thresholds, off_thresholds
        Thresholds of all pixels as changes of the level, float64.
    refractory_ns
        Refractory period, ns.
    ready_ns
        Time from which each pixel can fire, int64, ns; updated in place.
    shot_pixel, shot_when, shot_polarity
        Shot noise of the interval, sorted by pixel and time; the last pixel is none.
    start_ns
        Start of the interval, ns.
    duration_ns, shift, keys, used, edges
        See `fire_linear`.

    Returns
    -------
    place, used, needed
        See `fire_linear`.
    """
    room = _room(keys, shift)
    shots = shot_pixel.size - 1
    shot = 0
    if shots and place < found.size:
        shot = np.searchsorted(shot_pixel[:shots], found[place])
    for k in range(place, found.size):
        i = found[k]
        start, end = before[k], now[k]
        rise = end - start
        theta_on, theta_off = on_thresholds[i], off_thresholds[i]
        mean, half = 0.5 * (theta_on + theta_off), 0.5 * (theta_on - theta_off)
        n_on, n_off, ready_at, written = on[i], off[i], ready_ns[i], used
        reference = present[i]
        clock = 0
        while shot < shots and shot_pixel[shot] < i:
            shot += 1
        first_shot = shot
        while True:
            if ladder:
                reference = origin[i] + (n_on - n_off) * mean + (n_on + n_off) * half
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
        on[i], off[i], ready_ns[i], present[i], used = n_on, n_off, ready_at, reference, written
        if lower < end < upper:
            edges[0, k], edges[1, k] = _inside(lower, -1.0), _inside(upper, 1.0)
        else:
            # Refractory and behind: news whatever comes.
            edges[0, k], edges[1, k] = np.inf, -np.inf
    return found.size, used, used


@kernel
def radix_sort(keys: Any, scratch: Any, first_bit: int, last_bit: int) -> None:
    """Sort keys whose bits below `first_bit` are in order already, or nearly so.

    Digit by digit from the lowest (Knuth, *The Art of Computer Programming* 3, section 5.2.5),
    then neighbours that are out of order because of the bits below.

    Parameters
    ----------
    keys
        Non-negative int64, shape (k,); sorted in place.
    scratch
        As large as `keys`.
    first_bit, last_bit
        Bits to sort by; those from `last_bit` on are zero.
    """
    bits = max(last_bit - first_bit, 1)
    passes = (bits + _DIGIT - 1) // _DIGIT
    width = (bits + passes - 1) // passes
    mask = (1 << width) - 1
    place = np.empty(1 << width, np.int64)
    source, target = keys, scratch
    for turn in range(passes):
        shift = first_bit + turn * width
        place[:] = 0
        for k in range(source.size):
            place[(source[k] >> shift) & mask] += 1
        below = 0
        for digit in range(place.size):
            below, place[digit] = below + place[digit], below
        for k in range(source.size):
            digit = (source[k] >> shift) & mask
            target[place[digit]] = source[k]
            place[digit] += 1
        source, target = target, source
    if passes % 2:
        for k in range(source.size):
            target[k] = source[k]
    for k in range(1, keys.size):
        key, j = keys[k], k
        while j > 0 and keys[j - 1] > key:
            keys[j] = keys[j - 1]
            j -= 1
        keys[j] = key


@kernel
def unpack_keys(
    keys: Any, start_ns: int, shift: int, t: Any, pixel: Any, polarity: Any, flag: Any
) -> None:
    """Sorted keys to columns.

    Parameters
    ----------
    keys
        Sorted keys, int64, shape (k,).
    start_ns
        Time from which the keys' times count, ns.
    shift
        Where the time begins.
    t
        Out: absolute time, int64, shape (k,).
    pixel
        Out: pixel, int32, shape (k,).
    polarity
        Out: +1 or -1, int8, shape (k,).
    flag
        Out: the lowest bit, int8, shape (k,).
    """
    pixels = (1 << (shift - 2)) - 1
    for i in range(keys.size):
        key = keys[i]
        t[i] = (key >> shift) + start_ns
        pixel[i] = (key >> 2) & pixels
        polarity[i] = (key & 2) - 1
        flag[i] = key & 1


@kernel
def merge(one: Any, other: Any, out: Any) -> None:
    """Two sorted arrays as one.

    Parameters
    ----------
    one, other
        Sorted, int64.
    out
        Out: as large as both.
    """
    i, j = 0, 0
    for k in range(out.size):
        if j >= other.size or (i < one.size and one[i] <= other[j]):
            out[k] = one[i]
            i += 1
        else:
            out[k] = other[j]
            j += 1


@kernel
def label_events(pixel: Any, polarity: Any, noise: Any, owed: Any) -> None:
    """Label what pays the debts of noise; see `noise_labels.NoiseLabels`.

    Parameters
    ----------
    pixel, polarity
        Events in order, shape (k,).
    noise
        1 for spurious events, int8, shape (k,); updated in place.
    owed
        Polarity owed by noise of all pixels, int64; updated in place.
    """
    for k in range(pixel.size):
        debt = owed[pixel[k]]
        if noise[k] > 0:
            owed[pixel[k]] = debt - polarity[k]
        elif debt * polarity[k] > 0:
            noise[k] = 1
            owed[pixel[k]] = debt - polarity[k]


@kernel
def pack_records(
    t: Any,
    pixel: Any,
    polarity: Any,
    sign: Any,
    width: int,
    stamp_ns: int,
    first_index: int,
    words: Any,
) -> None:
    """Records of `dvs_common.wire.events.EVENT_DTYPE`: `make_events` in one pass.

    Parameters
    ----------
    t
        Absolute time, int64, ns, shape (k,).
    pixel
        Row-major pixel, int32, shape (k,).
    polarity
        +1 or -1, int8, shape (k,).
    sign
        +1 or -1, int8, shape (k,).
    width
        Columns of the pixel array.
    stamp_ns
        Stamp of the packet, ns.
    first_index
        Running number of the first event.
    words
        Out: two 64-bit words an event, uint64, shape (k, 2).
    """
    columns = np.int32(width)
    for i in range(t.size):
        row = pixel[i] // columns
        column = pixel[i] - row * columns
        place = np.uint64(column) | np.uint64(row) << np.uint64(16)
        relative = np.uint64(np.uint32(t[i] - stamp_ns))
        words[i, 0] = place | relative << np.uint64(32)
        flags = np.uint64(np.uint8(polarity[i])) | np.uint64(np.uint8(sign[i])) << np.uint64(8)
        words[i, 1] = np.uint64(np.uint32(first_index + i)) | flags << np.uint64(32)
