"""The part of `play` that publishes the recording of a sensor as our own `events`."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from dvs_closed_loop.bags.streams import STREAMS
from dvs_closed_loop.commands.play_waits import let_arrive, pause_until, wait_for_subscribers
from dvs_common.nanoseconds import as_seconds
from dvs_common.wire import topics
from dvs_common.wire.events import EventPacket, pack_events
from dvs_event_camera.files.damage import DamagedFile
from dvs_event_camera.files.open_recording import open_recording
from dvs_event_camera.files.recording import Recording
from dvs_event_camera.streams.event_records import without_labels
from dvs_event_camera.streams.pixel_map import PixelMap
from dvs_event_camera.streams.sensor_events import SensorEvents
from dvs_event_camera.streams.wire_stream import WireStream

if TYPE_CHECKING:
    from rclpy.publisher import Publisher

    from dvs_closed_loop.running.tool import Tool

# Events of files are sent in packets of this length, as drivers do.
_PACKET_NS = 10_000_000
_SETTLE_S = 0.5
# Where the size of the sensor is not known, no event lies beyond it.
_ANY_SIZE = 2**16


def play_recording(options: argparse.Namespace) -> int:
    """Play until the end of the recording; returns the exit code.

    Parameters
    ----------
    options
        Parsed arguments of `play`.

    Raises
    ------
    DamagedFile
        At the end, if not all could be read.
    ParameterError
        If the recording can't be read, or the region does not fit it.
    """
    from dvs_closed_loop.running.tool import tool_node

    given = dict(pair.split(':=', 1) for pair in options.topic if ':=' in pair)
    recording = open_recording(options.bag, given.get(topics.EVENTS))
    pixel_map = PixelMap(region=tuple(options.region), binning=options.binning)
    size = (recording.width or _ANY_SIZE, recording.height or _ANY_SIZE)
    pixel_map.size(*size)
    with tool_node('bag_player', options.namespace, options.ros_arguments) as tool:
        publishers = {
            name: _publisher(tool, name) for name in (topics.EVENTS, topics.EVENTS_LABEL)
        }
        if not options.no_wait:
            wait_for_subscribers(
                tool, {topics.EVENTS: publishers[topics.EVENTS]}, every_topic=options.wait
            )
        tool.spin(max(_SETTLE_S, options.delay))
        events, damage = 0, None
        try:
            for packet in _paced(recording, pixel_map, size, tool, options.rate):
                events += len(packet.events)
                _publish(packet, publishers)
        except DamagedFile as error:
            damage = error
        let_arrive(publishers, tool)
    print(f'{options.bag}: {events} events played')
    if damage:
        raise damage
    return 0


def _publisher(tool: Tool, topic: str) -> Publisher:
    stream = STREAMS[topics.EVENTS]
    return tool.node.create_publisher(stream.message_type, topic, stream.offered_qos)


def _publish(packet: EventPacket, publishers: dict[str, Publisher]) -> None:
    publishers[topics.EVENTS].publish(pack_events(without_labels(packet)))
    if 'noise' in (packet.events.dtype.names or ()):
        publishers[topics.EVENTS_LABEL].publish(pack_events(packet))


def _paced(
    recording: Recording, pixel_map: PixelMap, size: tuple[int, int], tool: Tool, rate: float
) -> Iterator[EventPacket]:
    """Packets of the recording, each at its instant; ends with a signal."""
    from tqdm import tqdm

    stream = WireStream()
    first_ns, started = None, time.monotonic()
    with tqdm(desc='playing', unit='ev', unit_scale=True, file=sys.stderr, disable=None) as bar:
        for stretch in recording.read():
            for part in _slices(stretch.events):
                end_ns = int(part.t.max())
                first_ns = end_ns if first_ns is None else first_ns
                pause_until(started + as_seconds(end_ns - first_ns) / rate, tool)
                if tool.stop.received:
                    return
                yield from stream.packets(pixel_map.mapped(part, *size), end_ns)
                bar.update(len(part))


def _slices(events: SensorEvents) -> Iterator[SensorEvents]:
    """Cut a stretch where a new interval of 10 ms begins."""
    if not len(events):
        return
    number = (events.t - events.t[0]) // _PACKET_NS
    cuts = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist(), len(events)]
    for begin, end in pairwise(cuts):
        yield events.take(slice(begin, end))
