"""The closed-loop hybrid automaton of the paper, run exactly from event to event."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from dvs_common.arrays import FloatArray, finite_array
from dvs_common.errors import ParameterError
from dvs_common.scenario.reference_bounds import threshold_step
from dvs_simulation.exact.compilation import load_kernel, numba_available
from dvs_simulation.exact.kernel import layout
from dvs_simulation.exact.loop import ClosedLoop
from dvs_simulation.exact.modes import ModalForm, modal_form
from dvs_simulation.exact.trajectory import Outcome, Status, Tail, Trajectory

DEFAULT_EVENT_RATE = 1e6
DEFAULT_MAX_EVENTS = 50_000_000
_POWER_HALF = 1024
_BUFFER = 1 << 16
_DIVERGENCE = 1e9


def simulate(
    loop: ClosedLoop,
    *,
    duration: float,
    sample_times: ArrayLike = (),
    tail_start: float | None = None,
    tail_step: float | None = None,
    record_events: bool = True,
    max_event_rate: float = DEFAULT_EVENT_RATE,
    max_events: int = DEFAULT_MAX_EVENTS,
    compiled: bool | None = None,
) -> Trajectory:
    """Run the loop over (0, duration].

    Parameters
    ----------
    loop
        The loop and its initial conditions.
    duration
        Length of the run, s.
    sample_times
        Instants in [0, duration] at which the state is wanted, ascending; they do not disturb the
        run: the events are the same with and without them.
    tail_start
        If given, the error is watched from there on.
    tail_step
        Longest step while the error is watched, s; default a 2000th of the tail.
    record_events
        False keeps only their number.
    max_event_rate
        Guard against Zeno behaviour: events per second of one pixel, over a hundred events.
    max_events
        The run stops there.
    compiled
        Whether the inner loop is compiled by numba; default: if numba is installed.

    Returns
    -------
    Trajectory
        Also when a guard stopped the run: see its `outcome`.

    Raises
    ------
    ParameterError
        If a time or a limit is out of range.
    """
    times = _sample_times(sample_times, duration)
    if max_events < 1:
        raise ParameterError('max_events', max_events, 'must be >= 1')
    constants = _constants(loop, duration, tail_start, tail_step, max_event_rate)
    kernel = load_kernel(compiled=numba_available() if compiled is None else compiled)
    form = modal_form(_system_matrix(loop))
    modes, constants = _modes(loop, form, constants)
    pixels = _pixels(loop)
    upper, lower = _heaps(pixels, constants)
    state = np.zeros((6, len(form.basis)))
    deviation = loop.initial_state - loop.equilibrium.state
    state[layout.ETA] = form.to_modal(np.concatenate([deviation, _rest(loop)]))
    clock = _clock(loop, pixels, duration)
    tally = np.zeros(layout.TALLY_SIZE, dtype=np.int64)
    samples = layout.Samples(times, np.zeros((times.size, len(form.basis))), np.zeros(times.size))
    size = _BUFFER if record_events else 1 << 10
    events = layout.Events(np.empty(size), np.empty((size, 3), dtype=np.int32))
    chunks: list[tuple[np.ndarray, ...]] = []
    arguments = [
        tuple(item) if isinstance(item, tuple) else item
        for item in (modes, pixels, upper, lower, state, clock, tally, events, samples, constants)
    ]
    while True:
        result = int(kernel.run(*arguments))
        if record_events and (k := int(tally[layout.BUFFERED])):
            chunks.append(tuple(column[:k].copy() for column in events))
        tally[layout.BUFFERED] = 0
        if result != layout.FULL or tally[layout.EVENTS] >= max_events:
            break
    return _trajectory(loop, form, pixels, samples, clock, tally, chunks, constants, result)


def _sample_times(sample_times: ArrayLike, duration: float) -> FloatArray:
    if not 0 < duration < math.inf:
        raise ParameterError('duration', duration, 'must be > 0 and finite')
    times = finite_array('sample_times', sample_times, ndim=1)
    if times.size and (times[0] < 0 or times[-1] > duration or np.any(np.diff(times) < 0)):
        raise ParameterError(
            'sample_times', [times[0], times[-1]], f'must ascend within [0, {duration:g}]'
        )
    return np.array(times)


def _constants(
    loop: ClosedLoop,
    duration: float,
    tail_start: float | None,
    tail_step: float | None,
    max_event_rate: float,
) -> layout.Constants:
    if not max_event_rate > 0:
        raise ParameterError('max_event_rate', max_event_rate, 'must be > 0')
    if tail_start is not None and not 0 <= tail_start < duration:
        raise ParameterError('tail_start', tail_start, f'must lie in [0, {duration:g})')
    start = math.inf if tail_start is None else float(tail_start)
    step = (duration - start) / 2000 if tail_step is None else float(tail_step)
    if tail_start is not None and not step > 0:
        raise ParameterError('tail_step', tail_step, 'must be > 0')
    return layout.Constants(
        offset=float(loop.model.gradient @ loop.equilibrium.state),
        growth=0.0,
        log_step=threshold_step(loop.event_threshold, loop.log_base),
        dead_band=float(loop.dead_band) if loop.photoreceptor == 'signed_log' else 0.0,
        end=float(duration),
        tail_start=start,
        tail_step=step,
        event_rate=float(max_event_rate),
        divergence=_DIVERGENCE * max(1.0, float(np.max(np.abs(loop.initial_luminosity())))),
    )


def _rest(loop: ClosedLoop) -> FloatArray:
    return np.zeros(loop.controller.order)


def _system_matrix(loop: ClosedLoop) -> FloatArray:
    """F of ``(x - x_d, xc)' = F (x - x_d, xc) + g e + drift`` between events."""
    n, k = loop.model.state_count, loop.controller.order
    matrix = np.zeros((n + k, n + k))
    matrix[:n, :n] = loop.model.state_matrix
    matrix[:n, n:] = loop.model.input_matrix @ loop.controller.output_matrix
    matrix[n:, n:] = loop.controller.state_matrix
    return matrix


