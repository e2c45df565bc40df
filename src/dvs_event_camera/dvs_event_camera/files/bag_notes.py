"""What a bag holds on itself: in its metadata.yaml, and in copies of that within its files.

A recorder writes the copy when it begins and metadata.yaml when it ends, so that of a recorder
that was killed the copy is left. MCAP: a metadata record called ``rosbag2``. SQLite: a table.
"""

from __future__ import annotations

import os
import sqlite3
import struct
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO
from urllib.parse import quote

import yaml

from dvs_event_camera.files.mcap_scan import MAGIC, text_at

_METADATA, _DATA_END = 0x0C, 0x0F
_RECORD = struct.Struct('<BQ')
_NAME, _KEY = 'rosbag2', 'serialized_metadata'
_LARGEST = 2**24


@dataclass(frozen=True, slots=True, kw_only=True)
class BagNotes:
    """What a recorder noted, as far as it can be read.

    Parameters
    ----------
    files
        Names of the files of the bag.
    custom
        Data of the recorder's own by key.
    distribution
        ROS distribution that wrote the bag; empty where it is not named.
    """

    files: tuple[str, ...] = ()
    custom: dict[str, str] = field(default_factory=dict)
    distribution: str = ''

    @classmethod
    def of(cls, text: str) -> BagNotes:
        """Notes in the text of a metadata.yaml; empty ones of a text that is none.

        Parameters
        ----------
        text
            YAML.
        """
        try:
            notes = yaml.safe_load(text)['rosbag2_bagfile_information']
            # Older ones name files relative to the folder above.
            return cls(
                files=tuple(Path(name).name for name in notes.get('relative_file_paths') or ()),
                custom=dict(notes.get('custom_data') or {}),
                distribution=notes.get('ros_distro') or '',
            )
        except (
            yaml.YAMLError,
            KeyError,
            TypeError,
            AttributeError,
            ValueError,
            RecursionError,
        ):
            return cls()


def notes_beside(folder: Path) -> BagNotes:
    """Notes of a bag's metadata.yaml.

    Parameters
    ----------
    folder
        Folder of the bag.
    """
    try:
        return BagNotes.of((folder / 'metadata.yaml').read_text(encoding='utf-8'))
    except (FileNotFoundError, NotADirectoryError, UnicodeDecodeError):
        return BagNotes()


def notes_within(path: Path) -> BagNotes:
    """Notes in a file of a bag; of several copies the last.

    Parameters
    ----------
    path
        A `.mcap` or `.db3` file, whole or cut off.
    """
    read = {'.mcap': _text_in_mcap, '.db3': _text_in_sqlite}.get(path.suffix)
    text = None if read is None else read(path)
    return BagNotes() if text is None else BagNotes.of(text)


def _text_in_mcap(path: Path) -> str | None:
    found = None
    with path.open('rb') as file:
        if file.read(len(MAGIC)) != MAGIC:
            return None
        while (record := _next_metadata(file)) is not None:
            try:
                found = _entries(record).get(_KEY, found)
            except struct.error:
                continue
    return found


def _next_metadata(file: BinaryIO) -> bytes | None:
    """Content of the next metadata record outside of chunks; None where no whole one is left."""
    end = os.fstat(file.fileno()).st_size
    while len(head := file.read(_RECORD.size)) == _RECORD.size:
        opcode, size = _RECORD.unpack(head)
        if opcode == _DATA_END or file.tell() + size > end:
            return None
        if opcode == _METADATA and size < _LARGEST:
            return file.read(size)
        file.seek(size, os.SEEK_CUR)
    return None


def _entries(record: bytes) -> dict[str, str]:
    """Keys and values of a metadata record of rosbag2; none of another one."""
    name, at = text_at(record, 0)
    if name != _NAME:
        return {}
    (size,) = struct.unpack_from('<I', record, at)
    at, end = at + 4, min(at + 4 + size, len(record))
    entries = {}
    while at < end:
        key, at = text_at(record, at)
        entries[key], at = text_at(record, at)
    return entries


def _text_in_sqlite(path: Path) -> str | None:
    try:
        address = f'file:{quote(str(path))}?immutable=1'
        with closing(sqlite3.connect(address, uri=True)) as connection:
            row = connection.execute(
                'SELECT metadata FROM metadata ORDER BY id DESC LIMIT 1'
            ).fetchone()
    except sqlite3.Error:
        return None
    return row[0] if row and isinstance(row[0], str) else None
