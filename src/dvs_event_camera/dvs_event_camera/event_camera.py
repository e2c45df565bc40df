"""The event camera without ROS: luminosity frames in, event packets out."""

from __future__ import annotations

import functools
import secrets
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.nanoseconds import as_seconds
from dvs_common.scenario.reference_bounds import threshold_step
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire.events import INDEX_MODULUS, LONGEST_INTERVAL_NS, NO_EVENTS, EventPacket
from dvs_common.wire.keyframe import Keyframe
from dvs_event_camera.pixels.event_flood import MOST_EVENTS, EventFlood
from dvs_event_camera.pixels.pixel_array import PixelArray
from dvs_event_camera.pixels.pixel_events import PixelEvents
from dvs_event_camera.scenario_pixels import pixels_of_scenario
from dvs_event_camera.streams.event_records import records_of
from dvs_event_camera.streams.image_source import LuminosityFrame

# Time that one packet covers, so that the INT32 nanoseconds before its stamp do not overflow.
_PACKET_SPAN_NS = LONGEST_INTERVAL_NS


@dataclass(frozen=True, slots=True, kw_only=True)
class Exposure:
    """What the camera makes of one frame.

    Parameters
    ----------
    packets
        What to publish on `events`: one packet with the frame's stamp, empty or not; before it,
        if the last frame is longer ago than INT32 nanoseconds reach, those with events in them.
    events
        The same events with absolute times.
    started
        Whether this frame started the sensor.
    restart_reason
        Why the sensor was started again; empty if it was not.
    """

    packets: tuple[EventPacket, ...]
    events: PixelEvents
    started: bool
    restart_reason: str


