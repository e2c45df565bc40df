"""Tool `simulate_video`: a video or a folder of pictures in, a file of events out. No ROS."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from dvs_common.errors import ParameterError
from dvs_common.nanoseconds import as_nanoseconds, as_seconds
from dvs_common.output_folder import output_file
from dvs_common.scenario.parameter_file import read_parameter_file
from dvs_common.scenario.presets import PRESETS
from dvs_common.scenario.scenario import Scenario
from dvs_event_camera.event_camera import EventCamera
from dvs_event_camera.files.damage import DamagedFile
from dvs_event_camera.files.writers import LazyWriter, format_of
from dvs_event_camera.pixels.pixel_events import PixelEvents
from dvs_event_camera.streams.image_source import LuminosityFrame, darkest_of
from dvs_event_camera.streams.renderer import EventRenderer
from dvs_event_camera.streams.sensor_events import SensorEvents
from dvs_event_camera.tools.footage import Footage, open_footage
from dvs_event_camera.tools.frame_interpolation import interpolated


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Command line of `simulate_video`.

    Parameters
    ----------
    parser
        Parser of the subcommand.
    """
    parser.add_argument('source', type=Path, help='a video file, or a folder of pictures')
    parser.add_argument(
        '--output',
        type=Path,
        default=Path('out'),
        help='folder of the results (out), or the file: .h5, .npz, .csv, .txt, .aedat4 or .npy',
    )
    parser.add_argument('--preset', default='ideal', help=f'{", ".join(PRESETS)} (default: ideal)')
    parser.add_argument('--threshold', type=float, help="event threshold h (default: preset's)")
    parser.add_argument(
        '--params-file', type=Path, help='parameters of event_camera, stronger than the preset'
    )
    parser.add_argument(
        '--rate', type=float, help="frames/s (default: those of the file or the folder's stamps)"
    )
    parser.add_argument(
        '--interpolate',
        type=int,
        default=1,
        metavar='N',
        help='N times as many frames by optical flow, which is an approximation',
    )
    parser.add_argument('--preview', type=Path, help='video of the events, .mp4 or .avi')
    parser.add_argument('--figure', type=Path, help='figure of the rates, .png or .svg')


def run(options: argparse.Namespace) -> int:
    """Simulate, write and report.

    Parameters
    ----------
    options
        From the command line.

    Raises
    ------
    DamagedFile
        At the end, if not all frames could be decoded.
    ParameterError
        If an option makes no sense or a file can't be read.
    """
    scenario = _scenario(options)
    camera = EventCamera.of_scenario(scenario)
    if options.interpolate < 1:
        raise ParameterError('interpolate', options.interpolate, 'must be >= 1')
    if options.rate is not None and not 0 < options.rate <= 1e6:
        raise ParameterError('rate', options.rate, 'must be > 0 and <= 1e6 frames/s')
    output = _event_file(options)
    name = format_of(output, None)
    footage = open_footage(options.source)
    if options.rate is None and footage.rate is None and not footage.stamps_ns:
        raise ParameterError('rate', None, 'must be given: the pictures have no times')
    tally = Tally()
    began = time.perf_counter()
    writer: LazyWriter | None = None
    preview: _Preview | None = None
    damage: DamagedFile | None = None
    try:
        for stamp_ns, frame in _frames(footage, options):
            writer = writer or _writer(output, name, frame)
            preview = preview or _Preview.of(options, footage, frame)
            exposure = camera.take(
                LuminosityFrame(stamp_ns=stamp_ns, pixels=frame, darkest=darkest_of(frame.dtype))
            )
            if exposure is None:
                continue
            if exposure.restart_reason:
                tqdm.write(f'started again: {exposure.restart_reason}', file=sys.stderr)
            writer.add(
                _sensor_events(
                    exposure.events, frame.shape[1], labelled=scenario.camera.label_noise
                )
            )
            tally.add(stamp_ns, exposure.events)
            if preview is not None:
                preview.add(exposure.events, stamp_ns)
    except DamagedFile as error:
        damage = error
    if writer is None:
        reason = f': {damage.reason}' if damage else ''
        raise ParameterError(
            'source', options.source, f'has no frames that can be decoded{reason}'
        )
    writer.close()
    if preview is not None:
        preview.close()
    if options.figure:
        _draw_rates(options.figure, tally)
    print(tally.summary(time.perf_counter() - began))
    print(f'events: {output}')
    if damage:
        raise damage
    return 0


def _scenario(options: argparse.Namespace) -> Scenario:
    values: dict[str, Any] = {'mode': 'realtime', 'preset': options.preset}
    if options.params_file:
        values.update(read_parameter_file(options.params_file).values_of('/event_camera'))
    if options.threshold is not None:
        values['event_threshold'] = options.threshold
    return Scenario.from_values(values)


