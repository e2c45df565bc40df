"""Encoders of what sensors and drivers send, written for the tests to judge decoders by."""

import os
import struct
from pathlib import Path

import numpy as np

from dvs_common.wire.cdr import CdrWriter
from dvs_event_camera.streams.sensor_events import SensorEvents, Triggers

SAMPLES = Path(
    os.environ.get('DVS_SAMPLES', Path(__file__).resolve().parents[4] / 'shared' / 'samples')
)
EVT3_START = 5_000_000
COLUMNS = ('t', 'x', 'y', 'p')


def some_events(count, *, width=346, height=260, seed=0, start_us=10_000, span_us=50_000):
    """Random events in order of time, whole microseconds."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(start_us, start_us + span_us, count)) * 1000
    return SensorEvents(
        t=t,
        x=rng.integers(0, width, count).astype(np.uint16),
        y=rng.integers(0, height, count).astype(np.uint16),
        p=rng.integers(0, 2, count).astype(np.uint8),
    )


def triggers(*edges):
    """Triggers of (t in ns, source, rising)."""
    t, source, rising = np.array(edges, np.int64).reshape(-1, 3).T
    return Triggers(t=t, source=source.astype(np.uint8), rising=rising.astype(np.uint8))


def same(found, expected):
    """Whether two stretches have the same events, labels and triggers."""
    columns = all(np.array_equal(getattr(found, c), getattr(expected, c)) for c in COLUMNS)
    labels = (found.noise is None) == (expected.noise is None) and (
        found.noise is None or np.array_equal(found.noise, expected.noise)
    )
    edges = all(
        np.array_equal(getattr(found.triggers, c), getattr(expected.triggers, c))
        for c in ('t', 'source', 'rising')
    )
    return columns and labels and edges


def evt3_words(events, edges=()):
    """EVT 3.0: time, row and column word by word; edges of (t in us, source, rising)."""
    items = [(int(t) // 1000, 0, i) for i, t in enumerate(events.t)]
    items += [(t, 1, edge) for edge in edges for t in [edge[0]]]
    words, high, low, row = [], None, None, None
    for now, kind, what in sorted(items, key=lambda item: item[:2]):
        if now >> 12 != high:
            high = now >> 12
            words.append(0x8000 | high & 0xFFF)
            low = None
        if now & 0xFFF != low:
            low = now & 0xFFF
            words.append(0x6000 | low)
        if kind:
            words.append(0xA000 | what[1] << 8 | what[2])
            continue
        if int(events.y[what]) != row:
            row = int(events.y[what])
            words.append(row)
        words.append(0x2000 | int(events.p[what]) << 11 | int(events.x[what]))
    return np.array(words, '<u2')


def caer_cmp_words(events, time_base):
    """libcaer_cmp: time, column, then single rows or eight at a time where they follow."""
    words, high, low, column = [], 0, 0, None
    since = (events.t - time_base) // 1000
    i = 0
    while i < len(events):
        now = int(since[i])
        if now >> 12 != high:
            high = now >> 12
            words.append(0x0000 | high)
        if now & 0xFFF != low:
            low = now & 0xFFF
            words.append(0x1000 | low)
        if int(events.x[i]) != column:
            column = int(events.x[i])
            words.append(0x2000 | column)
        row, on = int(events.y[i]), int(events.p[i])
        run = [
            j
            for j in range(i, min(i + 8, len(events)))
            if (since[j], events.x[j], events.p[j]) == (since[i], events.x[i], on)
            and row <= events.y[j] < row + 8
        ]
        rows = [int(events.y[j]) - row for j in run]
        if run == list(range(i, i + len(run))) and len(run) > 1 and rows == sorted(set(rows)):
            words += [0x4000 | on << 11 | row, 0x5000 | sum(1 << r for r in rows)]
            i += len(run)
        else:
            words.append(0x3000 | on << 11 | row)
            i += 1
    return np.array(words, '<u2')


def caer_words(events, time_base):
    """libcaer: address and 31 bits of microseconds."""
    since = (events.t - time_base) // 1000 % 2**31
    address = events.x.astype(np.int64) << 17 | events.y.astype(np.int64) << 2 | events.p << 1 | 1
    return np.column_stack([address, since]).astype('<u4')


def mono_words(events, time_base):
    """Mono: 32 bits of nanoseconds, column, row, polarity."""
    word = (events.t - time_base).astype(np.uint64) | events.x.astype(np.uint64) << 32
    return word | events.y.astype(np.uint64) << 48 | events.p.astype(np.uint64) << 63


def evt2_words(events, edges=()):
    """EVT 2.0; edges of (t in us, source, rising)."""
    items = [(int(t) // 1000, 0, i) for i, t in enumerate(events.t)]
    items += [(edge[0], 1, edge) for edge in edges]
    words, high = [], None
    for now, kind, what in sorted(items, key=lambda item: item[:2]):
        if now >> 6 != high:
            high = now >> 6
            words.append(0x8 << 28 | high & 0xFFFFFFF)
        low = (now & 0x3F) << 22
        if kind:
            words.append(0xA << 28 | low | what[1] << 8 | what[2])
        else:
            x, y, p = int(events.x[what]), int(events.y[what]), int(events.p[what])
            words.append(p << 28 | low | x << 11 | y)
    return np.array(words, '<u4')


def packet_message(
    data, encoding, *, stamp_ns=0, sequence=0, time_base=0, width=346, height=260, big_endian=0
):
    """CDR bytes of an EventPacket."""
    writer = CdrWriter()
    writer.stamp(stamp_ns)
    writer.text('camera')
    writer.u32(height)
    writer.u32(width)
    writer.u64(sequence)
    writer.u64(time_base)
    writer.text(encoding)
    writer.u8(big_endian)
    writer.octets(np.ascontiguousarray(data).tobytes())
    return writer.finish()


def evt21_words(events):
    """EVT 2.1: one pixel a word, in the place of its block of 32."""
    out, high = [], None
    for t, x, y, p in zip(*(getattr(events, c).tolist() for c in COLUMNS), strict=True):
        now = t // 1000
        if now >> 6 != high:
            high = now >> 6
            out.append((0x8 << 28 | high) << 32)
        block = x // 32 * 32
        upper = p << 28 | (now & 0x3F) << 22 | block << 11 | y
        out.append(upper << 32 | 1 << (x - block))
    return np.array(out, '<u8')


def dat_bytes(events, *, width=346, height=260):
    """A DAT file of version 2."""
    head = f'% Data file containing CD events.\n% Version 2\n% Height {height}\n% Width {width}\n'
    words = np.empty((len(events), 2), '<u4')
    words[:, 0] = events.t // 1000 % 2**32
    words[:, 1] = events.x | events.y.astype(np.uint32) << 14 | events.p.astype(np.uint32) << 28
    return head.encode() + struct.pack('BB', 0x0C, 8) + words.tobytes()


def large_dat_file(path, millions):
    """A DAT file of that many million events, 60 ms of each million, written piece by piece."""
    octets = dat_bytes(some_events(10**6, width=346))
    head, words = octets[:-8_000_000], np.frombuffer(octets[-8_000_000:], '<u4').reshape(-1, 2)
    with path.open('wb') as file:
        file.write(head)
        for k in range(millions):
            piece = words.copy()
            piece[:, 0] += 60_000 * k
            file.write(piece.tobytes())
    return path


def nmnist_bytes(events):
    """An N-MNIST file: x, y, and polarity above 23 bits of microseconds, big-endian."""
    t = events.t // 1000
    octets = [events.x, events.y, events.p << 7 | t >> 16, t >> 8 & 0xFF, t & 0xFF]
    return np.column_stack(octets).astype(np.uint8).tobytes()
