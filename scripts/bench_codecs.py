#!/usr/bin/env python3
"""Speed of the decoders of EventPacket, on one core: packets of 10 ms of a busy sensor.

Million events per CPU second, the best of some rounds. The packets are made here: rows of pixels
fire together, as edges that move over a sensor make them.
"""

from __future__ import annotations

import time

import numpy as np

from dvs_event_camera.streams.event_packet import DriverPacket
from dvs_event_camera.streams.packet_decoder import PacketDecoder

_PACKETS, _COLUMNS, _WIDTH, _HEIGHT, _ROUNDS = 100, 500, 346, 260, 7
_RUN = 12
Words = np.ndarray


def _columns(rng: np.random.Generator) -> tuple[Words, Words, Words, Words]:
    """Time in microseconds, column, first row and polarity of runs of events."""
    t = np.sort(rng.integers(0, 10_000, _COLUMNS))
    x = rng.integers(0, _WIDTH, _COLUMNS)
    return t, x, rng.integers(0, _HEIGHT - _RUN, _COLUMNS), rng.integers(0, 2, _COLUMNS)


def caer_cmp(rng: np.random.Generator) -> bytes:
    """Words of libcaer_driver: time, column, then the rows one by one."""
    t, x, y, p = _columns(rng)
    rows = 0x3000 | p[:, None] << 11 | y[:, None] + np.arange(_RUN)
    head = np.column_stack([t >> 12, 0x1000 | t & 0xFFF, 0x2000 | x])
    return np.column_stack([head, rows]).astype('<u2').tobytes()


def evt3(rng: np.random.Generator) -> bytes:
    """Words of EVT 3.0: time, row, then the columns one by one."""
    t, y, x, p = _columns(rng)
    columns = 0x2000 | p[:, None] << 11 | np.minimum(x, _HEIGHT - _RUN)[:, None] + np.arange(_RUN)
    head = np.column_stack([0x8000 | t >> 12, 0x6000 | t & 0xFFF, np.minimum(y, _HEIGHT - 1)])
    return np.column_stack([head, columns]).astype('<u2').tobytes()


def caer(rng: np.random.Generator) -> bytes:
    """Words of libcaer: address and time of every event."""
    t, x, y, p = (np.repeat(column, _RUN) for column in _columns(rng))
    return np.column_stack([x << 17 | y << 2 | p << 1 | 1, t]).astype('<u4').tobytes()


def mono(rng: np.random.Generator) -> bytes:
    """Words of the mono encoding."""
    columns = (np.repeat(column, _RUN).astype(np.uint64) for column in _columns(rng))
    t, x, y, p = columns
    return (p << 63 | y << 48 | x << 32 | t * 1000).astype('<u8').tobytes()


def _best(encoding: str, data: list[bytes]) -> tuple[int, float]:
    packets = [
        DriverPacket(
            stamp_ns=0,
            height=_HEIGHT,
            width=_WIDTH,
            sequence=k,
            time_base=0,
            encoding=encoding,
            big_endian=False,
            data=memoryview(octets),
        )
        for k, octets in enumerate(data)
    ]
    events, best = 0, np.inf
    for _ in range(_ROUNDS):
        decoder = PacketDecoder()
        began = time.process_time()
        decoded = [decoder.decode(packet) for packet in packets]
        best = min(best, time.process_time() - began)
        events = sum(map(len, decoded))
    return events, best


def measure(quick: bool = False) -> dict[str, float]:
    """Million events per CPU second of every encoding.

    Parameters
    ----------
    quick
        Whether fewer packets do.
    """
    figures = {}
    packets = _PACKETS // 4 if quick else _PACKETS
    for name, make in (
        ('evt3', evt3),
        ('libcaer_cmp', caer_cmp),
        ('libcaer', caer),
        ('mono', mono),
    ):
        rng = np.random.default_rng(0)
        events, seconds = _best(name, [make(rng) for _ in range(packets)])
        figures[f'codec_{name}_mev'] = events / seconds * 1e-6
        print(f'{name:12s} {events / seconds * 1e-6:7.1f} Mev per CPU second')
    return figures


if __name__ == '__main__':
    measure()
