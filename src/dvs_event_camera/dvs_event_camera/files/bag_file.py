"""Messages of a bag as people have it, without ROS: one reader for ROS 2 and ROS 1.

ROS 2: a folder, also without metadata.yaml or with one that names no storage; a single `.mcap` or
`.db3` file; files or messages compressed with zstd; an MCAP file without its end. ROS 1: `.bag`.
All messages come as the CDR bytes that ROS 2 has on the wire.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from importlib import import_module
from pathlib import Path
from types import TracebackType

from dvs_common.errors import ParameterError
from dvs_event_camera.files.bag_notes import BagNotes, notes_beside
from dvs_event_camera.files.bag_storages import BagMessage, Storage, opened_storage
from dvs_event_camera.files.damage import DamagedFile

STORAGE_SUFFIXES = ('.mcap', '.db3')


class BagFile:
    """An open bag; use it in a `with` statement.

    Parameters
    ----------
    path
        Folder of a rosbag2, one of its files, or a bag of ROS 1.

    Attributes
    ----------
    topics
        Topics of the bag by name.
    custom
        What the recorder noted beside the messages.
    distribution
        ROS distribution that wrote the bag; empty where it is not named.

    Raises
    ------
    ParameterError
        If there is no such bag or nothing of it can be read.
    """

    def __init__(self, path: Path) -> None:
        if not path.exists():
            raise ParameterError('bag', path, 'does not exist')
        self.path = path
        self._stack = ExitStack()
        try:
            notes = notes_beside(path)
            self._missing = [name for name in notes.files if not (path / name).exists()]
            self._storages = [self._open(file) for file in self._files(notes)]
        except BaseException:
            self._stack.close()
            raise
        self.topics = tuple(
            sorted(
                frozenset().union(*(storage.topics for storage in self._storages)),
                key=lambda topic: (topic.name, topic.type_name),
            )
        )
        all_notes = (notes, *(storage.notes for storage in self._storages))
        self.custom = next((n.custom for n in all_notes if n.custom), {})
        self.distribution = next((n.distribution for n in all_notes if n.distribution), '')

    def __enter__(self) -> BagFile:
        """Return the open bag."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close all files."""
        self._stack.close()

    def messages(self, names: Collection[str] | None = None) -> Iterator[BagMessage]:
        """Messages in the order of their reception, file by file.

        Parameters
        ----------
        names
            Full names of the topics to read; None for all.

        Raises
        ------
        DamagedFile
            After the last message that could be read, if that was not all.
        """
        for storage in self._storages:
            yield from storage.messages(names)
        if self._missing:
            raise DamagedFile(self.path, f'lacks {", ".join(self._missing)}')

    def _files(self, notes: BagNotes) -> list[Path]:
        if not self.path.is_dir():
            return [self.path]
        files = [self.path / name for name in notes.files if (self.path / name).exists()]
        files = files or sorted(
            (file for file in self.path.iterdir() if _storage_suffix(file)), key=_natural
        )
        if not files:
            inside = self.path / 'bag'
            hint = f'; there is a folder {inside}' if inside.is_dir() else ''
            raise ParameterError(
                'bag',
                self.path,
                f'is not a rosbag2: holds no metadata.yaml and no .mcap or .db3{hint}',
            )
        return files

    def _open(self, path: Path) -> Storage:
        if path.suffix == '.zstd':
            path = self._stack.enter_context(_unpacked(path))
        storage = opened_storage(path)
        self._stack.callback(storage.close)
        return storage


def _storage_suffix(path: Path) -> bool:
    name = path.name.removesuffix('.zstd')
    return path.is_file() and name.endswith(STORAGE_SUFFIXES)


def _natural(path: Path) -> list[tuple[int, str]]:
    """Key by which bag_2 comes before bag_10."""
    parts = re.split(r'(\d+)', path.name)
    return [(int(part), '') if part.isdigit() else (-1, part) for part in parts]


@contextmanager
def _unpacked(path: Path) -> Iterator[Path]:
    """Decompressed copy of a file, as long as it is needed."""
    zstandard = import_module('zstandard')
    with tempfile.TemporaryDirectory(prefix='dvs_bag_') as folder:
        copy = Path(folder) / path.stem
        with path.open('rb') as source, copy.open('wb') as target:
            try:
                zstandard.ZstdDecompressor().copy_stream(source, target)
            except zstandard.ZstdError as error:
                raise ParameterError('bag', path, f'is no zstd file: {error}') from None
        yield copy
