"""The running controller, compiled: `ReferenceIntervals` and `EventController` bit for bit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from dvs_common.kernel_cache import kernel
from dvs_simulation.sampled.kernel.loop_calls import binary, product, total, unary

# As in interval_arithmetic and intervals of dvs_hinf_controller.running.
_LARGEST_LOGARITHM, _UNKNOWN_WIDTH = 300.0, 3.0
_DOUBLE, _COMPLEX = 8, 16


@kernel
def _all_known(loops: Any, scratch: Any, lower: Any, upper: Any) -> bool:
    size = lower.size
    low, high = np.empty(size), np.empty(size)
    unary(loops.log, scratch, lower, low, size, _DOUBLE)
    unary(loops.log, scratch, upper, high, size, _DOUBLE)
    known = True
    for i in range(size):
        known = known and 0.5 * (high[i] - low[i]) <= _UNKNOWN_WIDTH
    return known


@kernel
def renew(loops: Any, scratch: Any, known: Any, has_lost: bool) -> bool:
    """Work out the first estimates; False where a reference is not known.

    Parameters
    ----------
    loops
        `numpy_loops.Loops`.
    scratch
        For `loop_calls`.
    known
        `layout.EstimateArrays`.
    has_lost
        Whether losses have widened the intervals.
    """
    lower, upper = known.lower, known.upper
    if not _all_known(loops, scratch, lower, upper):
        return False
    size = lower.size
    factor = known.on_spacing * known.off_spacing
    for i in range(size):
        amplified = upper[i] + lower[i] * factor
        known.first[i] = 2 * lower[i] * upper[i] * known.off_spacing / amplified
    return True


@kernel
def _estimate_all(loops: Any, scratch: Any, known: Any) -> None:
    size = known.counts.size
    growth = np.empty(size)
    for i in range(size):
        growth[i] = known.counts[i] * known.step
    unary(loops.exp, scratch, growth, growth, size, _DOUBLE)
    for i in range(size):
        known.estimate[i] = known.first[i] * growth[i]


@kernel
def leak(loops: Any, scratch: Any, known: Any, factor: float, has_lost: bool) -> bool:
    """Let references leak; False where one is not known any more.

    Parameters
    ----------
    loops, scratch, known, has_lost
        See `renew`.
    factor
        By which lower ends fall.
    """
    for i in range(known.lower.size):
        known.lower[i] *= factor
        known.upper[i] *= 1.0
        if has_lost:
            known.counted_lower[i] *= factor
            known.counted_upper[i] *= 1.0
    if not renew(loops, scratch, known, has_lost):
        return False
    _estimate_all(loops, scratch, known)
    return True


@kernel
def lose(loops: Any, scratch: Any, known: Any, count: int, has_lost: bool) -> bool:
    """Widen for lost events; False where a reference is not known any more.

    Parameters
    ----------
    loops, scratch, known, has_lost
        See `renew`.
    count
        How many, > 0.
    """
    most = _LARGEST_LOGARITHM / known.step
    if count > most:
        return False
    up, down = math.exp(known.on * count), math.exp(-known.off * count)
    mismatch = math.exp(count * max(known.on - known.step, known.off - known.step))
    for i in range(known.lower.size):
        if not has_lost:
            known.counted_lower[i] = known.lower[i]
            known.counted_upper[i] = known.upper[i]
        known.lower[i] *= down
        known.upper[i] *= up
        known.counted_lower[i] /= mismatch
        known.counted_upper[i] *= mismatch
    if not renew(loops, scratch, known, True):
        return False
    _estimate_all(loops, scratch, known)
    return True


@kernel
def _widen(
    loops: Any, scratch: Any, known: Any, pixels: Any, polarities: Any, has_lost: bool
) -> bool:
    slack_on, slack_off = known.on - known.step, known.off - known.step
    if slack_on == 0.0 and slack_off == 0.0:
        return True
    size = known.lower.size
    grown = np.zeros(size)
    for e in range(pixels.size):
        grown[pixels[e]] += slack_on if polarities[e] > 0 else slack_off
    unary(loops.exp, scratch, grown, grown, size, _DOUBLE)
    for i in range(size):
        known.lower[i] *= 1 / grown[i]
        known.upper[i] *= grown[i]
        if has_lost:
            known.counted_lower[i] *= 1 / grown[i]
            known.counted_upper[i] *= grown[i]
    return bool(renew(loops, scratch, known, has_lost))


@kernel
def count(
    loops: Any,
    scratch: Any,
    known: Any,
    pixels: Any,
    polarities: Any,
    has_lost: bool,
    jumps: Any,
) -> bool:
    """Count events and write the jumps of the mean; False where that leads out of range.

    Parameters
    ----------
    loops, scratch, known, has_lost
        See `renew`.
    pixels, polarities
        Events in order, shape (E,).
    jumps
        Out: shape (E,).
    """
    size = pixels.size
    growth = np.empty(size)
    farthest = 0
    for e in range(size):
        i = pixels[e]
        known.counts[i] += polarities[e]
        farthest = max(farthest, abs(known.counts[i]))
        growth[e] = known.counts[i] * known.step
    if not (farthest + size) * known.step < _LARGEST_LOGARITHM:
        return False
    unary(loops.exp, scratch, growth, growth, size, _DOUBLE)
    if not _widen(loops, scratch, known, pixels, polarities, has_lost):
        return False
    for e in range(size):
        i = pixels[e]
        after = known.first[i] * growth[e]
        jumps[e] = (after - known.estimate[i]) / known.active_count if known.active[i] else 0.0
        known.estimate[i] = after
    return True


@kernel
def deviation(loops: Any, scratch: Any, known: Any, room: Any) -> float:
    """Mean estimate of the active pixels less its target.

    Parameters
    ----------
    loops, scratch, known
        See `renew`.
    room
        One double.
    """
    size = known.estimate.size
    if known.active_count == size:
        mean = total(loops.add, scratch, known.estimate, size, room) / size
    else:
        chosen = known.estimate[known.active]
        mean = total(loops.add, scratch, chosen, chosen.size, room) / chosen.size
    return float(mean - known.target)


@kernel
def _responses(loops: Any, scratch: Any, control: Any, ages_ns: Any) -> Any:
    """``int_0^t exp(A s) b ds`` for every age, as `HeldInputResponse.response`, shape (E, k)."""
    size, k = ages_ns.size, control.poles.size
    exponents = np.empty((size, k), np.complex128)
    growth = np.empty((size, k), np.complex128)
    for e in range(size):
        seconds = ages_ns[e] * control.nanosecond_s
        for j in range(k):
            exponents[e, j] = complex(
                control.poles[j].real * seconds, control.poles[j].imag * seconds
            )
    if control.real:
        plain = np.empty((size, k))
        for e in range(size):
            for j in range(k):
                plain[e, j] = exponents[e, j].real
        unary(loops.expm1, scratch, plain, plain, size * k, _DOUBLE)
        for e in range(size):
            for j in range(k):
                pole = control.poles[j].real
                scaled = ages_ns[e] * control.nanosecond_s if pole == 0 else plain[e, j] / pole
                growth[e, j] = complex(scaled, 0.0)
    else:
        safe = np.empty(k, np.complex128)
        for j in range(k):
            safe[j] = 1.0 if control.poles[j] == 0 else control.poles[j]
        unary(loops.complex_expm1, scratch, exponents, exponents, size * k, _COMPLEX)
        for e in range(size):
            binary(loops.complex_divide, scratch, exponents[e], safe, growth[e], k)
            for j in range(k):
                if control.poles[j] == 0:
                    growth[e, j] = complex(ages_ns[e] * control.nanosecond_s, 0.0)
    for e in range(size):
        binary(loops.complex_multiply, scratch, growth[e], control.modal_input, exponents[e], k)
    product(
        loops.complex_matmul,
        scratch,
        exponents,
        control.vectors,
        growth,
        size,
        k,
        k,
        control.turned,
    )
    responses = np.empty((size, k))
    for e in range(size):
        for j in range(k):
            responses[e, j] = growth[e, j].real
    return responses


@kernel
def advance(loops: Any, scratch: Any, control: Any, gap: int, room: Any) -> None:
    """Advance K over periods in which the estimate holds its last value.

    Parameters
    ----------
    loops, scratch
        See `renew`.
    control
        `layout.ControlArrays`.
    gap
        Number of periods less one.
    room
        Shape (k,).
    """
    k = control.state.size
    product(loops.matmul, scratch, control.transitions[gap], control.state, room, k, k, 1, False)
    for j in range(k):
        control.state[j] = room[j] + control.gains[gap, j] * control.deviation[0]


@kernel
def jump(loops: Any, scratch: Any, control: Any, jumps: Any, ages_ns: Any, room: Any) -> None:
    """Add what the jumps of the mean estimate have led to by now.

    Parameters
    ----------
    loops, scratch, control, room
        See `advance`.
    jumps
        Jump at every event, shape (E,).
    ages_ns
        Time since each, ns, shape (E,).
    """
    k = control.state.size
    responses = _responses(loops, scratch, control, ages_ns)
    product(loops.matmul, scratch, jumps, responses, room, 1, jumps.size, k, False)
    for j in range(k):
        control.state[j] = control.state[j] + room[j]


@kernel
def command(loops: Any, scratch: Any, control: Any, out: Any) -> None:
    """``u_o``, shape (m,).

    Parameters
    ----------
    loops, scratch, control
        See `advance`.
    out
        Out: shape (m,).
    """
    m, k = control.output.shape
    product(loops.matmul, scratch, control.output, control.state, out, m, k, 1, False)
    for j in range(m):
        u = out[j] + control.feedthrough[j] * control.deviation[0]
        u = u + control.feedforward[j]
        out[j] = u
