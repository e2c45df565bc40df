"""One run of the sampled loop, compiled."""

from __future__ import annotations

from typing import Any

import numpy as np

from dvs_common.kernel_cache import kernel
from dvs_event_camera.pixels.firing_kernels import fire_imperfect
from dvs_simulation.sampled.kernel import estimator
from dvs_simulation.sampled.kernel.layout import DARK, DONE, UNUSUAL
from dvs_simulation.sampled.kernel.loop_calls import SCRATCH_SIZE, product, unary

# Events of a packet from which on the controller sums them in another order.
_MOST_EVENTS = 4095
_NO_SHOT, _NO_WHEN = np.full(1, -1, np.int64), np.zeros(1, np.int64)
_NO_POLARITY = np.zeros(1, np.int8)


@kernel
def _look(loops: Any, scratch: Any, plant: Any, out: Any, room: Any) -> float:
    """Luminosities of the present state; return the least."""
    n = plant.state.size
    product(loops.matmul, scratch, plant.gradient, plant.state, room, 1, n, 1, False)
    least = np.inf
    for i in range(out.size):
        out[i] = room[0] + plant.offsets[i]
        least = min(least, out[i])
    return least


@kernel
def _levels(
    loops: Any, scratch: Any, pixels: Any, luminosity: Any, elapsed_ns: int, out: Any
) -> bool:
    """Levels of a sample; False where one has no meaning."""
    size = out.size
    for i in range(size):
        out[i] = max(luminosity[i], pixels.floor) if pixels.floor > 0 else luminosity[i]
    unary(loops.log, scratch, out, out, size, 8)
    for i in range(size):
        if not np.isfinite(out[i]):
            return False
    if pixels.leaks:
        seconds = elapsed_ns * pixels.nanosecond_s
        for i in range(size):
            out[i] += pixels.step * (pixels.phase[i] + pixels.rates[i] * seconds)
    for d in range(pixels.dead.size):
        out[pixels.dead[d]] = pixels.frozen[d]
    return True


@kernel
def _is_quiet(pixels: Any, now: Any) -> bool:
    """Whether no ideal pixel fires."""
    for i in range(now.size):
        if not abs((now[i] - pixels.origin[i]) / pixels.step - pixels.counts[i]) < 1.0:
            return False
    return True


@kernel
def _fire_ideal(
    pixels: Any, place: int, now: Any, period_ns: int, shift: int, keys: Any, used: int
) -> tuple[int, int, int]:
    """Events of ideal pixels, as `crossings.linear_crossings` has them."""
    for i in range(place, now.size):
        end, number = (now[i] - pixels.origin[i]) / pixels.step, pixels.counts[i]
        if number - 1.0 < end < number + 1.0:
            continue
        rest = np.floor(end) if end > number else np.ceil(end)
        rungs = abs(rest - number)
        if used + rungs > keys.size:
            return i, used, int(min(used + rungs, 1e12))
        way = 1 if end > number else -1
        start = (pixels.level[i] - pixels.origin[i]) / pixels.step
        pace = period_ns / (end - start)
        for rung in range(1, int(rungs) + 1):
            elapsed = np.ceil((number + way * (rung * 1.0) - start) * pace)
            when = np.int64(min(max(elapsed, 1.0), float(period_ns)))
            keys[used] = (when << shift) | (np.int64(i) << 2) | (way + 1)
            used += 1
        pixels.counts[i] = np.int32(rest)
    return now.size, used, used


@kernel
def _fire(
    pixels: Any, now: Any, start_ns: int, period_ns: int, shift: int, keys: Any, edges: Any
) -> tuple[Any, int]:
    """Events of an interval as sorted keys; how many, or -1 where they are too many."""
    place = used = 0
    while place < now.size:
        if pixels.ideal:
            place, used, needed = _fire_ideal(pixels, place, now, period_ns, shift, keys, used)
        else:
            place, used, needed = fire_imperfect(
                place,
                pixels.numbers,
                now,
                pixels.level,
                pixels.origin,
                pixels.present,
                pixels.ladder,
                pixels.on,
                pixels.off,
                pixels.on_thresholds,
                pixels.off_thresholds,
                pixels.refractory_ns,
                pixels.ready_ns,
                _NO_SHOT,
                _NO_WHEN,
                _NO_POLARITY,
                start_ns,
                period_ns,
                shift,
                keys,
                used,
                edges,
            )
        if place < now.size:
            if needed > _MOST_EVENTS:
                return keys, -1
            larger = np.empty(2 * max(needed, keys.size), np.int64)
            larger[:used] = keys[:used]
            keys = larger
    keys[:used].sort()
    return keys, used


