"""Quality of service of the wire contract."""

import pytest
from rclpy.qos import DurabilityPolicy, HistoryPolicy, ReliabilityPolicy

from dvs_common.wire import topics


@pytest.mark.parametrize(
    ('size', 'depth'), [(16, 4000), (16_000, 4000), (160_000, 400), (1280 * 720 * 16, 100)]
)
def test_a_listener_may_be_away_for_long_where_messages_are_small(size, depth):
    assert topics.history_depth(size) == depth
    assert depth == 100 or depth * size <= 64e6


@pytest.mark.parametrize(
    ('size', 'depth'), [(8, 100), (2_560_000, 100), (1280 * 720 * 8, 34), (10**9, 8)]
)
def test_what_waits_for_a_camera_that_does_not_keep_up_is_bounded(size, depth):
    assert topics.backlog_depth(size) == depth


@pytest.mark.parametrize(
    ('mode', 'durability'),
    [('lockstep', DurabilityPolicy.TRANSIENT_LOCAL), ('realtime', DurabilityPolicy.VOLATILE)],
)
def test_only_the_token_of_lockstep_waits_for_a_late_reader(mode, durability):
    qos = topics.handshake_qos(mode, 7)

    assert (qos.durability, qos.depth) == (durability, 7)
    assert (qos.reliability, qos.history) == (ReliabilityPolicy.RELIABLE, HistoryPolicy.KEEP_LAST)
    assert topics.stream_qos().durability == DurabilityPolicy.VOLATILE
    assert topics.handshake_qos(mode).depth == topics.stream_qos().depth == 100


@pytest.mark.parametrize(
    ('offered', 'reliability', 'durability'),
    [
        ([], 'RELIABLE', 'TRANSIENT_LOCAL'),
        ([topics.latched_qos()], 'RELIABLE', 'TRANSIENT_LOCAL'),
        ([topics.latched_qos(), topics.stream_qos()], 'RELIABLE', 'VOLATILE'),
        ([topics.latched_qos(), topics.clock_qos()], 'BEST_EFFORT', 'VOLATILE'),
    ],
)
def test_a_subscription_asks_for_what_every_publisher_offers(offered, reliability, durability):
    asked = topics.latched_qos(12)
    fitting = topics.fitting_qos(asked, offered)

    assert (fitting.reliability.name, fitting.durability.name) == (reliability, durability)
    assert (fitting.depth, asked.reliability.name) == (12, 'RELIABLE')