def _event_file(options: argparse.Namespace) -> Path:
    output: Path = options.output
    if output.suffix and not output.is_dir():
        return output
    return output_file(output, f'{options.source.stem}.h5')


def _frames(footage: Footage, options: argparse.Namespace) -> Iterator[tuple[int, NDArray[Any]]]:
    stamped = footage.stamped(options.rate)
    if options.interpolate > 1:
        stamped = interpolated(stamped, options.interpolate)
    total = max(0, (footage.count - 1) * options.interpolate + 1) if footage.count else None
    return iter(tqdm(stamped, total=total, unit='frame', disable=None, file=sys.stderr))


def _writer(path: Path, name: str, frame: NDArray[Any]) -> LazyWriter:
    height, width = frame.shape
    return LazyWriter(path, name, width=width, height=height, whole_microseconds=False)


def _sensor_events(events: PixelEvents, width: int, *, labelled: bool) -> SensorEvents:
    noise = events.noise if events.noise is not None else np.zeros(len(events))
    row, column = np.divmod(events.pixel, np.int32(width))
    return SensorEvents(
        t=events.t,
        x=column.astype(np.uint16),
        y=row.astype(np.uint16),
        p=(events.polarity > 0).astype(np.uint8),
        noise=noise.astype(np.uint8) if labelled else None,
    )


class Tally:
    """Events a frame, for the summary and the figure.

    Attributes
    ----------
    stamps_ns
        Times of the frames, ns.
    on, off
        ON and OFF events of the interval that each frame ends.
    """

    def __init__(self) -> None:
        self.stamps_ns: list[int] = []
        self.on: list[int] = []
        self.off: list[int] = []

    def add(self, stamp_ns: int, events: PixelEvents) -> None:
        """Count the events of an interval.

        Parameters
        ----------
        stamp_ns
            Its end, ns.
        events
            Its events.
        """
        on = int(np.count_nonzero(events.polarity > 0))
        self.stamps_ns.append(stamp_ns)
        self.on.append(on)
        self.off.append(len(events) - on)

    def summary(self, seconds: float) -> str:
        """Frames, events and rates in a line.

        Parameters
        ----------
        seconds
            Time that it took, s.
        """
        events = sum(self.on) + sum(self.off)
        duration = as_seconds(self.stamps_ns[-1] - self.stamps_ns[0])
        rate = f', {events / duration:.4g} events/s' if duration else ''
        share = f', {sum(self.on) / events:.1%} ON' if events else ''
        return (
            f'{len(self.stamps_ns)} frames in {duration:.6g} s: {events} events{rate}{share} '
            f'({seconds:.1f} s of computing)'
        )


class _Preview:
    """Video of the events, one picture a frame of the source."""

    def __init__(self, path: Path, rate: float, frame: NDArray[Any], period_ns: int) -> None:
        try:
            cv2: Any = import_module('cv2')
        except ImportError:
            raise ParameterError('preview', path, 'needs OpenCV') from None
        height, width = frame.shape
        code = cv2.VideoWriter_fourcc(*('MJPG' if path.suffix.lower() == '.avi' else 'mp4v'))
        self._video = cv2.VideoWriter(str(path), code, rate, (width, height), True)
        if not self._video.isOpened():
            raise ParameterError('preview', path, 'can not be written as a video (.mp4, .avi)')
        self._renderer = EventRenderer(height, width)
        self._period_ns, self._next_ns = period_ns, 0

    @classmethod
    def of(
        cls, options: argparse.Namespace, footage: Footage, frame: NDArray[Any]
    ) -> _Preview | None:
        if options.preview is None:
            return None
        rate = options.rate or footage.rate
        if rate is None:
            span = as_seconds(footage.stamps_ns[-1] - footage.stamps_ns[0])
            rate = (len(footage.stamps_ns) - 1) / span if span else 1.0
        return cls(options.preview, min(rate, 60.0), frame, as_nanoseconds(1 / rate))

    def add(self, events: PixelEvents, stamp_ns: int) -> None:
        self._renderer.add(events, stamp_ns)
        if stamp_ns >= self._next_ns:
            self._next_ns = stamp_ns + self._period_ns // 2
            self._video.write(self._renderer.draw())

    def close(self) -> None:
        self._video.release()


def _draw_rates(path: Path, tally: Tally) -> None:
    from dvs_common.drawing import Figure, drawing

    seconds = as_seconds(np.array(tally.stamps_ns))
    periods = np.diff(seconds)
    with drawing():
        figure = Figure(figsize=(8, 3), layout='constrained')
        axes = figure.add_subplot()
        for label, counts, colour in (('ON', tally.on, 'tab:red'), ('OFF', tally.off, 'tab:blue')):
            rates = np.array(counts[1:]) / periods
            axes.stairs(rates, seconds, baseline=None, label=label, color=colour, lw=1.5)
        axes.set(xlabel='time [s]', ylabel='events/s')
        axes.legend(frameon=False)
        figure.savefig(path, dpi=120)
