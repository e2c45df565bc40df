"""Latencies of the stages of a cycle, from times of reception that are known."""

import numpy as np
import pytest

from dvs_closed_loop.bags.bag import RecordedBag, RecordedMessage
from dvs_closed_loop.commands.latency import stage_latencies, table
from dvs_common.errors import ParameterError
from dvs_common.wire import topics
from dvs_common.wire.events import EVENT_DTYPE, EventPacket, pack_events
from dvs_common.wire.messages import Vector, pack_command, pack_image

MS = 1_000_000


def image(stamp):
    return pack_image(stamp, np.ones((1, 1)), '64FC1')


def events(stamp):
    return pack_events(EventPacket(stamp_ns=stamp, events=np.empty(0, EVENT_DTYPE)))


def command(stamp):
    return pack_command(Vector(stamp_ns=stamp, names=('u1',), values=np.zeros(1)))


def bag_of(path, *messages):
    return RecordedBag(
        path=path,
        messages=tuple(RecordedMessage(topic=t, received_ns=at, data=d) for t, at, d in messages),
        names={},
        ignored=(),
        scenario=None,
        scenario_name='test',
        writer='test',
    )


def test_every_stage_is_measured_from_first_receptions(tmp_path):
    bag = bag_of(
        tmp_path,
        (topics.LUMINOSITY, 0, image(5)),
        (topics.LUMINOSITY, 1 * MS, image(5)),
        (topics.EVENTS, 2 * MS, events(5)),
        (topics.COMMAND, 5 * MS, command(5)),
        (topics.LUMINOSITY, 10 * MS, image(6)),
        (topics.EVENTS, 14 * MS, events(6)),
        (topics.COMMAND, 20 * MS, command(6)),
        (topics.LUMINOSITY, 30 * MS, image(7)),
    )
    camera, controller, both = stage_latencies(bag)

    np.testing.assert_allclose(camera.times_s, [2e-3, 4e-3])
    np.testing.assert_allclose(controller.times_s, [3e-3, 6e-3])
    np.testing.assert_allclose(both.times_s, [5e-3, 10e-3])
    assert 'luminosity -> command       7.500' in table([camera, controller, both])


def test_a_bag_without_a_cycle_is_refused(tmp_path):
    with pytest.raises(ParameterError, match='no cycle from luminosity to command'):
        stage_latencies(bag_of(tmp_path, (topics.LUMINOSITY, 0, image(5))))
