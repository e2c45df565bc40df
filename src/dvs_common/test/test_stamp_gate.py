"""One outlier among stamps is refused; a step of the clock is taken when it is certain."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dvs_common.wire.stamp_gate import Passage, StampGate

MS = 1_000_000
SECOND = 1000 * MS


def passages(gate, *stamps):
    return [gate.take(stamp) for stamp in stamps]


@pytest.mark.parametrize('outlier', [-SECOND, 10 * SECOND, 100 * SECOND - 1])
def test_one_outlier_is_refused_and_the_stream_goes_on(outlier):
    gate = StampGate()
    passages(gate, 100 * SECOND, 100 * SECOND + MS)
    assert gate.take(outlier) is Passage.REFUSED
    assert gate.take(100 * SECOND + MS) is Passage.REPEATED
    assert gate.take(100 * SECOND + 2 * MS) is Passage.NEXT
    assert gate.refused == 1


@given(st.integers(-50, -2) | st.integers(2, 50), st.integers(1, 900))
def test_five_samples_that_follow_each_other_are_a_step_of_the_clock(seconds, period_ms):
    gate = StampGate()
    gate.take(60 * SECOND)
    stamps = [(60 + seconds) * SECOND + k * period_ms * MS for k in range(6)]
    # The last of them passes; a stream that overtakes the old time meanwhile passes too.
    found = passages(gate, *stamps)
    if all(not 60 * SECOND <= stamp <= 61 * SECOND for stamp in stamps):
        assert found == [Passage.REFUSED] * 4 + [Passage.STEPPED, Passage.NEXT]


def test_a_partner_that_sends_the_same_sample_again_and_again_is_taken():
    gate = StampGate()
    gate.take(60 * SECOND)
    assert passages(gate, 0, 0, 0) == [Passage.REFUSED, Passage.REFUSED, Passage.STEPPED]


def test_outliers_between_good_stamps_are_never_a_step():
    gate = StampGate()
    for k in range(100):
        assert gate.take(60 * SECOND + k * MS) in (Passage.FIRST, Passage.NEXT)
        assert gate.take(k * MS) is Passage.REFUSED