def _modes(
    loop: ClosedLoop, form: ModalForm, constants: layout.Constants
) -> tuple[layout.Modes, layout.Constants]:
    """Modal system, and the constants with its largest growth rate."""
    model, controller, held = loop.model, loop.controller, loop.equilibrium
    p, q, n = form.real_poles.size, form.pair_decay.size, model.state_count
    forcing = np.concatenate(
        [model.input_matrix @ controller.feedthrough, controller.input_vector]
    )
    applied = held.feedforward if loop.load is None else held.feedforward + loop.load
    residual = model.state_matrix @ held.state + model.input_matrix @ applied
    error_basis = np.ascontiguousarray(form.basis[:n])
    if loop.error_weights is not None:
        error_basis = loop.error_weights[:, None] * error_basis
    modal = np.zeros((layout.MODAL_ROWS, len(form.basis)))
    modal[layout.POLE, :p] = form.real_poles
    modal[layout.WEIGHT] = form.output(np.concatenate([model.gradient, _rest(loop)]))
    modal[layout.FORCING] = form.to_modal(forcing)
    modal[layout.DRIFT] = form.to_modal(np.concatenate([residual, _rest(loop)]))
    modal[layout.ERROR_SIZE] = np.linalg.norm(error_basis, axis=0)
    pair = slice(p, p + 2 * q, 2)
    modal[layout.POLE, pair] = form.pair_decay
    modal[layout.FREQUENCY, pair] = form.pair_frequency
    modal[layout.MODULUS, pair] = np.hypot(form.pair_decay, form.pair_frequency)
    weights = modal[layout.WEIGHT, p : p + 2 * q]
    modal[layout.PAIR_WEIGHT, pair] = np.hypot(weights[::2], weights[1::2])
    edge, dense, bound = _dense(form, modal[layout.WEIGHT], p + 2 * q)
    shape = np.array([p, q, len(dense), *edge], dtype=np.int64)
    poles = [0.0, *form.real_poles, *form.pair_decay, *bound[:, layout.LOG_NORM]]
    return (
        layout.Modes(shape, modal, dense, bound, error_basis),
        constants._replace(growth=float(max(poles))),
    )


def _dense(
    form: ModalForm, weight: FloatArray, first: int
) -> tuple[np.ndarray, FloatArray, FloatArray]:
    """Edges, padded matrices and bounds of the blocks that could not be split."""
    sizes = [len(block) for block in form.dense_blocks]
    edge = first + np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    matrix = np.zeros((len(sizes), max(sizes, default=0), max(sizes, default=0)))
    bound = np.zeros((len(sizes), 4))
    for j, block in enumerate(form.dense_blocks):
        k = len(block)
        matrix[j, :k, :k] = block
        v = weight[edge[j] : edge[j] + k]
        bound[j, layout.LOG_NORM] = np.linalg.eigvalsh((block + block.T) / 2)[-1]
        bound[j, layout.NORM_0] = np.linalg.norm(v)
        bound[j, layout.NORM_1] = np.linalg.norm(v @ block)
        bound[j, layout.NORM_2] = np.linalg.norm(v @ block @ block)
    return edge, matrix, bound


def _pixels(loop: ClosedLoop) -> layout.Pixels:
    r = loop.pixel_count
    step = threshold_step(loop.event_threshold, loop.log_base)
    half = min(_POWER_HALF, int(600 / step))
    negative = (loop.photoreceptor == 'signed_log') & (loop.initial_luminosity() < 0)
    pixel = np.zeros((r, 4))
    pixel[:, layout.REFERENCE] = loop.reference
    pixel[:, layout.OFFSET] = loop.scene.brightness_offsets
    pixel[:, layout.ESTIMATE] = loop.sector().initial_estimate
    pixel_state = np.zeros((r, 3), dtype=np.int64)
    pixel_state[:, layout.SIGN] = np.where(negative, -1, 1)
    return layout.Pixels(pixel, pixel_state, np.exp(np.arange(-half, half + 1) * step))


