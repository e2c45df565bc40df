"""RAW files of Metavision: EVT 2.0, EVT 2.1 and EVT 3.0 behind a header of text lines."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from dvs_common.errors import ParameterError
from dvs_event_camera.files.damage import DamagedFile
from dvs_event_camera.files.recording import Recording, Stretch, stretch_of
from dvs_event_camera.streams.packet_decoder import Evt3Decoder, kernels
from dvs_event_camera.streams.sensor_events import SensorEvents, Triggers

_FORMATS = {'EVT2': ('evt2', 4), 'EVT21': ('evt21', 8), 'EVT3': ('evt3', 2)}
_PIECE_WORDS = 2**17
_LARGEST_SENSOR = 2048
Decode = Callable[[bytes], SensorEvents]


@dataclass(frozen=True, slots=True, kw_only=True)
class TextHead:
    """The lines that begin with % at the head of Prophesee's files.

    Parameters
    ----------
    values
        Values by key, keys in lower case.
    size
        Bytes of the lines.
    """

    values: dict[str, str]
    size: int

    @property
    def width(self) -> int:
        """Columns of the sensor, 0 if they are not given."""
        return int(self._number('width') or self._geometry()[0])

    @property
    def height(self) -> int:
        """Rows of the sensor, 0 if they are not given."""
        return int(self._number('height') or self._geometry()[1])

    def _number(self, key: str) -> str:
        return self.values.get(key, '') if self.values.get(key, '').isdigit() else ''

    def _geometry(self) -> tuple[str, str]:
        found = re.match(r'(\d+)x(\d+)', self.values.get('geometry', ''))
        return (found.group(1), found.group(2)) if found else ('0', '0')


def read_text_head(file: BinaryIO) -> TextHead:
    """Read the head of an open file and leave it where the data begin.

    Parameters
    ----------
    file
        The file, at its start.
    """
    values: dict[str, str] = {}
    while True:
        start = file.tell()
        line = file.readline(4096)
        if not line.startswith(b'%'):
            file.seek(start)
            return TextHead(values=values, size=start)
        text = line[1:].strip().decode('latin-1')
        key, _, value = text.partition(' ')
        if key.lower() == 'end':
            return TextHead(values=values, size=file.tell())
        values[key.lower()] = value.strip()
        if key.lower() == 'format':
            for option in value.split(';')[1:]:
                name, _, content = option.partition('=')
                values.setdefault(name.strip().lower(), content.strip())


def raw_recording(path: Path) -> Recording:
    """Recording of a RAW file.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    ParameterError
        If the head names no known format.
    """
    with path.open('rb') as file:
        head = read_text_head(file)
    name = head.values.get('format', '').split(';')[0].strip()
    name = name or 'EVT' + head.values.get('evt', '').replace('.0', '').replace('.', '')
    if name not in _FORMATS:
        raise ParameterError('file', path, f'holds {name or "no format"}, not EVT2, EVT21 or EVT3')
    encoding, word = _FORMATS[name]
    if head.values.get('endianness') == 'big':
        raise ParameterError('file', path, 'is big-endian; only little-endian words are read')
    legacy = head.values.get('endianness') == 'legacy'

    def read() -> Iterator[Stretch]:
        if encoding == 'evt3':
            decode: Decode = Evt3Decoder(
                head.width or _LARGEST_SENSOR, head.height or _LARGEST_SENSOR
            ).decode
        else:
            decode = Evt2Decoder(vectors=encoding == 'evt21', legacy=legacy).decode
        return read_pieces(path, head.size, word, decode)

    return Recording(
        path=path,
        encoding=encoding,
        width=head.width,
        height=head.height,
        whole_microseconds=True,
        read=read,
    )


def read_pieces(path: Path, start: int, word: int, decode: Decode) -> Iterator[Stretch]:
    """Stretches of a file of equal words.

    Parameters
    ----------
    path
        The file.
    start
        Where the words begin.
    word
        Bytes a word.
    decode
        Makes events of a whole number of words.

    Raises
    ------
    DamagedFile
        At the end, if the last word is not whole.
    """
    with path.open('rb') as file:
        file.seek(start)
        while piece := file.read(_PIECE_WORDS * word):
            rest = len(piece) % word
            if len(piece) > rest:
                yield stretch_of(decode(piece[: len(piece) - rest]))
            if rest:
                raise DamagedFile(path, 'ends in the middle of a word')


class Evt2Decoder:
    """Decodes EVT 2.0 or 2.1 in pieces.

    Parameters
    ----------
    vectors
        Whether the words are those of EVT 2.1, with 32 pixels each.
    legacy
        Whether the halves of an EVT 2.1 word are swapped, as the first sensors sent them.
    """

    def __init__(self, *, vectors: bool, legacy: bool = False) -> None:
        self._vectors = vectors
        self._upper = 0 if legacy else 1
        self._kernels = kernels()
        self._state = np.zeros(2, np.int64)

    def decode(self, data: bytes) -> SensorEvents:
        """Events and triggers of a whole number of words.

        Parameters
        ----------
        data
            The words.
        """
        words = np.frombuffer(data, '<u4')
        masks = np.ones_like(words)
        if self._vectors:
            halves = words.reshape(-1, 2)
            words, masks = halves[:, self._upper].copy(), halves[:, 1 - self._upper].copy()
        most, edges_found = self._kernels.count_evt2(words, masks)
        t = np.empty(most, np.int64)
        x, y, p = np.empty(most, np.uint16), np.empty(most, np.uint16), np.empty(most, np.uint8)
        edges = np.empty((edges_found, 3), np.int64)
        events, triggers = self._kernels.decode_evt2(words, masks, self._state, t, x, y, p, edges)
        return SensorEvents(
            t=t[:events],
            x=x[:events],
            y=y[:events],
            p=p[:events],
            triggers=_triggers(edges[:triggers]),
        )


def _triggers(edges: NDArray[np.int64]) -> Triggers:
    return Triggers(
        t=edges[:, 0].copy(),
        source=edges[:, 1].astype(np.uint8),
        rising=edges[:, 2].astype(np.uint8),
    )
