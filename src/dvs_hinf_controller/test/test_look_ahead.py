"""The command that is computed before its packet arrives."""

import contextlib
import dataclasses

import numpy as np
from controller_cases import CONTROLLERS, MS, PIXELS, PROBLEM, H, keyframe, packet, running
from hypothesis import given
from hypothesis import strategies as st

from dvs_common.wire.cdr import MessageError

packets = st.lists(
    st.tuples(
        st.sampled_from([MS, MS, MS, 2 * MS, 0]),
        st.lists(
            st.tuples(
                st.integers(-MS, 0),
                st.integers(0, PIXELS - 1),
                st.sampled_from([1, -1]),
                st.just(1),
            ),
            max_size=2,
        ),
        st.sampled_from(['', '', '', 'keyframe', 'redirect', 'threshold', 'back']),
    ),
    max_size=15,
)


@given(packets)
def test_looking_ahead_changes_no_bit(sequence):
    """The same packets, keyframes, thresholds and set-points to one that looks ahead or not."""
    plain, ahead = running(), running()
    stamp_ns, index, epoch = 0, 0, 7
    for duration_ns, rows, happening in sequence:
        stamp_ns = 0 if happening == 'back' else stamp_ns + duration_ns
        epoch += happening == 'back'
        h = 0.5 * H if happening == 'threshold' else H
        given = keyframe(
            stamp_ns, np.arange(PIXELS), epoch=epoch, next_index=index, event_threshold=h
        )
        for controller in (plain, ahead):
            if happening == 'redirect':
                further = dataclasses.replace(
                    PROBLEM, equilibrium=PROBLEM.model.equilibrium([0.3, 0.2], tolerance=1e-9)
                )
                controller.redirect(further, CONTROLLERS['stable'])
            elif happening:
                controller.take_keyframe(given)
        foreseen = ahead.foreseen(packet(stamp_ns, rows, index))
        for controller in (plain, ahead):
            with contextlib.suppress(MessageError):
                controller.take(packet(stamp_ns, rows, index))
        assert ahead.command.tobytes() == plain.command.tobytes()
        assert foreseen is None or foreseen.tobytes() == plain.command.tobytes()
        assert ahead.estimate.tobytes() == plain.estimate.tobytes()
        ahead.look_ahead()
        index += len(rows)


def test_the_answer_to_silence_is_foreseen_and_no_other():
    controller = running()
    controller.take(packet(0))
    controller.take(packet(MS, [(0, 0, 1, 1)]))
    controller.look_ahead()

    assert controller.foreseen(packet(2 * MS)) is not None
    assert controller.foreseen(packet(MS)) is None
    assert controller.foreseen(packet(3 * MS)) is None
    assert controller.foreseen(packet(2 * MS, [(0, 0, 1, 1)], 1)) is None
    controller.take_keyframe(keyframe(2 * MS, np.arange(PIXELS), epoch=7, next_index=1))
    assert controller.foreseen(packet(2 * MS)) is None