def _heaps(pixels: layout.Pixels, constants: layout.Constants) -> tuple[layout.Heap, layout.Heap]:
    """Next thresholds above, and the negatives of those below."""
    reference, offset = pixels.pixel[:, layout.REFERENCE], pixels.pixel[:, layout.OFFSET]
    positive = pixels.pixel_state[:, layout.SIGN] > 0
    outer = reference * np.exp(constants.log_step)
    inner = reference * np.exp(-constants.log_step)
    inner = np.where(inner < constants.dead_band, -constants.dead_band, inner)
    above = np.where(positive, outer, -inner) - offset
    below = np.where(positive, inner, -outer) - offset
    return _sorted_heap(above), _sorted_heap(-below)


def _sorted_heap(keys: FloatArray) -> layout.Heap:
    """A sorted array is a heap."""
    order = np.argsort(keys, kind='stable').astype(np.int32)
    place = np.empty_like(order)
    place[order] = np.arange(order.size, dtype=np.int32)
    return layout.Heap(keys[order], order, place)


def _clock(loop: ClosedLoop, pixels: layout.Pixels, duration: float) -> FloatArray:
    clock = np.zeros(layout.CLOCK_SIZE)
    estimate = pixels.pixel_state[:, layout.SIGN] * pixels.pixel[:, layout.ESTIMATE]
    terms = np.concatenate([estimate, -loop.set_point_luminosity()])
    clock[layout.SUM] = math.fsum(terms)
    clock[layout.SUM_LOW] = math.fsum([*terms, -clock[layout.SUM]])
    clock[layout.STEP] = duration
    clock[layout.ERROR] = -1.0
    return clock


def _trajectory(
    loop: ClosedLoop,
    form: ModalForm,
    pixels: layout.Pixels,
    samples: layout.Samples,
    clock: FloatArray,
    tally: np.ndarray,
    chunks: list[tuple[np.ndarray, ...]],
    constants: layout.Constants,
    result: int,
) -> Trajectory:
    time, pixel, polarity, sign = _ordered_events(chunks)
    taken = int(tally[layout.SAMPLE])
    n = loop.model.state_count
    full = samples.eta[:taken] @ form.basis.T
    drive = samples.drive[:taken]
    controller = loop.controller
    inputs = full[:, n:] @ controller.output_matrix.T + np.outer(drive, controller.feedthrough)
    return Trajectory(
        event_time=time,
        event_pixel=pixel,
        event_polarity=polarity,
        event_sign=sign,
        event_count=int(tally[layout.EVENTS]),
        counts=pixels.pixel_state[:, layout.COUNT].copy(),
        signs=pixels.pixel_state[:, layout.SIGN].astype(np.int8),
        sample_time=samples.time[:taken],
        states=full[:, :n] + loop.equilibrium.state,
        controller_states=full[:, n:],
        drive=drive,
        inputs=inputs + loop.equilibrium.feedforward,
        tail=_tail(clock, constants),
        outcome=_outcome(result, clock, tally, constants),
        evaluations=int(tally[layout.EVALUATIONS]),
    )


def _ordered_events(
    chunks: list[tuple[np.ndarray, ...]],
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    if not chunks:
        return np.empty(0), np.empty(0, np.int32), np.empty(0, np.int8), np.empty(0, np.int8)
    time, code = (np.concatenate(parts) for parts in zip(*chunks, strict=True))
    if np.any(time[1:] == time[:-1]):
        order = np.lexsort((code[:, 0], time))
        time, code = time[order], code[order]
    small = code[:, 1:].astype(np.int8)
    return time, code[:, 0].copy(), small[:, 0].copy(), small[:, 1].copy()


def _tail(clock: FloatArray, constants: layout.Constants) -> Tail | None:
    length = clock[layout.TIME] - constants.tail_start
    if not length > 0:
        return None
    return Tail(
        start=constants.tail_start,
        peak=float(clock[layout.PEAK]),
        peak_bound=float(clock[layout.PEAK_BOUND]),
        mean=float(clock[layout.INTEGRAL] / length),
    )


def _outcome(
    result: int, clock: FloatArray, tally: np.ndarray, constants: layout.Constants
) -> Outcome:
    time = float(clock[layout.TIME])
    events = int(tally[layout.EVENTS])
    pixel = int(tally[layout.CULPRIT]) if result == layout.ZENO else -1
    status: dict[int, Status] = {
        layout.DONE: 'completed',
        layout.FULL: 'max_events',
        layout.ZENO: 'zeno',
        layout.DIVERGED: 'diverged',
    }
    message = {
        layout.DONE: f'reached {time:g} s with {events} events',
        layout.FULL: f'stopped at {time:.9g} s after {events} events: raise max_events to go on',
        layout.ZENO: f'stopped at {time:.9g} s: pixel {pixel} fired {layout.WINDOW} times faster '
        f'than max_event_rate = {constants.event_rate:g} events/s. Its luminosity nears 0, where '
        'a logarithmic pixel fires without end, or event_threshold is too small',
        layout.DIVERGED: f'stopped at {time:.9g} s: the luminosity left all bounds; the loop is '
        'unstable at this event_threshold',
    }
    return Outcome(status=status[result], time=time, pixel=pixel, message=message[result])
