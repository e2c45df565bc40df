"""Messages of a run become arrays on its samples, or a line on what is missing."""

import numpy as np
import pytest
from recorded_messages import MS, recorded

from dvs_common.wire.messages import Vector, pack_state
from dvs_simulation.judging.trace import IncompleteTraceError, decode_trace

SAMPLES = [([k, -k], [1 + k, 2, 3], [1, 2, 3 + k]) for k in range(4)]


def test_signals_are_put_on_their_samples():
    trace = decode_trace(recorded(SAMPLES, start_ns=7 * MS))

    np.testing.assert_allclose(trace.times_s, [0, 1e-3, 2e-3, 3e-3], atol=1e-15)
    np.testing.assert_array_equal(trace.states, [[k, -k] for k in range(4)])
    np.testing.assert_array_equal(trace.luminosities[:, 0], [1, 2, 3, 4])
    np.testing.assert_array_equal(trace.estimates[:, 2], [3, 4, 5, 6])
    np.testing.assert_array_equal(trace.commands[:, 0], [0, 1, 2, 3])


def test_events_have_their_time_from_the_first_sample_on_and_their_pixel():
    samples = [([0.0], np.ones(6), np.ones(6))] * 3
    trace = decode_trace(recorded(samples, start_ns=10**18, pixels=(2, 3), events_per_sample=2))

    np.testing.assert_allclose(
        trace.event_times_s, [1e-3 - 1e-6, 1e-3, 2e-3 - 1e-6, 2e-3], rtol=1e-12
    )
    trace.events.setflags(write=True)
    trace.events['x'], trace.events['y'] = [0, 2, 1, 2], [0, 0, 1, 1]
    assert trace.event_pixels.tolist() == [0, 2, 4, 5]


def test_a_run_without_events_is_a_trace_too():
    trace = decode_trace(recorded(SAMPLES))

    assert trace.event_times_s.shape == (0,)
    assert trace.event_pixels.shape == (0,)


def test_samples_that_were_never_answered_are_left_out():
    messages = recorded(SAMPLES)
    messages['command'].pop()
    messages['estimate'].pop()

    assert len(decode_trace(messages).times_s) == 3


@pytest.mark.parametrize('topic', ['state', 'luminosity', 'events', 'estimate'])
def test_a_sample_that_is_missing_is_named(topic):
    messages = recorded(SAMPLES)
    del messages[topic][2]

    with pytest.raises(
        IncompleteTraceError, match=f'1 of 4 samples have no {topic}, .*2000000 ns'
    ):
        decode_trace(messages)


@pytest.mark.parametrize('topic', ['command', 'estimate', 'events'])
def test_a_message_that_was_sent_again_counts_once(topic):
    once, twice = recorded(SAMPLES), recorded(SAMPLES)
    twice[topic].insert(2, twice[topic][1])

    for name in ('commands', 'estimates', 'events', 'times_s'):
        assert np.array_equal(
            getattr(decode_trace(once), name), getattr(decode_trace(twice), name)
        )


def test_a_bag_without_commands_gives_no_trace():
    with pytest.raises(IncompleteTraceError, match='no command'):
        decode_trace(recorded([]))


@pytest.mark.parametrize('topic', ['estimate', 'state'])
def test_a_message_of_another_size_is_named(topic):
    messages = recorded([([0.1, 0.2], [0.5, 0.6, 0.7], [0.5, 0.6, 0.7])] * 3)
    alien = Vector(stamp_ns=MS, names=('x1',), values=np.array([1.0]))
    messages[topic][1] = pack_state(alien)

    with pytest.raises(IncompleteTraceError, match=f'messages on {topic} have 1, '):
        decode_trace(messages)
