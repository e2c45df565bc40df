"""Mutated messages and files: they are refused or read, and what comes out of them is finite.

Twenty thousand mutated messages a topic go through the parser and the core that stand behind the
topic in the nodes; `test_fuzz_nodes.py` sends some hundreds to the nodes themselves.
"""

import numpy as np
import pytest
from mutations import Mutations

from dvs_common.scenario.scenario import Scenario
from dvs_common.wire.anchor import Anchor, pack_anchor, parse_anchor
from dvs_common.wire.cdr import CdrWriter, MessageError
from dvs_common.wire.events import EventPacket, make_events, pack_events, parse_events
from dvs_common.wire.keyframe import Keyframe, pack_keyframe, parse_keyframe
from dvs_common.wire.messages import (
    Vector,
    pack_command,
    pack_image,
    pack_state,
    parse_command,
    parse_state,
)
from dvs_common.wire.stamp_gate import Passage, StampGate
from dvs_event_camera.event_camera import EventCamera
from dvs_event_camera.streams.image_source import parse_compressed, parse_luminosity
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_hinf_controller.running.make_controller import event_controller

MESSAGES = 20_000
PERIOD_NS = 1_000_000
SCENARIO = Scenario.from_values({})
PIXELS = SCENARIO.scene.pixel_count
HEIGHT, WIDTH = SCENARIO.pixels.pixel_grid


def luminosity(k):
    return pack_image(k * PERIOD_NS, np.full((HEIGHT, WIDTH), 0.5 + 1e-4 * k), '64FC1')


def events(k):
    stamp_ns = k * PERIOD_NS
    made = make_events(
        times_ns=np.array([stamp_ns - 10, stamp_ns]),
        pixels=np.array([0, PIXELS - 1]),
        polarities=np.array([1, -1], np.int8),
        signs=np.ones(2, np.int8),
        width=WIDTH,
        stamp_ns=stamp_ns,
        first_index=2 * k,
    )
    return pack_events(EventPacket(stamp_ns=stamp_ns, events=made))


def keyframe(k):
    bounds = SCENARIO.model_reference_bounds
    state = Keyframe(
        stamp_ns=k * PERIOD_NS,
        epoch=7,
        age_s=k * PERIOD_NS * 1e-9,
        events=2 * k,
        next_index=2 * k,
        event_threshold=SCENARIO.sensor.event_threshold,
        counts=np.zeros(PIXELS, np.int64),
        signs=np.ones(PIXELS, np.int8),
        lower=bounds.lower,
        upper=bounds.upper,
    )
    return pack_keyframe(state, height=HEIGHT, width=WIDTH)


def anchor(k):
    measured = Anchor(stamp_ns=k * PERIOD_NS, luminosity=np.full(PIXELS, 0.5))
    return pack_anchor(measured, height=HEIGHT, width=WIDTH)


def command(k):
    return pack_command(Vector(stamp_ns=k * PERIOD_NS, names=('u1',), values=np.array([0.1])))


def state(k):
    values = np.array([0.1, 0.2])
    return pack_state(Vector(stamp_ns=k * PERIOD_NS, names=('x1', 'x2'), values=values))


GOOD = {
    'luminosity': luminosity,
    'events': events,
    'keyframe': keyframe,
    'anchor': anchor,
    'command': command,
    'state': state,
}
OTHERS = tuple(make(1) for make in GOOD.values())


class Controller:
    """Controller that has begun, and takes every message of its topics."""

    def __init__(self):
        self._core = event_controller(design_from_scenario(SCENARIO), SCENARIO)
        self.events(events(0))
        self.keyframe(keyframe(0))

    def events(self, message):
        self._core.take(parse_events(message))
        assert np.isfinite(self._core.command).all()
        assert np.isfinite(self._core.estimate).all()

    def keyframe(self, message):
        self._core.take_keyframe(parse_keyframe(message))
        assert np.isfinite(self._core.command).all()

    def anchor(self, message):
        self._core.take_anchor(parse_anchor(message))
        assert np.isfinite(self._core.command).all()


class Camera:
    """Camera that has begun."""

    def __init__(self):
        self._core = EventCamera.of_scenario(SCENARIO)
        self._gate = StampGate()
        self.luminosity(luminosity(0))

    def luminosity(self, message):
        frame = parse_luminosity(message)
        passage = self._gate.take(frame.stamp_ns)
        if passage is Passage.REFUSED:
            raise MessageError('out of time')
        if passage is Passage.STEPPED:
            self._core.restart('a step')
        exposure = self._core.take(frame)
        if exposure is not None:
            for packet in exposure.packets:
                assert len(pack_events(packet))
        height, width = self._core.shape
        parse_keyframe(pack_keyframe(self._core.keyframe(), height=height, width=width))


def taker(topic):
    if topic in ('events', 'keyframe', 'anchor'):
        return getattr(Controller(), topic)
    if topic == 'luminosity':
        return Camera().luminosity
    return {'command': parse_command, 'state': parse_state}[topic]


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('topic', GOOD)
def test_a_mutated_message_is_read_or_refused(topic):
    mutations = Mutations(seed=11, others=OTHERS)
    take, make = taker(topic), GOOD[topic]
    refused = 0
    for k in range(MESSAGES):
        try:
            take(mutations.of(make(k)))
        except MessageError as error:
            refused += 1
            assert len(str(error)) < 500

    assert MESSAGES // 5 < refused < MESSAGES


def test_a_mutated_picture_is_read_or_refused():
    cv2 = pytest.importorskip('cv2')
    _, picture = cv2.imencode('.png', np.arange(64, dtype=np.uint8).reshape(8, 8))
    writer = CdrWriter()
    writer.stamp(PERIOD_NS)
    writer.text('pixels')
    writer.text('png')
    writer.octets(picture.tobytes())
    mutations = Mutations(seed=12, others=OTHERS)
    refused = 0
    for _ in range(200):
        try:
            parse_compressed(mutations.of(writer.finish()))
        except MessageError:
            refused += 1

    assert refused > 50
