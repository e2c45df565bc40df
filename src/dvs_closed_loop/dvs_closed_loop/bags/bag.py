"""A recorded run, ours or by `ros2 bag`, read into memory; needs no ROS."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from dvs_closed_loop.bags.former_estimates import FORMER_TYPE, of_today
from dvs_closed_loop.bags.loop_topics import choose_topics
from dvs_closed_loop.bags.recorded_message import RecordedMessage
from dvs_closed_loop.bags.recording import NAME_KEY, PARAMETERS_KEY
from dvs_common.errors import ParameterError
from dvs_common.nanoseconds import as_seconds
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire.topics import ESTIMATE
from dvs_event_camera.files.bag_file import BagFile
from dvs_event_camera.files.damage import DamagedFile


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedBag:
    """Messages of one loop in a bag.

    Parameters
    ----------
    path
        The bag.
    messages
        All messages of the wire contract, in the order of their reception.
    names
        Full name of every topic of the contract in the bag.
    ignored
        Topics of the bag that are not of this loop.
    scenario
        Parameters stored in the bag, or None.
    scenario_name
        Name of the scenario.
    writer
        Distribution that wrote the bag, as far as it is named there.
    damage
        What could not be read; empty if the bag is whole.
    """

    path: Path
    messages: tuple[RecordedMessage, ...]
    names: dict[str, str]
    ignored: tuple[str, ...]
    scenario: Scenario | None
    scenario_name: str
    writer: str
    damage: str = ''

    def of(self, topic: str) -> list[bytes]:
        """CDR bytes of one topic, in the order of their reception.

        Parameters
        ----------
        topic
            Topic of the wire contract.
        """
        return [message.data for message in self.messages if message.topic == topic]

    def times_ns(self, topic: str) -> list[int]:
        """Times of reception of one topic, ns.

        Parameters
        ----------
        topic
            Topic of the wire contract.
        """
        return [message.received_ns for message in self.messages if message.topic == topic]

    @property
    def namespace(self) -> str:
        """Namespace of the loop, by the names of its topics."""
        names = (name for topic, name in self.names.items() if not topic.startswith('/'))
        return next((name.rpartition('/')[0] for name in names), '')

    @property
    def duration_s(self) -> float:
        """Time from the first message to the last, s."""
        if not self.messages:
            return 0.0
        return as_seconds(self.messages[-1].received_ns - self.messages[0].received_ns)


def read_bag(
    path: Path,
    *,
    namespace: str | None = None,
    topics: list[str] | None = None,
    given: Mapping[str, str] | None = None,
) -> RecordedBag:
    """Messages of one loop in a bag of whatever storage and writer.

    Parameters
    ----------
    path
        The bag; see `BagFile`.
    namespace
        Namespace of the loop; None for the only one in the bag.
    topics
        Topics of the wire contract to read; None for all.
    given
        Full names of topics of the contract that are called otherwise in the bag.

    Raises
    ------
    ParameterError
        If the bag can't be read, holds no topic of the contract, or holds several loops and none
        was chosen.
    """
    with BagFile(path) as bag:
        found = {topic.name: topic.type_name for topic in bag.topics}
        names = choose_topics(
            found,
            namespace=namespace,
            given=given or {},
            first_message=lambda topic: _first_message(bag, topic),
        )
        if not names:
            raise ParameterError('bag', path, 'holds no topic of the wire contract')
        of_name = {
            name: topic for topic, name in names.items() if topics is None or topic in topics
        }
        messages = []
        damage = ''
        try:
            for message in bag.messages(of_name):
                topic = of_name[message.topic.name]
                messages.append(
                    RecordedMessage(
                        topic=topic, received_ns=message.received_ns, data=message.data
                    )
                )
        except DamagedFile as error:
            damage = str(error)
        messages.sort(key=lambda message: message.received_ns)
        if found.get(names.get(ESTIMATE, '')) == FORMER_TYPE:
            messages = of_today(messages)
        return RecordedBag(
            path=path,
            messages=tuple(messages),
            names=names,
            ignored=tuple(sorted(found.keys() - set(names.values()))),
            scenario=_scenario_in(path, bag.custom.get(PARAMETERS_KEY)),
            scenario_name=bag.custom.get(NAME_KEY, path.stem),
            writer=bag.distribution or 'unknown',
            damage=damage,
        )


def _scenario_in(path: Path, text: str | None) -> Scenario | None:
    if text is None:
        return None
    try:
        return Scenario.from_values(json.loads(text))
    except (ValueError, TypeError, AttributeError) as error:
        raise ParameterError('bag', path, f'holds a broken scenario: {error}') from None


def _first_message(bag: BagFile, topic: str) -> bytes | None:
    try:
        return next((message.data for message in bag.messages([topic])), None)
    except DamagedFile:
        return None
