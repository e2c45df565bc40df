"""What a live page shows: turns the streams of a running loop into small frames.

Receiving a message costs next to nothing; a frame decodes the few messages that it shows.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np

from dvs_closed_loop.bags.reported_budgets import reported_budgets
from dvs_common.arrays import FloatArray
from dvs_common.errors import SuiteError
from dvs_common.nanoseconds import as_seconds
from dvs_common.scenario.model import Equilibrium
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire import topics
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.events import EventPacket, parse_events
from dvs_common.wire.index_watch import IndexWatch
from dvs_common.wire.messages import (
    parse_command,
    parse_state,
)
from dvs_common.wire.stamped import stamp_of
from dvs_event_camera.streams.image_source import parse_luminosity
from dvs_hinf_controller.analysis.budget import Budget
from dvs_hinf_controller.analysis.sector import sector
from dvs_simulation.judging.measures import (
    error,
    kept,
    largest,
    regulated,
    sector_ratio,
    silent_below,
)

_SAMPLES_A_FRAME = 12
_EVENTS_A_FRAME = 400
_PIXELS_SHOWN = 16
_STATES_SHOWN = 8
_RATE_WINDOW_S = 2.0
# A few frames' worth of messages, lest a stalled page costs memory.
_MOST_WAITING = 20_000
# Where the stamp of a header is in CDR bytes.
_STAMP = slice(4, 12)

Frame = dict[str, Any]


class LiveView:
    """Gathers messages between two frames.

    Parameters
    ----------
    namespace
        Namespace of the loop, by which its controller is found among others on /diagnostics.
    """

    def __init__(self, namespace: str = '') -> None:
        self._namespace = namespace
        self._budget: Budget | None = None
        self._received: dict[str, deque[bytes]] = {
            topic: deque(maxlen=_MOST_WAITING)
            for topic in (topics.LUMINOSITY, topics.EVENTS, topics.COMMAND, topics.STATE)
        }
        self._estimates: deque[tuple[bytes, bytes]] = deque(maxlen=_MOST_WAITING)
        self._newest_packet = b''
        self._luminosities: dict[bytes, bytes] = {}
        self._marks: deque[tuple[float, int, int, int]] = deque()
        self._scenario: Scenario | None = None
        self._bound: FloatArray | None = None
        self._equilibrium: Equilibrium | None = None
        self._weights: FloatArray | None = None
        self._begins = False
        self._forget()

    def _forget(self) -> None:
        self._index = IndexWatch()
        self._start_ns: int | None = None
        self._newest_ns = 0
        self._commands = 0
        self._luminosities.clear()
        self._marks.clear()

    def begin(self) -> None:
        """Begin a new run, of whose scenario nothing is known yet."""
        self._drop_waiting()
        self._newest_packet = b''
        self._scenario = self._budget = self._equilibrium = self._bound = None
        self._begins = True
        self._forget()

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics to subscribe to."""
        return (*self._received, topics.ESTIMATE, topics.DIAGNOSTICS)

    @property
    def has_news(self) -> bool:
        """Whether anything was received since the last frame."""
        return any(self._received.values())

    def receive(self, topic: str, message: bytes) -> None:
        """Keep a message for the next frame.

        Parameters
        ----------
        topic
            One of `topics`.
        message
            CDR bytes.
        """
        if topic == topics.ESTIMATE:
            # An estimate has no stamp: it answers the newest packet.
            self._estimates.append((self._newest_packet, message))
            return
        if topic == topics.DIAGNOSTICS:
            for budget in reported_budgets([message], self._namespace):
                self._budget = budget
            return
        if topic == topics.EVENTS:
            self._newest_packet = message
        self._received[topic].append(message)

    def frame(self, scenario: Scenario | None, wall_s: float) -> Frame:
        """What happened since the last frame, ready for JSON.

        Parameters
        ----------
        scenario
            Parameters of the loop as far as they are known.
        wall_s
            Wall-clock time, s.
        """
        received = {topic: list(messages) for topic, messages in self._received.items()}
        estimates = list(self._estimates)
        self._drop_waiting()
        try:
            return self._frame(received, estimates, scenario, wall_s)
        except MessageError as error:
            return {'fault': f'a message breaks the wire contract: {error}'}

    def _drop_waiting(self) -> None:
        for waiting in self._received.values():
            waiting.clear()
        self._estimates.clear()

    def _frame(
        self,
        received: dict[str, list[bytes]],
        estimates: list[tuple[bytes, bytes]],
        scenario: Scenario | None,
        wall_s: float,
    ) -> Frame:
        self._know(scenario)
        packets = [parse_events(message) for message in received[topics.EVENTS]]
        restarted = self._follow_time(received[topics.STATE], packets) or self._begins
        self._begins = False
        for packet in packets:
            self._index.take(packet)
        self._commands += len(received[topics.COMMAND])
        states = [parse_state(message) for message in _thinned(received[topics.STATE])]
        commands = [parse_command(message) for message in _thinned(received[topics.COMMAND])]
        pixels, samples, ratio = self._pixel_samples(received[topics.LUMINOSITY], estimates)
        errors = self._errors(states)
        frame: Frame = {
            'restart': restarted,
            'time': self._seconds(self._newest_ns),
            'state': [
                [self._seconds(v.stamp_ns), *_rounded(v.values[:_STATES_SHOWN])] for v in states
            ],
            'error': [[when, _shown(size)] for when, size in errors],
            'within_tolerance': self._within_tolerance(errors[-1][1] if errors else None),
            'command': [[self._seconds(v.stamp_ns), *_rounded(v.values)] for v in commands],
            'pixels': pixels,
            'samples': samples,
            'ratio': None if ratio is None else _shown(ratio),
            'in_sector': None if ratio is None else bool(kept(ratio)),
            **self._event_marks(packets),
            **self._figures(wall_s),
        }
        if self._budget is not None:
            frame['certificate'] = str(self._budget)
            frame['certified'] = self._budget.is_certified
        if self._scenario is not None:
            frame['scenario'] = _described(self._scenario, self._equilibrium)
        return frame

    # -- what is known of the scenario ----------------------------------------------------------

    def _know(self, scenario: Scenario | None) -> None:
        if scenario is None or scenario == self._scenario:
            return
        self._scenario = scenario
        self._equilibrium = self._bound = None
        try:
            self._equilibrium = scenario.equilibrium
            self._weights = scenario.error_weights
            self._bound = np.asarray(
                sector(
                    scenario.model_reference_bounds,
                    event_threshold=scenario.sensor.event_threshold,
                    log_base=scenario.sensor.log_base,
                ).error_bound
            )
        except SuiteError:
            # What does not fit together is refused by the nodes; the rest of the page goes on.
            return

    # -- time -----------------------------------------------------------------------------------

    def _follow_time(self, states: list[bytes], packets: list[EventPacket]) -> bool:
        """Move on to the newest stamp; a stamp before the last one begins a new run."""
        stamps = [stamp_of(message) for message in (*states[:1], *states[-1:])]
        stamps += [packet.stamp_ns for packet in (*packets[:1], *packets[-1:])]
        if not stamps:
            return False
        newest = stamps[-1] if packets else max(stamps)
        restarted = self._start_ns is not None and newest < self._newest_ns
        if restarted:
            self._forget()
        if self._start_ns is None:
            self._start_ns = newest if restarted else min(stamps)
        self._newest_ns = max(newest, self._newest_ns)
        return restarted

    def _seconds(self, stamp_ns: int) -> float:
        return round(as_seconds(stamp_ns - (self._start_ns or 0)), 6)

    # -- signals --------------------------------------------------------------------------------

    def _errors(self, states: list[Any]) -> list[list[float]]:
        held = self._equilibrium
        if held is None:
            return []
        return [
            [self._seconds(v.stamp_ns), float(error(v.values, held, self._weights))]
            for v in states
            if v.values.shape == held.state.shape
        ]

    def _within_tolerance(self, newest_error: float | None) -> bool | None:
        if newest_error is None or self._scenario is None:
            return None
        return regulated(newest_error, self._scenario.objective.tolerance)

    def _pixel_samples(
        self, luminosities: list[bytes], estimates: list[tuple[bytes, bytes]]
    ) -> tuple[list[int], list[list[Any]], float | None]:
        """Chosen pixels, their y and z at some instants, and the worst sector ratio there."""
        self._luminosities.update({message[_STAMP]: message for message in luminosities})
        pixels: list[int] = []
        samples = []
        worst: float | None = None
        for packet, estimate in _thinned(estimates):
            image = self._luminosities.get(packet[_STAMP])
            if image is None:
                continue
            y = parse_luminosity(image).pixels.reshape(-1).astype(np.float64)
            z = parse_state(estimate).values
            if len(y) != len(z) or not len(y):
                continue
            count = min(len(y), _PIXELS_SHOWN)
            pixels = [round(k * (len(y) - 1) / max(count - 1, 1)) for k in range(count)]
            samples.append(
                [
                    self._seconds(stamp_of(packet)),
                    _rounded(y[pixels]),
                    _rounded(z[pixels]),
                ]
            )
            ratio = self._ratio(y, z)
            if ratio is not None:
                worst = ratio if worst is None else max(worst, ratio)
        for stamp in list(self._luminosities)[:-_SAMPLES_A_FRAME]:
            del self._luminosities[stamp]
        return pixels, samples, worst

    def _ratio(self, y: FloatArray, z: FloatArray) -> float | None:
        scenario, bound = self._scenario, self._bound
        if scenario is None or bound is None or bound.size not in (1, y.size):
            return None
        return largest(sector_ratio(y, z, error_bound=bound, dead_band=silent_below(scenario)))

    def _event_marks(self, packets: list[EventPacket]) -> Frame:
        full = [packet for packet in packets if len(packet.events)]
        count = sum(len(packet.events) for packet in full)
        stride = max(1, -(-count // _EVENTS_A_FRAME))
        width = self._scenario.pixels.pixel_grid[1] if self._scenario is not None else None
        marks = []
        offset = 0
        for packet in full:
            chosen = packet.events[(-offset) % stride :: stride]
            offset += len(packet.events)
            columns = width or 1 + int(packet.events['x'].max())
            for event in chosen.tolist():
                # A label may follow.
                x, y, t, _, polarity = event[:5]
                marks.append([self._seconds(packet.stamp_ns + t), y * columns + x, polarity])
        return {'events': marks, 'events_a_mark': stride}

    # -- figures --------------------------------------------------------------------------------

    def _figures(self, wall_s: float) -> Frame:
        mark = (wall_s, self._newest_ns, self._commands, self._index.events)
        self._marks.append(mark)
        while wall_s - self._marks[0][0] > _RATE_WINDOW_S:
            self._marks.popleft()
        oldest = self._marks[0]
        seconds = max(mark[0] - oldest[0], 1e-9)
        return {
            'real_time_factor': round(as_seconds(mark[1] - oldest[1]) / seconds, 3),
            'cycles_per_second': round((mark[2] - oldest[2]) / seconds, 1),
            'events_per_second': round((mark[3] - oldest[3]) / seconds, 1),
            'total_events': self._index.events,
            'on_events': self._index.on_events,
            'lost_events': self._index.lost,
            'camera_restarts': self._index.restarts,
        }


def _thinned(messages: list[Any]) -> list[Any]:
    """Return at most `_SAMPLES_A_FRAME` of them, evenly, the last one among them."""
    if len(messages) <= _SAMPLES_A_FRAME:
        return messages
    stride = len(messages) / _SAMPLES_A_FRAME
    return [messages[round((k + 1) * stride) - 1] for k in range(_SAMPLES_A_FRAME)]


def _rounded(values: FloatArray) -> list[float | None]:
    return [_shown(value) for value in values.tolist()]


def _shown(value: float) -> float | None:
    """A number in six digits; JSON has none that is not finite."""
    return float(f'{value:.6g}') if math.isfinite(value) else None


def _described(scenario: Scenario, equilibrium: Equilibrium | None) -> Frame:
    height, width = scenario.pixels.pixel_grid
    return {
        'set_point': equilibrium.state.tolist() if equilibrium else None,
        'tolerance': scenario.objective.tolerance,
        'event_threshold': scenario.sensor.event_threshold,
        'pixels': height * width,
        'mode': scenario.loop.mode,
        'method': scenario.controller.method,
        'duration': scenario.loop.duration,
    }