class EventCamera:
    """Pixels that start with the first frame, and again when the source does.

    Parameters
    ----------
    make_pixels
        Makes the pixel array for a first frame, given as luminosities of shape (r,) and the
        darkest luminosity that its encoding can resolve.
    backend
        `auto`, `numba` or `numpy`.
    noise_rate
        Noise events of a pixel, 1/s: a frame may not come so late that they are millions.
    """

    def __init__(
        self,
        make_pixels: Callable[[FloatArray, float], PixelArray],
        *,
        backend: str = 'auto',
        noise_rate: float = 0.0,
    ) -> None:
        self._make_pixels = make_pixels
        self._backend = backend
        self._noise_rate = noise_rate
        self._pixels: PixelArray | None = None
        self._epoch = self._epoch_ns = self._epoch_index = 0
        # log |q / q(0)| when the present counting began.
        self._moved: FloatArray = np.zeros(1)
        self._restart_asked = ''
        self._shape: tuple[int, int] = (0, 0)
        self._index = 0
        self._invalid_before = 0

    @classmethod
    def of_scenario(
        cls,
        scenario: Scenario,
        *,
        backend: str = 'auto',
        first_reference: FloatArray | None = None,
    ) -> EventCamera:
        """Camera with the parameters of a scenario.

        Parameters
        ----------
        scenario
            All parameters.
        backend
            `auto`, `numba` or `numpy`.
        first_reference
            ``|q(0)|``, shape (r,); None for what `initial_reference` sets.

        Raises
        ------
        ParameterError
            If parameters do not fit together.
        """
        camera = cls(
            functools.partial(
                pixels_of_scenario, scenario, backend=backend, first_reference=first_reference
            ),
            backend=backend,
            noise_rate=scenario.imperfections.leak_rate + scenario.imperfections.shot_noise_rate,
        )
        pixels_of_scenario(scenario, np.ones(1), 0.0, backend, bounds=False)
        return camera

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the last frame."""
        return self._shape

    @property
    def pixels(self) -> PixelArray | None:
        """The pixel array; None before the first frame."""
        return self._pixels

    @property
    def invalid_samples(self) -> int:
        """Pixel samples without meaning since the camera was made."""
        current = 0 if self._pixels is None else self._pixels.invalid_samples
        return self._invalid_before + current

    @property
    def waiting_pixels(self) -> int:
        """Pixels that have had no light yet."""
        return 0 if self._pixels is None else self._pixels.waiting_pixels

    @property
    def event_count(self) -> int:
        """Running number of the next event."""
        return self._index

    def change_event_threshold(self, scenario: Scenario) -> None:
        """Fire at another threshold from the next frame on, and after a restart too.

        Parameters
        ----------
        scenario
            Parameters with the new threshold.

        Raises
        ------
        ParameterError
            If the pixels are not ideal ones.
        """
        self._make_pixels = functools.partial(pixels_of_scenario, scenario, backend=self._backend)
        if self._pixels is not None:
            step = threshold_step(self._pixels.event_threshold, scenario.sensor.log_base)
            moved = self._moved + self._pixels.counts * step
            self._pixels.change_event_threshold(scenario.sensor.event_threshold)
            self._moved = moved

    def restart(self, reason: str) -> None:
        """Start the sensor again with the next frame.

        Parameters
        ----------
        reason
            Why, for people.
        """
        self._restart_asked = reason

    def keyframe(self) -> Keyframe:
        """State of every pixel after the last frame; the camera must have started."""
        pixels = self._pixels
        assert pixels is not None and pixels.stamp_ns is not None
        growth = np.exp(self._moved)
        lower, upper = pixels.bounds.lower * growth, pixels.bounds.upper * growth
        lower[pixels.waiting], upper[pixels.waiting] = 0.0, np.inf
        return Keyframe(
            stamp_ns=pixels.stamp_ns,
            epoch=self._epoch,
            age_s=as_seconds(pixels.stamp_ns - self._epoch_ns),
            events=self._index - self._epoch_index,
            next_index=self._index % INDEX_MODULUS,
            event_threshold=pixels.event_threshold,
            counts=pixels.counts.astype(np.int64),
            signs=pixels.signs,
            lower=lower,
            upper=upper,
        )

    def take(self, frame: LuminosityFrame) -> Exposure | None:
        """Expose the pixels to a frame.

        A frame with the stamp of the last one is that frame, sent again: nothing happens. A frame
        that goes back in time or has another size starts the sensor again.

        Parameters
        ----------
        frame
            Luminosity and stamp.

        Returns
        -------
        Exposure
            Packets and events; None for a frame sent again.

        Raises
        ------
        ParameterError
            If the frame starts the sensor and violates (A1).
        """
        pixels = self._pixels
        reason = '' if pixels is None else self._restart_reason(pixels, frame)
        if pixels is None or reason:
            return self._start(frame, reason)
        if frame.stamp_ns == pixels.stamp_ns:
            return None
        try:
            events = pixels.update(frame.stamp_ns, frame.pixels)
        except EventFlood as flood:
            return self._start(frame, str(flood))
        return Exposure(
            packets=self._packets(frame.stamp_ns, events),
            events=events,
            started=False,
            restart_reason='',
        )

    def pass_silence(
        self, stamp_ns: int, luminosity: Sequence[float], shape: tuple[int, int]
    ) -> bool:
        """Take a frame of a few pixels if nothing but time passes with it; else do nothing.

        `take` would make an exposure without events of such a frame.

        Parameters
        ----------
        stamp_ns
            Sample time, ns.
        luminosity
            Luminosity, row-major.
        shape
            Height and width.

        Returns
        -------
        bool
            Whether the frame was taken.
        """
        pixels = self._pixels
        if pixels is None or self._restart_asked or shape != self._shape:
            return False
        return pixels.pass_silence(stamp_ns, luminosity)

    def _start(self, frame: LuminosityFrame, reason: str) -> Exposure:
        pixels = self._make_pixels(frame.pixels.reshape(-1).astype(np.float64), frame.darkest)
        pixels.update(frame.stamp_ns, frame.pixels)
        self._invalid_before = self.invalid_samples
        self._pixels, self._shape = pixels, frame.pixels.shape
        self._epoch, self._restart_asked = secrets.randbits(32), ''
        self._epoch_ns, self._epoch_index = frame.stamp_ns, self._index
        self._moved = np.zeros(pixels.bounds.lower.size)
        events = PixelEvents.empty()
        return Exposure(
            packets=self._packets(frame.stamp_ns, events),
            events=events,
            started=True,
            restart_reason=reason,
        )

    def _restart_reason(self, pixels: PixelArray, frame: LuminosityFrame) -> str:
        if self._restart_asked:
            return self._restart_asked
        if frame.pixels.shape != self._shape:
            old, new = (' x '.join(map(str, shape)) for shape in (self._shape, frame.pixels.shape))
            return f'the frames change from {old} to {new} pixels'
        last_ns = pixels.stamp_ns
        if last_ns is not None and frame.stamp_ns < last_ns:
            return (
                f'the stamps go back from {as_seconds(last_ns):.9f} s '
                f'to {as_seconds(frame.stamp_ns):.9f} s'
            )
        seconds = 0.0 if last_ns is None else as_seconds(frame.stamp_ns - last_ns)
        noise = self._noise_rate * frame.pixels.size * seconds
        # Beyond, a clock has jumped and not a sensor slept.
        if noise > MOST_EVENTS:
            return f'the stamps jump by {seconds:.6g} s, which {noise:.3g} noise events would fill'
        return ''

    def _packets(self, stamp_ns: int, events: PixelEvents) -> tuple[EventPacket, ...]:
        if not len(events):
            return (EventPacket(stamp_ns=stamp_ns, events=NO_EVENTS),)
        if stamp_ns - int(events.t[0]) <= _PACKET_SPAN_NS:
            return (self._packet(stamp_ns, events),)
        begin = int(np.searchsorted(events.t, stamp_ns - _PACKET_SPAN_NS))
        return (
            *self._earlier_packets(stamp_ns, events.take(slice(0, begin))),
            self._packet(stamp_ns, events.take(slice(begin, None))),
        )

    def _earlier_packets(self, stamp_ns: int, events: PixelEvents) -> list[EventPacket]:
        """Packets of a span each, counted back from the frame; none without events."""
        spans_before = (stamp_ns - events.t) // _PACKET_SPAN_NS
        cuts = np.flatnonzero(np.diff(spans_before)) + 1
        edges = [0, *cuts.tolist(), len(events)]
        return [
            self._packet(
                stamp_ns - int(spans_before[low]) * _PACKET_SPAN_NS, events.take(slice(low, high))
            )
            for low, high in pairwise(edges)
        ]

    def _packet(self, stamp_ns: int, events: PixelEvents) -> EventPacket:
        records = records_of(
            events,
            width=max(1, self._shape[1]),
            stamp_ns=stamp_ns,
            first_index=self._index,
            backend=self._backend,
        )
        self._index += len(events)
        return EventPacket(stamp_ns=stamp_ns, events=records)
