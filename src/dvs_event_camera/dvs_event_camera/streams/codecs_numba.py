"""Compiled decoders: `libcaer_cmp`, the words of libcaer_driver, and EVT 2.0 and 2.1.

Layout of the words: `libcaer_cmp_types.h` of github.com/ros-event-camera/event_camera_codecs, and
Prophesee, "EVT 2.0 format" and "EVT 2.1 format".
"""

from __future__ import annotations

from typing import Any

from dvs_common.kernel_cache import kernel

# libcaer_cmp: four bits of code, twelve of content.
_TIME_HIGH, _TIME_LOW, _ADDRESS_X, _ADDRESS_Y, _BASE_Y, _VECTOR_8 = range(6)
_EVT3_TRIGGER = 0xA


@kernel
def count_caer(words: Any) -> int:
    """Count the events in libcaer_cmp words, wherever they lie.

    Parameters
    ----------
    words
        uint16, shape (W,).
    """
    events = 0
    for i in range(words.size):
        word = int(words[i])
        code = word >> 12
        if code == _ADDRESS_Y:
            events += 1
        elif code == _VECTOR_8:
            valid = word & 0xFF
            while valid:
                valid &= valid - 1
                events += 1
    return events


@kernel
def decode_caer(
    words: Any, time_base: int, width: int, height: int, t: Any, x: Any, y: Any, p: Any
) -> int:
    """Decode libcaer_cmp words; return the number of events within the sensor.

    Words of an unknown code are passed over, as the reference decoder does.

    Parameters
    ----------
    words
        uint16, shape (W,).
    time_base
        Time from which the packet counts, ns.
    width
        Columns of the sensor.
    height
        Rows of the sensor.
    t, x, y, p
        Out: times (int64, ns), columns, rows (uint16) and polarities (uint8), as many as
        `count_caer` finds.
    """
    high, low = 0, 0
    column, base, polarity = 0, 0, 0
    now = time_base
    number = 0
    for i in range(words.size):
        word = int(words[i])
        code = word >> 12
        if code == _ADDRESS_Y:
            row = word & 0x7FF
            if column < width and row < height:
                t[number], x[number], y[number] = now, column, row
                p[number] = word >> 11 & 1
                number += 1
        elif code == _ADDRESS_X:
            column = word & 0x7FF
        elif code == _TIME_LOW:
            low = word & 0xFFF
            now = time_base + 1000 * (high | low)
        elif code == _TIME_HIGH:
            high = (word & 0xFFF) << 12
            now = time_base + 1000 * (high | low)
        elif code == _BASE_Y:
            base, polarity = word & 0x7FF, word >> 11 & 1
        elif code == _VECTOR_8:
            for bit in range(8):
                row = base + bit
                if word >> bit & 1 and column < width and row < height:
                    t[number], x[number], y[number] = now, column, row
                    p[number] = polarity
                    number += 1
            base += 8
    return number


@kernel
def count_evt3_triggers(words: Any) -> int:
    """Count the trigger edges in EVT 3.0 words.

    Parameters
    ----------
    words
        uint16, shape (W,).
    """
    found = 0
    for i in range(words.size):
        found += (words[i] >> 12) == _EVT3_TRIGGER
    return found


@kernel
def date_evt3(micro: Any, x: Any, y: Any, width: int, height: int, t: Any) -> int:
    """Times in nanoseconds; return how many events lie outside the sensor.

    Parameters
    ----------
    micro
        Microseconds, uint64, shape (E,).
    x, y
        Columns and rows, uint16, shape (E,).
    width
        Columns of the sensor.
    height
        Rows of the sensor.
    t
        Out: nanoseconds, int64, shape (E,).
    """
    outside = 0
    for i in range(micro.size):
        t[i] = micro[i] * 1000
        outside += (x[i] >= width) | (y[i] >= height)
    return outside


_EVT2_TIME_HIGH, _EVT2_TRIGGER = 0x8, 0xA
# A TIME_HIGH of 28 bits that goes back by nearly all of them has rolled over (as in OpenEB).
_EVT2_OVERFLOW = 2**28
_EVT2_ROLLED = 2**28 - 1 - 10_000 // 64


@kernel
def count_evt2(words: Any, masks: Any) -> tuple[int, int]:
    """Count the events and trigger edges in EVT 2.0 or 2.1 words.

    Parameters
    ----------
    words, masks
        As `decode_evt2` takes them.
    """
    events, triggers = 0, 0
    for i in range(words.size):
        code = words[i] >> 28
        if code <= 1:
            mask = int(masks[i])
            while mask:
                mask &= mask - 1
                events += 1
        elif code == _EVT2_TRIGGER:
            triggers += 1
    return events, triggers


@kernel
def decode_evt2(
    words: Any, masks: Any, state: Any, t: Any, x: Any, y: Any, p: Any, edges: Any
) -> tuple[int, int]:
    """Decode EVT 2.0 words, or the upper halves of those of EVT 2.1; return events and edges.

    Parameters
    ----------
    words
        uint32, shape (W,).
    masks
        uint32, shape (W,): which of the 32 pixels from x on fired; 1 in EVT 2.0.
    state
        TIME_HIGH with its overflows, and whether there was one; int64, shape (2,), zero at first.
        Moved on.
    t, x, y, p
        Out: times (int64, ns), columns, rows (uint16), polarities (uint8) of events.
    edges
        Out: times (ns), inputs and directions of trigger edges, int64, shape (., 3).
    """
    high, known = state[0], state[1]
    events, triggers = 0, 0
    for i in range(words.size):
        word = int(words[i])
        code = word >> 28
        if code == _EVT2_TIME_HIGH:
            now = word & 0xFFFFFFF
            last = high & 0xFFFFFFF
            if known and last - now >= _EVT2_ROLLED:
                high += _EVT2_OVERFLOW
            high = (high & ~0xFFFFFFF) | now
            known = 1
        elif not known:
            continue
        elif code <= 1:
            now = 1000 * (high << 6 | (word >> 22 & 0x3F))
            mask = int(masks[i])
            column = word >> 11 & 0x7FF
            while mask:
                if mask & 1:
                    t[events], x[events], y[events] = now, column, word & 0x7FF
                    p[events] = code
                    events += 1
                mask >>= 1
                column += 1
        elif code == _EVT2_TRIGGER:
            edges[triggers, 0] = 1000 * (high << 6 | (word >> 22 & 0x3F))
            edges[triggers, 1] = word >> 8 & 0x1F
            edges[triggers, 2] = word & 1
            triggers += 1
    state[0], state[1] = high, known
    return events, triggers
