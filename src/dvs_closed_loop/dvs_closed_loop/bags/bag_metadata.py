"""What a rosbag2 holds on its topics, and on itself in `metadata.yaml`."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile

VERSION = 9
_DISTRIBUTION = 'jazzy'
# What rclpy calls infinite.
_INFINITE = {'sec': 9223372036, 'nsec': 854775807}


@dataclass(frozen=True, slots=True, kw_only=True)
class BagTopic:
    """One topic of a bag.

    Parameters
    ----------
    name
        Full name.
    type_name
        Message type as package/msg/Type.
    definition
        Text of the message definition, with those that it needs.
    type_hash
        REP 2011 hash of the type.
    qos
        Offered quality of service as YAML, or an empty text.
    """

    name: str
    type_name: str
    definition: str
    type_hash: str
    qos: str

    @classmethod
    def of(cls, name: str, type_name: str, qos: QoSProfile | None) -> BagTopic:
        """Topic with the definition of its type.

        Parameters
        ----------
        name
            Full name.
        type_name
            Message type as package/msg/Type, one of the wire contract.
        qos
            Offered quality of service, or None if it is not known.
        """
        described = _message_types()[type_name]
        return cls(
            name=name,
            type_name=type_name,
            definition='\n'.join(described['definition']),
            type_hash=described['hash'],
            qos='' if qos is None else _yaml([_described(qos)]),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class BagContent:
    """What was written to a bag.

    Parameters
    ----------
    counts
        Number of messages of every topic, in the order of the topics.
    first_ns
        Time of the first message, ns; 0 without messages.
    last_ns
        Time of the last message, ns.
    """

    counts: tuple[int, ...]
    first_ns: int
    last_ns: int


def metadata_text(
    *,
    storage: str,
    file_name: str,
    topics: Sequence[BagTopic],
    content: BagContent,
    custom: Mapping[str, str],
) -> str:
    """Text of `metadata.yaml`, version 9.

    Parameters
    ----------
    storage
        ``mcap`` or ``sqlite3``.
    file_name
        Name of the bag's file.
    topics
        All topics.
    content
        What was written.
    custom
        Data of one's own by key.
    """
    total = sum(content.counts)
    begin = {'nanoseconds_since_epoch': content.first_ns}
    duration = {'nanoseconds': content.last_ns - content.first_ns}
    information = {
        'version': VERSION,
        'storage_identifier': storage,
        'relative_file_paths': [file_name],
        'duration': duration,
        'starting_time': begin,
        'message_count': total,
        'topics_with_message_count': [
            {
                'topic_metadata': {
                    'name': topic.name,
                    'type': topic.type_name,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': yaml.safe_load(topic.qos) or [],
                    'type_description_hash': topic.type_hash,
                },
                'message_count': count,
            }
            for topic, count in zip(topics, content.counts, strict=True)
        ],
        'compression_format': '',
        'compression_mode': '',
        'files': [
            {
                'path': file_name,
                'starting_time': dict(begin),
                'duration': dict(duration),
                'message_count': total,
            }
        ],
        'custom_data': dict(custom) or None,
        'ros_distro': _DISTRIBUTION,
    }
    return _yaml({'rosbag2_bagfile_information': information})


def _described(qos: QoSProfile) -> dict[str, Any]:
    return {
        'history': 'keep_last',
        'depth': qos.depth,
        'reliability': qos.reliability.name.lower(),
        'durability': qos.durability.name.lower(),
        'deadline': dict(_INFINITE),
        'lifespan': dict(_INFINITE),
        'liveliness': 'automatic',
        'liveliness_lease_duration': dict(_INFINITE),
        'avoid_ros_namespace_conventions': False,
    }


def _yaml(value: object) -> str:
    return yaml.safe_dump(value, sort_keys=False, allow_unicode=True)


@cache
def _message_types() -> dict[str, Any]:
    # Those of rosbags, which takes a tenth of a second to describe the types of a distribution.
    text = Path(__file__).with_name('message_types.json').read_text(encoding='utf-8')
    types: dict[str, Any] = json.loads(text)
    return types
