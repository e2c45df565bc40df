"""Sample k waits for command k, once, however often samples and commands are repeated."""

import pytest

from dvs_common.wire.cdr import MessageError
from dvs_plant_sim.handshake import Handshake


def test_only_the_first_command_with_the_awaited_stamp_counts():
    handshake = Handshake(period_ns=10, last_sample=2)
    handshake.sent()
    assert handshake.accepts(0)
    assert not handshake.accepts(0)
    assert handshake.next() == 10
    handshake.sent()
    assert not handshake.accepts(0)
    assert handshake.accepts(10)


def test_a_command_from_the_future_is_refused():
    handshake = Handshake(period_ns=10, last_sample=0)
    handshake.sent()
    with pytest.raises(MessageError, match='stamped 10 ns, awaited 0 ns'):
        handshake.accepts(10)
    assert handshake.accepts(0)


def test_no_command_is_taken_before_the_first_sample_is_sent():
    handshake = Handshake(period_ns=10, last_sample=0)

    assert not handshake.accepts(0)
    assert not handshake.accepts(1_000)
    handshake.sent()
    assert handshake.accepts(0)


def test_turns_count_without_an_answer():
    handshake = Handshake(period_ns=10, last_sample=0)
    handshake.sent()
    assert [handshake.wait() for _ in range(3)] == [1, 2, 3]
    handshake.accepts(0)
    assert handshake.wait() == 0
    handshake.next()
    handshake.sent()
    assert handshake.wait() == 1


@pytest.mark.parametrize(('last', 'ends'), [(0, [False] * 4), (2, [False, False, True, False])])
def test_the_last_sample_ends_the_run(last, ends):
    handshake = Handshake(period_ns=10, last_sample=last)
    found = []
    for _ in range(4):
        found.append(handshake.is_last)
        handshake.next()
    assert found == ends