@kernel
def _move(
    loops: Any, scratch: Any, plant: Any, commands: Any, resting: Any, sample: int, room: Any
) -> None:
    """The plant, from a sample to the next; it rests at the set-point's input before a command."""
    n, m = plant.state.size, commands.shape[1]
    pushed, driven = room[:m], room[m : m + n]
    moved = room[m + n : m + 2 * n]
    for piece in range(plant.first_piece[sample], plant.first_piece[sample + 1]):
        held = plant.commands[piece]
        for j in range(m):
            pushed[j] = commands[held, j] if held >= 0 else resting[j]
            if plant.push.shape[0]:
                pushed[j] = pushed[j] + plant.push[piece, j]
            if plant.input_noise.shape[0]:
                pushed[j] = pushed[j] + plant.input_noise[piece, j]
        which = plant.lengths[piece]
        product(
            loops.matmul, scratch, plant.transitions[which], plant.state, moved, n, n, 1, False
        )
        product(loops.matmul, scratch, plant.gains[which], pushed, driven, n, m, 1, False)
        for i in range(n):
            plant.state[i] = moved[i] + driven[i]
            if plant.state_noise.shape[0]:
                plant.state[i] = plant.state[i] + plant.state_noise[piece, i]


@kernel
def _doubled(array: Any) -> Any:
    larger = np.empty(2 * array.size, array.dtype)
    larger[: array.size] = array
    return larger


@kernel
def run(
    loops: Any,
    plant: Any,
    pixels: Any,
    known: Any,
    control: Any,
    record: Any,
    period_ns: int,
    lost: Any,
    shift: int,
) -> tuple[int, int, Any, Any]:
    """Go on from sample 0, which is in the arrays, to the last one.

    Parameters
    ----------
    loops
        `numpy_loops.Loops`.
    plant, pixels, known, control
        See `layout`; they move.
    record
        Out: `layout.Record`; row 0 is there.
    period_ns
        Sampling period, ns.
    lost
        Samples whose packet the controller does not get, shape (N + 1,).
    shift
        Where the time begins in an event's key.

    Returns
    -------
    how, samples, times, lows
        How it ended, samples in the record, and the events: times in ns, and pixel and polarity.
    """
    r, n, m = known.estimate.size, plant.state.size, control.output.shape[0]
    scratch = np.empty(SCRATCH_SIZE, np.int64)
    now, edges, room = (
        np.empty(r),
        np.empty((2, r)),
        np.empty(max(1, m + 2 * n, control.state.size)),
    )
    keys, mask = np.empty(max(4 * r, 64), np.int64), (np.int64(1) << shift) - 1
    times, lows = np.empty(1024, np.int64), np.empty(1024, np.int64)
    events = expected = 0
    has_lost, last = False, 0
    for sample in range(1, lost.size):
        _move(loops, scratch, plant, record.commands, control.feedforward, sample - 1, room)
        light = record.luminosities[sample]
        record.states[sample] = plant.state
        if not _look(loops, scratch, plant, light, room) > 0:
            return DARK, sample, times[:events], lows[:events]
        if not _levels(loops, scratch, pixels, light, sample * period_ns, now):
            return UNUSUAL, sample, times[:events], lows[:events]
        used = 0
        if not pixels.ideal or not _is_quiet(pixels, now):
            start_ns = (sample - 1) * period_ns
            keys, used = _fire(pixels, now, start_ns, period_ns, shift, keys, edges)
            if used < 0 or used > _MOST_EVENTS:
                return UNUSUAL, sample, times[:events], lows[:events]
        pixels.level[:] = now
        while events + used > times.size:
            times, lows = _doubled(times), _doubled(lows)
        for e in range(used):
            times[events + e] = (sample - 1) * period_ns + (keys[e] >> shift)
            lows[events + e] = keys[e] & mask
        events += used
        record.first_event[sample + 1] = events
        if lost[sample]:
            record.estimates[sample] = known.estimate
            continue
        gap, last = sample - last - 1, sample
        if known.leaks.size and not estimator.leak(
            loops, scratch, known, known.leaks[gap], has_lost
        ):
            return UNUSUAL, sample, times[:events], lows[:events]
        missing = events - used - expected
        if used and missing:
            if not estimator.lose(loops, scratch, known, missing, has_lost):
                return UNUSUAL, sample, times[:events], lows[:events]
            has_lost = True
        estimator.advance(loops, scratch, control, gap, room)
        if used:
            expected = events
            jumps, ages = np.empty(used), np.empty(used, np.int64)
            which, ways = np.empty(used, np.int64), np.empty(used, np.int8)
            for e in range(used):
                ages[e] = period_ns - (keys[e] >> shift)
                which[e] = (keys[e] & mask) >> 2
                ways[e] = 1 if keys[e] & 2 else -1
            if not estimator.count(loops, scratch, known, which, ways, has_lost, jumps):
                return UNUSUAL, sample, times[:events], lows[:events]
            estimator.jump(loops, scratch, control, jumps, ages, room)
        control.deviation[0] = estimator.deviation(loops, scratch, known, room)
        estimator.command(loops, scratch, control, record.commands[sample])
        record.estimates[sample] = known.estimate
    return DONE, lost.size, times[:events], lows[:events]
