"""CDR: what is written is read back, and bytes that are missing are reported."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dvs_common.wire.cdr import CdrReader, CdrWriter, MessageError

texts = st.text(st.characters(exclude_categories=['Cs'], exclude_characters='\0'), max_size=12)
stamps = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)
FIELDS = {
    'u8': st.integers(0, 255),
    'u32': st.integers(0, 2**32 - 1),
    'u64': st.integers(0, 2**64 - 1),
    'stamp': stamps,
    'text': texts,
    'octets': st.binary(max_size=20),
    'doubles': st.lists(st.floats(), max_size=5).map(lambda values: np.array(values, dtype=float)),
    'texts': st.lists(texts, max_size=4).map(tuple),
}
programs = st.lists(
    st.one_of(
        *[st.tuples(st.just(kind), values) for kind, values in FIELDS.items()],
    ),
    min_size=1,
    max_size=8,
)


def writer_of(program):
    writer = CdrWriter()
    for kind, value in program:
        getattr(writer, kind)(value)
    return writer


def written(program):
    return writer_of(program).finish()


def read(program, message):
    reader = CdrReader(message)
    return [getattr(reader, kind)() for kind, _ in program]


@given(programs)
def test_fields_read_back_as_they_were_written(program):
    for (kind, value), found in zip(program, read(program, written(program)), strict=True):
        if kind == 'doubles':
            np.testing.assert_array_equal(found, value)
        else:
            assert found == value


@given(programs, st.data())
def test_a_message_cut_anywhere_is_refused(program, data):
    message = written(program)
    cut = data.draw(st.integers(0, writer_of(program).size - 1))

    with pytest.raises(MessageError):
        read(program, message[:cut])


@given(programs)
def test_a_message_is_filled_up_to_whole_words_with_zeros(program):
    message, size = written(program), writer_of(program).size

    assert len(message) == -(-size // 4) * 4
    assert not any(message[size:])


def test_numbers_are_aligned_from_the_end_of_the_header():
    writer = CdrWriter()
    writer.u8(1)
    writer.u32(2)
    writer.u8(3)
    writer.u64(4)
    writer.doubles(np.array([1.0]))

    assert writer.finish().hex(' ', 4) == (
        '00010000 01000000 02000000 03000000 00000000 04000000 00000000 01000000 00000000 '
        '00000000 0000f03f'
    )


def test_an_empty_sequence_of_doubles_is_not_aligned():
    writer = CdrWriter()
    writer.doubles(np.empty(0))
    writer.u32(7)

    assert writer.finish().hex(' ', 4) == '00010000 00000000 07000000'


@pytest.mark.parametrize('header', ['00000000', '00030000', '00070000', '01010000', ''])
def test_another_encapsulation_is_refused_by_name(header):
    named = header[:4] or r'\(none\)'
    with pytest.raises(MessageError, match=f'encapsulation {named} is not plain little'):
        CdrReader(bytes.fromhex(header) + bytes(16 if header else 0))


def test_a_length_beyond_the_message_is_refused_at_once():
    for kind in ('text', 'octets', 'doubles', 'texts'):
        with pytest.raises(MessageError, match='too early'):
            getattr(CdrReader(bytes.fromhex('00010000 ffffffff') + bytes(64)), kind)()


def test_text_that_is_not_utf8_is_replaced():
    assert CdrReader(bytes.fromhex('00010000 03000000 41ff00')).text() == 'A\ufffd'
