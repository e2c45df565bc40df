"""Node `scene`: test scenes, a video or a folder of pictures on `luminosity`."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.duration import Duration
from rclpy.node import Node
from sensor_msgs.msg import Image

from dvs_common.errors import ParameterError
from dvs_common.nanoseconds import NANOSECONDS, as_seconds
from dvs_common.node.session import own_arguments, ros_session
from dvs_common.program import StopSignal
from dvs_common.wire import topics
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.messages import pack_image
from dvs_event_camera.files.damage import DamagedFile
from dvs_event_camera.tools.footage import open_footage
from dvs_event_camera.tools.scenes import SCENES, Scene, synthetic_frames

_USAGE_ERROR = 2
# Frames a second of a source that states none.
_RATE = 100.0
# Longest pause between two looks at the signals and at the subscribers.
_PATIENCE_S = 0.05
# A subscriber that the publisher has met may meet it later: discovery asks once a second what was
# missed.
_SETTLE_S = 1.2
# Time for the last frames to arrive before the publisher goes.
_FAREWELL_S = 5.0
_ENCODING_OF = {'uint8': 'mono8', 'uint16': 'mono16', 'float32': '32FC1', 'float64': '64FC1'}
_DTYPE_OF = {encoding: dtype for dtype, encoding in _ENCODING_OF.items()}


def parse_arguments(arguments: Sequence[str]) -> argparse.Namespace:
    """Command line of `scene`.

    Parameters
    ----------
    arguments
        Without ROS arguments and the program's name.
    """
    defaults = Scene()
    parser = argparse.ArgumentParser(
        prog='scene', description='Publish a test scene on `luminosity` for event_camera to see.'
    )
    parser.add_argument(
        'source',
        nargs='?',
        default='grating',
        help=f'{", ".join(SCENES)}, a video file or a folder of pictures (default: grating)',
    )
    parser.add_argument(
        '--rate', type=float, help="frames/s (default: the recording's own, or 100)"
    )
    parser.add_argument(
        '--source-rate',
        type=float,
        help='frames/s in the stamps (default: --rate), as for slow motion',
    )
    parser.add_argument('--frames', type=int, default=0, help='stop after so many (0: never)')
    parser.add_argument(
        '--no-wait', action='store_true', help='begin before luminosity has a subscriber'
    )
    parser.add_argument(
        '--encoding', choices=sorted(_DTYPE_OF), help='of the images (default: as fits the source)'
    )
    parser.add_argument(
        '--size', default=f'{defaults.height}x{defaults.width}', help='ROWSxCOLUMNS'
    )
    for name, unit in (
        ('speed', 'pixels/s'),
        ('frequency', 'Hz'),
        ('period', 'pixels'),
        ('dark', 'luminosity'),
        ('bright', 'luminosity'),
    ):
        value = getattr(defaults, name)
        parser.add_argument(
            f'--{name}', type=float, default=value, help=f'{unit} (default: {value:g})'
        )
    return parser.parse_args(arguments)


@dataclass(frozen=True, slots=True, kw_only=True)
class Showing:
    """Frames, and how fast they are shown.

    Parameters
    ----------
    frames
        Time since the first frame, ns, and luminosity, shape (height, width).
    pace
        Seconds of the clock for a second of the stamps; more than 1 is slow motion.
    """

    frames: Iterator[tuple[int, NDArray[Any]]]
    pace: float


def showing_of(options: argparse.Namespace) -> Showing:
    """What the command line asks for.

    Parameters
    ----------
    options
        From `parse_arguments`.

    Raises
    ------
    ParameterError
        If an option is out of range or the source can't be read.
    """
    for name in ('rate', 'source_rate'):
        rate = getattr(options, name)
        if rate is not None and not 0 < rate <= 1e6:
            raise ParameterError(name, rate, 'must be > 0 and <= 1e6 frames/s')
    if options.frames < 0:
        raise ParameterError('frames', options.frames, 'must be >= 0')
    if options.source not in SCENES:
        return _recorded(options)
    shown = options.rate or _RATE
    rate = options.source_rate or shown
    try:
        height, width = (int(number) for number in options.size.split('x'))
    except ValueError:
        raise ParameterError('size', options.size, 'must be ROWSxCOLUMNS') from None
    scene = Scene(
        height=height,
        width=width,
        speed=options.speed,
        frequency=options.frequency,
        period=options.period,
        dark=options.dark,
        bright=options.bright,
    )
    period_ns = round(NANOSECONDS / rate)
    frames = synthetic_frames(options.source, scene, period_ns)
    stamped = ((number * period_ns, frame) for number, frame in enumerate(frames))
    return Showing(frames=stamped, pace=rate / shown)


def _recorded(options: argparse.Namespace) -> Showing:
    path = Path(options.source)
    if not path.exists():
        raise ParameterError(
            'source', path, f'must be one of {", ".join(SCENES)}, a video file or a folder'
        )
    footage = open_footage(path)
    shown = options.rate or footage.rate or _RATE
    rate = options.source_rate or options.rate
    if rate is None and not footage.stamps_ns:
        rate = shown
    pace = rate / shown if rate is not None else 1.0
    return Showing(frames=footage.stamped(rate), pace=pace)


def encoded(frame: NDArray[Any], encoding: str | None) -> tuple[NDArray[Any], str]:
    """Frame in the number type of `encoding`, rounded and clipped where that is an integer.

    Parameters
    ----------
    frame
        Luminosity, shape (height, width).
    encoding
        Encoding of sensor_msgs/Image; None for what fits the frame.
    """
    if encoding is None:
        encoding = _ENCODING_OF.get(frame.dtype.name, '64FC1')
    dtype = np.dtype(_DTYPE_OF[encoding])
    if dtype.kind == 'u' and frame.dtype != dtype:
        frame = np.clip(np.rint(frame), 0, np.iinfo(dtype).max)
    return frame.astype(dtype), encoding


class SceneNode(Node):
    """Publishes frames at their rate."""

    def __init__(self) -> None:
        super().__init__('scene')
        self._publisher = self.create_publisher(Image, topics.LUMINOSITY, topics.stream_qos())

    def publish(self, showing: Showing, options: argparse.Namespace, stop: StopSignal) -> None:
        """Publish frames until they end or the user stops.

        Parameters
        ----------
        showing
            The frames and their pace.
        options
            From `parse_arguments`.
        stop
            Set by a signal.
        """
        if not options.no_wait:
            self._await_subscriber(stop)
        start_ns = self.get_clock().now().nanoseconds
        start_s = time.monotonic()
        for number, (elapsed_ns, frame) in enumerate(showing.frames):
            if options.frames and number >= options.frames:
                break
            due = start_s + showing.pace * as_seconds(elapsed_ns)
            _pause_until(due, stop)
            if stop.received:
                return
            pixels, encoding = encoded(frame, options.encoding)
            self._publisher.publish(pack_image(start_ns + elapsed_ns, pixels, encoding))
        if not self._publisher.wait_for_all_acked(Duration(seconds=_FAREWELL_S)):
            print(
                f'a subscriber of {self._publisher.topic_name} has not confirmed the last frames '
                f'within {_FAREWELL_S:g} s: it may have missed some',
                file=sys.stderr,
            )

    def _await_subscriber(self, stop: StopSignal) -> None:
        """Wait for the first reader to know us: frames without a subscriber are lost."""
        if not self._publisher.get_subscription_count():
            print(
                f'waiting for a subscriber of {self._publisher.topic_name} '
                '(--no-wait: begin at once)',
                file=sys.stderr,
            )
        while not stop.received and not self._publisher.get_subscription_count():
            time.sleep(_PATIENCE_S)
        _pause_until(time.monotonic() + _SETTLE_S, stop)


def _pause_until(due_s: float, stop: StopSignal) -> None:
    while (pause_s := due_s - time.monotonic()) > 0 and not stop.received:
        time.sleep(min(pause_s, _PATIENCE_S))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until its frames end or a signal.

    Parameters
    ----------
    arguments
        Command line with ROS arguments; `sys.argv` by default.
    """
    command_line = list(sys.argv if arguments is None else arguments)
    try:
        options = parse_arguments(own_arguments(command_line)[1:])
        showing = showing_of(options)
        with ros_session(command_line) as ros:
            ros.add(SceneNode()).publish(showing, options, ros.stop)
    except (ParameterError, MessageError) as error:
        print(f'cannot start: {error}', file=sys.stderr)
        return _USAGE_ERROR
    except DamagedFile as error:
        print(f'scene: {error}', file=sys.stderr)
        return error.exit_code
    return 0
