"""A `.db3` file of rosbag2 that was cut off, read message by message."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from dvs_event_camera.files.mcap_scan import ScannedMessage


def scan_sqlite(path: Path) -> Iterator[ScannedMessage]:
    """Messages in the order in which they were written.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    ValueError
        After the last message that can be read, if that is not all.
    """
    address = f'{path.absolute().as_uri()}?mode=ro'
    try:
        with closing(sqlite3.connect(address, uri=True)) as connection:
            # SQLite refuses a file that lacks pages, unless its schema may be mended.
            connection.execute('PRAGMA writable_schema = ON')
            topics = {
                number: (name, kind)
                for number, name, kind in connection.execute('SELECT id, name, type FROM topics')
            }
            rows = connection.execute('SELECT topic_id, timestamp, data FROM messages ORDER BY id')
            for number, received_ns, data in rows:
                topic, type_name = topics[number]
                yield ScannedMessage(
                    topic=topic, type_name=type_name, received_ns=received_ns, data=data
                )
    except (sqlite3.Error, KeyError) as error:
        raise ValueError(f'is cut off or damaged ({error})') from None
