"""Recording of the events in a bag, whatever message carries them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from dvs_common.errors import ParameterError
from dvs_common.wire import topics
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.events import parse_events
from dvs_common.wire.index_watch import IndexWatch
from dvs_event_camera.files.bag_file import BagFile
from dvs_event_camera.files.bag_storages import BagTopic
from dvs_event_camera.files.damage import DamagedFile
from dvs_event_camera.files.event_array import EVENT_ARRAY, parse_event_array
from dvs_event_camera.files.recording import Recording, Stretch
from dvs_event_camera.streams.event_packet import MESSAGE_TYPE, parse_event_packet
from dvs_event_camera.streams.event_records import events_of
from dvs_event_camera.streams.packet_decoder import PacketDecoder
from dvs_event_camera.streams.sensor_events import SensorEvents

POINT_CLOUD = 'sensor_msgs/msg/PointCloud2'
# A cloud under another name is one of points.
_CLOUD_NAMES = (topics.EVENTS_LABEL, topics.EVENTS)
# Messages of drivers.
SENSOR_TYPES = frozenset((MESSAGE_TYPE, EVENT_ARRAY))
# What counts in microseconds; `mono`, `dvs_msgs` and our own `events` count nanoseconds.
_WHOLE_MICROSECONDS = ('evt3', 'libcaer', 'libcaer_cmp')
Decode = Callable[[bytes, int], Stretch]


def bag_recording(path: Path, topic: str | None = None) -> Recording:
    """Recording of one topic of a bag.

    Parameters
    ----------
    path
        The bag; see `BagFile`.
    topic
        Name of the topic, with or without its namespace; None for the only one that has events.

    Raises
    ------
    ParameterError
        If there is no such bag or topic, or several topics have events and none is named, or its
        first message can't be read.
    """
    with BagFile(path) as bag:
        chosen = choose_topic(bag, topic)
        form = _form_of(bag, chosen)

    def read() -> Iterator[Stretch]:
        with BagFile(path) as opened:
            yield from _stretches(opened, chosen)

    return Recording(
        path=path,
        encoding=form.encoding,
        width=form.width,
        height=form.height,
        whole_microseconds=form.encoding in _WHOLE_MICROSECONDS,
        read=read,
    )


def choose_topic(bag: BagFile, topic: str | None) -> BagTopic:
    """Topic of a bag that carries events.

    Parameters
    ----------
    bag
        The bag.
    topic
        Name, with or without its namespace; None for the only one. Where a camera published its
        events with labels as well, that is the one.

    Raises
    ------
    ParameterError
        If there is none, or several and none is named.
    """
    wanted = None if topic is None else '/' + topic.strip('/')
    found = [
        candidate
        for candidate in bag.topics
        if _carries_events(candidate, named=wanted is not None)
        and (wanted is None or candidate.name.endswith(wanted))
    ]
    names = sorted(candidate.name for candidate in bag.topics)
    if not found:
        raise ParameterError(
            'topic', topic or 'any', f'has no events in this bag; it holds {names}'
        )
    exact = [candidate for candidate in found if candidate.name == wanted]
    best = exact or _best(found)
    if len(best) > 1:
        several = ', '.join(candidate.name for candidate in best)
        raise ParameterError('topic', topic or 'any', f'must be one of {several}')
    return best[0]


def _carries_events(topic: BagTopic, *, named: bool) -> bool:
    if topic.type_name == POINT_CLOUD:
        return named or topic.name.rpartition('/')[2] in _CLOUD_NAMES
    return topic.type_name in SENSOR_TYPES


def _best(found: list[BagTopic]) -> list[BagTopic]:
    """Those of our own names before others, with labels before without."""
    for name in _CLOUD_NAMES:
        own = [topic for topic in found if topic.name.rpartition('/')[2] == name]
        if own:
            return own
    return found


def _stretches(bag: BagFile, topic: BagTopic) -> Iterator[Stretch]:
    decode = _decoder_of(topic.type_name)
    good, bad, reason = 0, 0, ''
    for number, message in enumerate(bag.messages([topic.name])):
        try:
            stretch = decode(message.data, message.received_ns)
        except MessageError as error:
            bad, reason = bad + 1, reason or f'message {number}: {error}'
            continue
        good += 1
        yield stretch
    if bad and not good:
        raise ParameterError('topic', topic.name, f'holds no message that can be read: {reason}')
    if bad:
        raise DamagedFile(bag.path, f'{bad} messages of {topic.name} are left out ({reason})')


@dataclass(frozen=True, slots=True, kw_only=True)
class _Form:
    """What the first message has in common with all."""

    encoding: str
    width: int = 0
    height: int = 0


def _form_of(bag: BagFile, topic: BagTopic) -> _Form:
    if topic.type_name == POINT_CLOUD:
        return _Form(encoding=topic.name.rpartition('/')[2])
    try:
        for message in bag.messages([topic.name]):
            if topic.type_name == EVENT_ARRAY:
                array = parse_event_array(message.data)
                return _Form(encoding='dvs_msgs', width=array.width, height=array.height)
            packet = parse_event_packet(message.data)
            return _Form(encoding=packet.encoding, width=packet.width, height=packet.height)
    except (MessageError, DamagedFile):
        # A reader that goes on meets it again, with the messages that are whole.
        pass
    return _Form(encoding='unknown')


def _decoder_of(type_name: str) -> Decode:
    if type_name == POINT_CLOUD:
        return CloudDecoder().decode
    return _decode_array if type_name == EVENT_ARRAY else _DriverDecoder().decode


def _decode_array(message: bytes, received_ns: int) -> Stretch:
    array = parse_event_array(message)
    return Stretch(
        events=array.events,
        end_ns=_end_of(array.events, array.stamp_ns),
        stamp_ns=array.stamp_ns,
        received_ns=received_ns,
    )


class _DriverDecoder:
    """Makes stretches of EventPacket messages."""

    def __init__(self) -> None:
        self._decoder = PacketDecoder()

    def decode(self, message: bytes, received_ns: int) -> Stretch:
        packet = parse_event_packet(message)
        events = self._decoder.decode(packet)
        return Stretch(
            events=events,
            end_ns=_end_of(events, packet.stamp_ns),
            stamp_ns=packet.stamp_ns,
            received_ns=received_ns,
            sequence=packet.sequence,
        )


class CloudDecoder:
    """Makes stretches of our own `events`, and counts what is missing."""

    def __init__(self) -> None:
        self._index = IndexWatch()

    def decode(self, message: bytes, received_ns: int) -> Stretch:
        """Stretch of the next message.

        Parameters
        ----------
        message
            CDR bytes of a PointCloud2.
        received_ns
            When it was received, ns.

        Raises
        ------
        MessageError
            If it breaks the wire contract.
        """
        packet = parse_events(message)
        return Stretch(
            events=events_of(packet),
            end_ns=packet.stamp_ns,
            stamp_ns=packet.stamp_ns,
            received_ns=received_ns,
            step=self._index.take(packet),
        )


def _end_of(events: SensorEvents, otherwise: int) -> int:
    return int(events.t[-1]) if len(events) else otherwise
