"""Files of plain records: DAT of Prophesee, and the .bin files of N-MNIST and N-Caltech101."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dvs_common.errors import ParameterError
from dvs_event_camera.files.raw_file import read_pieces, read_text_head
from dvs_event_camera.files.recording import Recording, Stretch
from dvs_event_camera.streams.sensor_events import SensorEvents

_DAT_EVENT_BYTES = 8
# Size of a DAT event's clock, microseconds.
_DAT_OVERFLOW = 2**32
_MNIST_SIZE = 34
_MNIST_EVENT_BYTES = 5
# An "event" in this row marks an overflow of the clock (Orchard et al. 2015).
_MNIST_OVERFLOW_ROW, _MNIST_OVERFLOW = 240, 2**13


def dat_recording(path: Path) -> Recording:
    """Recording of a DAT file with CD events.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    ParameterError
        If its events are no CD events of 8 bytes.
    """
    with path.open('rb') as file:
        head = read_text_head(file)
        kind = file.read(2)
    if len(kind) < 2 or kind[1] != _DAT_EVENT_BYTES:
        raise ParameterError('file', path, 'is no DAT file of CD events with 8 bytes each')
    return Recording(
        path=path,
        encoding='dat',
        width=head.width,
        height=head.height,
        whole_microseconds=True,
        read=lambda: read_pieces(path, head.size + 2, _DAT_EVENT_BYTES, _DatDecoder().decode),
    )


class _DatDecoder:
    """Decodes a DAT file in pieces; its clock of 32 bits may run over."""

    def __init__(self) -> None:
        self._last = self._overflow = 0

    def decode(self, data: bytes) -> SensorEvents:
        words = np.frombuffer(data, '<u4').reshape(-1, 2)
        clock, place = words[:, 0].astype(np.int64), words[:, 1]
        back = np.diff(clock, prepend=self._last) < -_DAT_OVERFLOW // 2
        overflow = self._overflow + np.cumsum(back) * _DAT_OVERFLOW
        self._last, self._overflow = int(clock[-1]), int(overflow[-1])
        return SensorEvents(
            t=(clock + overflow) * 1000,
            x=(place & 0x3FFF).astype(np.uint16),
            y=(place >> 14 & 0x3FFF).astype(np.uint16),
            p=(place >> 28 & 1).astype(np.uint8),
        )


def nmnist_recording(path: Path) -> Recording:
    """Recording of an N-MNIST or N-Caltech101 .bin file.

    Parameters
    ----------
    path
        The file.
    """

    def read() -> Iterator[Stretch]:
        return read_pieces(path, 0, _MNIST_EVENT_BYTES, _MnistDecoder().decode)

    size = _MNIST_SIZE if _fits_mnist(read()) else 0
    return Recording(
        path=path,
        encoding='nmnist',
        width=size,
        height=size,
        whole_microseconds=True,
        read=read,
    )


def _fits_mnist(stretches: Iterator[Stretch]) -> bool:
    """Whether the first events lie in the 34 x 34 pixels of N-MNIST."""
    for stretch in stretches:
        events = stretch.events
        return bool(np.all(events.x < _MNIST_SIZE) and np.all(events.y < _MNIST_SIZE))
    return True


class _MnistDecoder:
    def __init__(self) -> None:
        self._overflow = 0

    def decode(self, data: bytes) -> SensorEvents:
        octets = np.frombuffer(data, np.uint8).reshape(-1, _MNIST_EVENT_BYTES).astype(np.int64)
        x, y, high, middle, low = octets.T
        over = y == _MNIST_OVERFLOW_ROW
        overflow = self._overflow + np.cumsum(over) * _MNIST_OVERFLOW
        self._overflow = int(overflow[-1])
        clock = ((high & 0x7F) << 16 | middle << 8 | low) + overflow
        kept = ~over
        return SensorEvents(
            t=clock[kept] * 1000,
            x=x[kept].astype(np.uint16),
            y=y[kept].astype(np.uint16),
            p=(high[kept] >> 7).astype(np.uint8),
        )
