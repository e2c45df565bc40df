"""Small recorded runs, made from bytes; and the same run as other writers put it down."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter

from dvs_closed_loop.bags.streams import STREAMS
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire import topics
from dvs_common.wire.events import EventPacket, make_events, pack_events
from dvs_common.wire.messages import Vector, pack_command, pack_estimate, pack_image, pack_state

Recorded = list[tuple[str, int, bytes]]

TYPES = {name: STREAMS[name].type_name for name in STREAMS}
PERIOD_NS = 10_000_000


def packet(stamp_ns: int, count: int, first_index: int, polarity: int = 1) -> bytes:
    return pack_events(
        EventPacket(
            stamp_ns=stamp_ns,
            events=make_events(
                times_ns=np.full(count, stamp_ns, dtype=np.int64),
                pixels=np.arange(count) % 3,
                polarities=np.full(count, polarity, dtype=np.int8),
                signs=np.ones(count, dtype=np.int8),
                width=3,
                stamp_ns=stamp_ns,
                first_index=first_index,
            ),
        )
    )


def small_run(samples: int = 60) -> Recorded:
    """A run of mirror_r3's size that rests at the set-point, in the order of a real loop."""
    scenario = Scenario.from_values({})
    state = np.array(scenario['set_point'])
    y = scenario.scene.luminosity(scenario.model, state)
    recorded: Recorded = []
    for k in range(samples):
        stamp, received = k * PERIOD_NS, 1_700_000_000_000_000_000 + 2 * k * PERIOD_NS
        names = ('x1', 'x2')
        recorded += [
            (
                topics.STATE,
                received,
                pack_state(Vector(stamp_ns=stamp, names=names, values=state)),
            ),
            (topics.LUMINOSITY, received + 1000, pack_image(stamp, y.reshape(1, 3), '64FC1')),
            (topics.EVENTS, received + 2000, packet(stamp, k % 2, k // 2)),
            (topics.ESTIMATE, received + 3000, pack_estimate(stamp, y * 1.01)),
            (
                topics.COMMAND,
                received + 3100,
                pack_command(Vector(stamp_ns=stamp, names=('u1',), values=np.array([0.5]))),
            ),
        ]
    return recorded


def with_foreign_padding(message: bytes) -> bytes:
    """The message as other CDR writers pad it: options in the header, garbage at the end."""
    return message[:2] + b'\x00\x03' + message[4:] + b'\xde\xad\xbe'


def write_like_rosbag2(
    folder: Path, storage: str, recorded: Recorded, namespace: str = ''
) -> Path:
    """A bag as `ros2 bag record` of Jazzy writes it, without the library under test."""
    folder.mkdir(parents=True)
    name = f'{folder.name}_0.{"mcap" if storage == "mcap" else "db3"}'
    used = sorted({topic for topic, _, _ in recorded})
    full = {topic: f'{namespace}/{topic}' for topic in used}
    write = _write_mcap if storage == 'mcap' else _write_sqlite
    write(folder / name, recorded, used, full)
    (folder / 'metadata.yaml').write_text(_metadata(name, storage, recorded, full))
    return folder


def _write_mcap(path: Path, recorded: Recorded, used: list[str], full: dict[str, str]) -> None:
    with path.open('wb') as file:
        writer = McapWriter(file, compression=CompressionType.ZSTD, chunk_size=4096)
        writer.start(profile='ros2', library='libmcap 1.1.0')
        channels = {}
        for topic in used:
            schema = writer.register_schema(TYPES[topic], 'ros2msg', b'')
            channels[topic] = writer.register_channel(
                full[topic], 'cdr', schema, {'offered_qos_profiles': ''}
            )
        for topic, received, data in recorded:
            writer.add_message(channels[topic], received, with_foreign_padding(data), received)
        writer.finish()


def _write_sqlite(path: Path, recorded: Recorded, used: list[str], full: dict[str, str]) -> None:
    connection = sqlite3.connect(path)
    connection.executescript(
        """
        CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
        CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL,
          metadata TEXT NOT NULL);
        CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
          serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL,
          type_description_hash TEXT NOT NULL);
        CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL,
          encoding TEXT NOT NULL, encoded_message_definition TEXT NOT NULL,
          type_description_hash TEXT NOT NULL);
        CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,
          timestamp INTEGER NOT NULL, data BLOB NOT NULL);
        CREATE INDEX timestamp_idx ON messages (timestamp ASC);
        INSERT INTO schema VALUES (4, 'jazzy');
        """
    )
    for number, topic in enumerate(used, 1):
        connection.execute(
            'INSERT INTO topics VALUES (?, ?, ?, ?, ?, ?)',
            (number, full[topic], TYPES[topic], 'cdr', '', ''),
        )
    for topic, received, data in recorded:
        connection.execute(
            'INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)',
            (used.index(topic) + 1, received, with_foreign_padding(data)),
        )
    connection.commit()
    connection.close()


def _metadata(name: str, storage: str, recorded: Recorded, full: dict[str, str]) -> str:
    first, last = recorded[0][1], recorded[-1][1]
    entries = ''.join(
        f"""
    - topic_metadata:
        name: {full[topic]}
        type: {TYPES[topic]}
        serialization_format: cdr
        offered_qos_profiles: []
        type_description_hash: ''
      message_count: {sum(t == topic for t, _, _ in recorded)}"""
        for topic in full
    )
    return f"""rosbag2_bagfile_information:
  version: 9
  storage_identifier: {storage}
  duration:
    nanoseconds: {last - first}
  starting_time:
    nanoseconds_since_epoch: {first}
  message_count: {len(recorded)}
  topics_with_message_count:{entries}
  compression_format: ""
  compression_mode: ""
  relative_file_paths:
    - {name}
  files:
    - path: {name}
      starting_time:
        nanoseconds_since_epoch: {first}
      duration:
        nanoseconds: {last - first}
      message_count: {len(recorded)}
  custom_data: ~
  ros_distro: jazzy
"""
