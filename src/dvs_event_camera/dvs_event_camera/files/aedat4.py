"""AEDAT4 files of DV: read by the PyPI package aedat, written here.

Format: docs.inivation.com, "AEDAT 4". A file is a line of text, a flatbuffer that describes the
streams, packets (stream, size, flatbuffer), and a flatbuffer with their table. The few flatbuffers
that a writer needs are put together by `flatbuffer.py`.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from dvs_common.errors import ParameterError
from dvs_event_camera.files.damage import DamagedFile
from dvs_event_camera.files.recording import Recording, Stretch, stretch_of
from dvs_event_camera.streams.sensor_events import SensorEvents, Triggers, no_events

# Kinds of trigger: rising and falling edge of the signal input, a pulse on it, and the same of
# the generator. The others mark frames.
SIGNAL_RISING, SIGNAL_FALLING, SIGNAL_PULSE, GENERATOR_RISING, GENERATOR_FALLING = 1, 2, 3, 4, 5


def aedat4_recording(path: Path) -> Recording:
    """Recording of the first stream of events in an AEDAT4 file.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    ParameterError
        If it is no such file, has no events, or the package aedat is not installed.
    """
    streams = _decoder(path).id_to_stream()
    with_events = sorted(key for key, stream in streams.items() if stream['type'] == 'events')
    if not with_events:
        raise ParameterError('file', path, 'holds no stream of events')
    chosen = with_events[0]
    return Recording(
        path=path,
        encoding='aedat4',
        width=streams[chosen]['width'],
        height=streams[chosen]['height'],
        whole_microseconds=True,
        read=lambda: _stretches(path, chosen),
    )


def _decoder(path: Path) -> Any:
    try:
        aedat = import_module('aedat')
    except ImportError:
        raise ParameterError('file', path, 'needs the Python package aedat') from None
    try:
        return aedat.Decoder(path)
    except BaseException as error:
        _require_of_parser(error)
        raise ParameterError('file', path, f'is no AEDAT4 file: {error}') from None


def _require_of_parser(error: BaseException) -> None:
    """Raise again what is not the parser's: its panics are no `Exception`."""
    if not isinstance(error, Exception) and type(error).__name__ != 'PanicException':
        raise error


def _stretches(path: Path, chosen: int) -> Iterator[Stretch]:
    packets = iter(_decoder(path))
    while True:
        try:
            packet = next(packets, None)
        # The package raises whatever its parser meets.
        except BaseException as error:
            _require_of_parser(error)
            raise DamagedFile(path, f'is damaged: {error}') from None
        if packet is None:
            return
        if 'events' in packet and packet['stream_id'] == chosen:
            yield stretch_of(_events(packet['events']))
        elif 'triggers' in packet:
            yield stretch_of(no_events(_triggers(packet['triggers'])))


def _events(records: Any) -> SensorEvents:
    return SensorEvents(
        t=records['t'].astype(np.int64) * 1000,
        x=records['x'].copy(),
        y=records['y'].copy(),
        p=records['on'].astype(np.uint8),
    )


def _triggers(records: Any) -> Triggers:
    kind = records['source']
    records = records[(kind >= SIGNAL_RISING) & (kind <= GENERATOR_FALLING)]
    kind = records['source']
    return Triggers(
        t=records['t'].astype(np.int64) * 1000,
        source=(kind >= GENERATOR_RISING).astype(np.uint8),
        rising=((kind != SIGNAL_FALLING) & (kind != GENERATOR_FALLING)).astype(np.uint8),
    )
