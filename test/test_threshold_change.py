"""Camera and estimator change the threshold together and stay in the sector of Lemma 4."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dvs_common.scenario.scenario import Scenario
from dvs_common.wire.events import NO_EVENTS, EventPacket
from dvs_common.wire.keyframe import pack_keyframe, parse_keyframe
from dvs_common.wire.messages import pack_image
from dvs_event_camera.event_camera import EventCamera
from dvs_event_camera.streams.image_source import parse_luminosity
from dvs_hinf_controller.analysis.sector import sector
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_hinf_controller.running.event_controller import EventController
from dvs_hinf_controller.running.reference_state import Synchrony
from dvs_simulation.judging.measures import kept, sector_ratio

SCENARIO = Scenario.from_values({})
DESIGN = design_from_scenario(SCENARIO)
PERIOD_NS = 1_000_000


@settings(max_examples=30, deadline=None)
@given(
    thresholds=st.lists(st.floats(0.02, 0.4), min_size=1, max_size=3),
    steps=st.lists(st.floats(-0.2, 0.2), min_size=60, max_size=60),
)
def test_the_estimate_stays_in_its_sector_and_a_late_one_finds_it(thresholds, steps):
    camera = EventCamera.of_scenario(SCENARIO)
    controller = EventController(
        DESIGN.problem, DESIGN.controller, event_threshold=0.15, command_limit=np.array([np.inf])
    )
    first = SCENARIO.scene.luminosity(SCENARIO.model, SCENARIO.initial_state)
    walk = np.concatenate([[0.0], np.cumsum(steps)])
    changes = dict(zip((15, 30, 45), thresholds, strict=False))
    for k, level in enumerate(walk):
        stamp_ns = k * PERIOD_NS
        y = first * np.exp(level)
        frame = parse_luminosity(pack_image(stamp_ns, y.reshape(1, 3), '64FC1'))
        packets = camera.take(frame).packets
        if k in changes:
            camera.change_event_threshold(SCENARIO.replace(event_threshold=changes[k]))
        if not k or k in changes:
            controller.take_keyframe(camera.keyframe())
        for packet in packets:
            controller.take(packet)
        bound = sector(
            DESIGN.problem.bounds,
            event_threshold=controller.event_threshold,
            log_base=SCENARIO['log_base'],
        ).error_bound
        ratios = sector_ratio(y, controller.estimate, error_bound=bound, dead_band=0.0)
        assert kept(ratios).all()

    late = EventController(
        DESIGN.problem,
        DESIGN.controller,
        event_threshold=controller.event_threshold,
        command_limit=np.array([np.inf]),
    )
    late.take(EventPacket(stamp_ns=stamp_ns, events=NO_EVENTS))
    keyframe = camera.keyframe()
    late.take_keyframe(parse_keyframe(pack_keyframe(keyframe, height=1, width=3)))
    assert controller.take_keyframe(keyframe).resynchronised_pixels == 0
    assert controller.synchrony is late.synchrony is Synchrony.EXACT
    np.testing.assert_allclose(late.estimate, controller.estimate, rtol=1e-12)
