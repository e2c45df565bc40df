"""Every encoding that drivers publish, against encoders of our own and against recordings."""

import hashlib
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_encoders import (
    SAMPLES,
    caer_cmp_words,
    caer_words,
    evt3_words,
    mono_words,
    packet_message,
    same,
    some_events,
    triggers,
)

from dvs_common.wire.cdr import MessageError
from dvs_event_camera.files.open_recording import open_recording
from dvs_event_camera.streams.event_packet import parse_event_packet
from dvs_event_camera.streams.packet_decoder import PacketDecoder
from dvs_event_camera.streams.sensor_events import SensorEvents, joined

EPOCH = 1_700_000_000_000_000_000
ENCODERS = {
    'evt3': lambda events, base: evt3_words(events),
    'libcaer_cmp': caer_cmp_words,
    'libcaer': caer_words,
    'mono': mono_words,
}


def decoded(*messages):
    decoder = PacketDecoder()
    return [decoder.decode(parse_event_packet(message)) for message in messages]


def message_of(events, encoding, base):
    data = ENCODERS[encoding](events, base)
    return packet_message(data, encoding, time_base=0 if encoding == 'evt3' else base)


@given(
    rows=st.lists(
        st.tuples(
            st.integers(0, 2**20), st.integers(0, 345), st.integers(0, 259), st.integers(0, 1)
        ),
        min_size=1,
        max_size=40,
    ),
    encoding=st.sampled_from(sorted(ENCODERS)),
)
@settings(max_examples=200, deadline=None)
def test_every_encoding_gives_back_every_event_in_order(rows, encoding):
    base = 0 if encoding == 'evt3' else EPOCH
    rows = sorted(rows)
    t, x, y, p = np.array(rows, np.int64).T
    events = SensorEvents(
        t=base + 1000 * t, x=x.astype(np.uint16), y=y.astype(np.uint16), p=p.astype(np.uint8)
    )

    (found,) = decoded(message_of(events, encoding, base))

    assert same(found, events)


def test_evt3_keeps_its_time_and_row_from_packet_to_packet():
    events = some_events(2000, start_us=16_770_000, span_us=60_000)  # over 2^24 us
    words = evt3_words(events)
    pieces = np.array_split(words, 7)

    found = joined(decoded(*(packet_message(piece, 'evt3') for piece in pieces)))

    # The clock counts from the first TIME_HIGH, which lies just below the overflow.
    assert same(found, events)


@pytest.mark.parametrize('pieces', [1, 5])
def test_evt3_triggers_are_kept_with_their_times(pieces):
    events = some_events(300)
    edges = [(10_500, 3, 1), (20_000, 3, 0), (59_999, 0, 1)]
    words = evt3_words(events, edges)

    parts = (packet_message(piece, 'evt3') for piece in np.array_split(words, pieces))
    found = joined(decoded(*parts))

    expected = triggers(*((1000 * t, source, rising) for t, source, rising in edges))
    assert np.array_equal(found.triggers.t, expected.t)
    assert np.array_equal(found.triggers.source, expected.source)
    assert np.array_equal(found.triggers.rising, expected.rising)
    assert np.array_equal(found.t, events.t)


def test_events_beyond_the_sensor_are_left_out_as_the_reference_decoder_does():
    events = some_events(500, width=640, height=480)
    inside = (events.x < 346) & (events.y < 260)
    for encoding in ('evt3', 'libcaer_cmp'):
        (found,) = decoded(message_of(events, encoding, 0))
        assert same(found, events.take(inside))


def test_libcaer_rolls_over_within_a_packet():
    events = SensorEvents(
        t=EPOCH + np.array([2**31 - 2, 2**31 - 1, 2**31, 2**31 + 5]) * 1000,
        x=np.arange(4, dtype=np.uint16),
        y=np.arange(4, dtype=np.uint16),
        p=np.array([0, 1, 0, 1], np.uint8),
    )

    (found,) = decoded(message_of(events, 'libcaer', EPOCH))

    assert same(found, events)


def test_libcaer_cmp_words_without_a_known_code_are_passed_over():
    # Words of metavision_driver under the name of libcaer_driver: no event.
    words = np.array([0x8001, 0x6010, 100, 0x2832, 0x2033], '<u2')

    (found,) = decoded(packet_message(words, 'libcaer_cmp', width=640, height=480))

    assert len(found) == 0


def test_packets_of_triggers_alone():
    word = np.array([1 << 63 | 2 << 48 | 77], np.uint64)

    (found,) = decoded(packet_message(word, 'trigger', time_base=1000))

    assert same(
        found,
        SensorEvents(**{c: getattr(found, c) for c in 'txyp'}, triggers=triggers((1077, 2, 1))),
    )


@pytest.mark.parametrize(
    ('message', 'reason'),
    [
        (packet_message(b'', 'jpeg'), 'jpeg'),
        (packet_message(b'1234567', 'mono'), 'multiple of 8'),
        (packet_message(b'123', 'libcaer_cmp'), 'multiple of 2'),
        (packet_message(b'123', 'evt3'), 'multiple of 2'),
        (packet_message(b'', 'mono', big_endian=1), 'big-endian'),
        (packet_message(b'', 'mono')[:-4], 'early'),
    ],
)
def test_what_is_no_packet_is_refused_by_name(message, reason):
    with pytest.raises(MessageError, match=reason):
        decoded(message)


@pytest.mark.skipif(not (SAMPLES / 'truth.json').exists(), reason='no recordings here')
def test_recordings_of_real_drivers_are_decoded_as_the_reference_decoder_does():
    truth = json.loads((SAMPLES / 'truth.json').read_text())
    for name, expected in truth.items():
        for path in (SAMPLES / name, (SAMPLES / name).parent):
            recording = open_recording(path)
            digest, events, first, last = hashlib.sha256(), 0, None, None
            for stretch in recording.read():
                packed = stretch.events.packed()
                digest.update(packed.tobytes())
                events += len(packed)
                first = first or packed[0].tolist()
                last = packed[-1].tolist()
            assert recording.encoding == expected['encoding']
            assert [recording.width, recording.height] == [expected['width'], expected['height']]
            assert (events, list(first), list(last)) == (
                expected['events'],
                expected['first'],
                expected['last'],
            )
            assert digest.hexdigest() == expected['sha256_of_packed_i8_u2_u2_u1']
