"""Messages that never came, by the numbers that their publisher gave them."""

import pytest

from dvs_common.node.message_information import Arrivals, publication_ns


def missed(*numbers):
    arrivals = Arrivals()
    return [arrivals.missed_before({'publication_sequence_number': n}) for n in numbers]


@pytest.mark.parametrize(
    ('numbers', 'expected'),
    [
        ((1, 2, 3), [0, 0, 0]),
        # Who comes late has missed nothing that was meant for it.
        ((700, 701), [0, 0]),
        ((5, 9, 10, 300), [0, 3, 0, 289]),
        # Another publisher, or the same once more.
        ((5, 1, 2), [0, 0, 0]),
        ((5, 5, 6), [0, 0, 0]),
        # A middleware that gives no numbers.
        ((None, None), [0, 0]),
    ],
)
def test_messages_that_never_came_are_counted_by_their_numbers(numbers, expected):
    assert missed(*numbers) == expected


def test_a_time_of_publication_that_is_not_known_is_none():
    assert publication_ns({'source_timestamp': 0}) is None
    assert publication_ns({'source_timestamp': 17}) == 17
