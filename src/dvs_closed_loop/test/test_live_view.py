"""What the live page gets: small frames of what is on the streams."""

import json
import re
from importlib.resources import files

import numpy as np
import pytest
from recording_cases import PERIOD_NS, packet, small_run

from dvs_closed_loop import dashboard
from dvs_closed_loop.dashboard.live_view import LiveView
from dvs_common.nanoseconds import NANOSECONDS
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire import topics
from dvs_common.wire.events import LABELLED_EVENT_DTYPE, EventPacket, pack_events
from dvs_common.wire.messages import Vector, pack_estimate, pack_image, pack_state

SCENARIO = Scenario.from_values({})


def frame_of(view, recorded, scenario=SCENARIO, wall_s=0.0):
    for topic, _, data in recorded:
        if topic in view.topics:
            view.receive(topic, data)
    frame = view.frame(scenario, wall_s)
    json.dumps(frame, allow_nan=False)
    return frame


def test_a_frame_shows_the_last_sample_and_few_others():
    frame = frame_of(LiveView(), small_run(200))

    assert len(frame['state']) == len(frame['command']) == len(frame['samples']) == 12
    assert frame['state'][-1] == [1.99, 0.2321, -0.0928]
    # The run rests at set_point as it is printed; the error counts from the nearest equilibrium.
    held = SCENARIO.equilibrium.state
    distance = np.linalg.norm(np.array(SCENARIO['set_point']) - held)
    assert frame['error'][-1] == [1.99, pytest.approx(distance, rel=1e-5)]
    assert frame['scenario']['set_point'] == held.tolist()
    assert frame['time'] == 1.99
    assert frame['command'][-1] == [1.99, 0.5]
    assert frame['total_events'] == 100
    assert len(frame['events']) == 100
    assert frame['events'][-1] == [1.99, 0, 1]
    assert frame['lost_events'] == 0


def test_an_estimate_stands_beside_the_luminosity_of_its_sample():
    frame = frame_of(LiveView(), small_run(200))

    assert frame['pixels'] == [0, 1, 2]
    for _, y, z in frame['samples']:
        np.testing.assert_allclose(z, np.array(y) * 1.01, rtol=1e-5)
    bound = SCENARIO.model_reference_bounds
    assert frame['ratio'] == pytest.approx(0.01 / sector_bound(bound), rel=1e-3)


def sector_bound(bounds):
    from dvs_hinf_controller.analysis.sector import sector

    constants = sector(bounds, event_threshold=0.15, log_base=SCENARIO['log_base'])
    return float(np.min(constants.error_bound))


def test_the_next_frame_has_only_what_is_new():
    view = LiveView()
    recorded = small_run(20)
    frame_of(view, recorded[:50])

    frame = frame_of(view, recorded[50:55], wall_s=0.5)

    assert [row[0] for row in frame['state']] == [0.1]
    assert frame['cycles_per_second'] == 2.0
    assert frame['real_time_factor'] == 0.02
    assert not view.has_news


def test_without_a_scenario_there_is_no_error_but_everything_else():
    frame = frame_of(LiveView(), small_run(20), scenario=None)

    assert frame['error'] == [] and frame['ratio'] is None
    assert 'scenario' not in frame
    assert len(frame['state']) == 12 and len(frame['events']) == 10


def test_a_new_run_begins_at_zero():
    view = LiveView()
    frame_of(view, small_run(100))

    frame = frame_of(view, small_run(3)[5:])

    assert frame['restart']
    assert frame['total_events'] == 1
    assert frame['time'] == 0.0


def test_a_run_of_another_plant_begins_anew_whatever_its_stamps():
    view = LiveView()
    frame_of(view, small_run(100))
    late = 1_790_000_000 * NANOSECONDS
    state = Vector(stamp_ns=late, names=('x1', 'x2'), values=np.zeros(2))

    view.begin()
    frame = frame_of(view, [(topics.STATE, 0, pack_state(state))], scenario=None)

    assert frame['restart']
    assert frame['time'] == 0.0
    assert frame['total_events'] == 0 and frame['camera_restarts'] == 0
    assert 'scenario' not in frame and 'certificate' not in frame
    assert not frame_of(view, [])['restart']


def test_a_burst_of_events_is_thinned_and_counted_whole():
    view = LiveView()
    recorded = [(topics.EVENTS, 0, packet(k * PERIOD_NS, 900, 900 * k)) for k in range(3)]

    frame = frame_of(view, recorded)

    assert frame['total_events'] == 2700
    assert frame['events_a_mark'] == 7
    assert len(frame['events']) == 386


def test_a_foreign_message_is_a_fault_of_the_frame_only():
    view = LiveView()

    assert 'wire contract' in frame_of(view, [(topics.STATE, 0, b'\x00\x01\x00\x00')])['fault']
    assert len(frame_of(view, small_run(2))['state']) == 2


def test_a_plant_of_another_order_has_no_error():
    names = ('x1', 'x2', 'x3')
    state = pack_state(Vector(stamp_ns=0, names=names, values=np.ones(3)))

    frame = frame_of(LiveView(), [(topics.STATE, 0, state)])

    assert frame['error'] == []
    assert frame['state'] == [[0.0, 1.0, 1.0, 1.0]]


def test_a_state_that_is_not_finite_and_events_with_labels_are_shown_all_the_same():
    view = LiveView()
    state = Vector(stamp_ns=1_000_000, names=('x1', 'x2'), values=np.array([np.inf, np.nan]))
    view.receive(topics.STATE, pack_state(state))
    labelled = np.zeros(2, LABELLED_EVENT_DTYPE)
    view.receive(topics.EVENTS, pack_events(EventPacket(stamp_ns=1_000_000, events=labelled)))

    frame = frame_of(view, [])

    assert frame['state'] == [[0.0, None, None]]
    assert frame['error'] == [[0.0, None]]
    assert frame['within_tolerance'] is False
    assert len(frame['events']) == 2


def judged(estimate_factor=1.0, off=0.0):
    """Frame of one sample, the estimate off by a factor and the first state by a distance."""
    held = SCENARIO.equilibrium.state
    state = Vector(stamp_ns=0, names=('x1', 'x2'), values=held + [off, 0.0])
    y = SCENARIO.scene.luminosity(SCENARIO.model, held)
    recorded = [
        (topics.STATE, 0, pack_state(state)),
        (topics.LUMINOSITY, 0, pack_image(0, y.reshape(1, 3), '64FC1')),
        (topics.EVENTS, 0, packet(0, 0, 0)),
        (topics.ESTIMATE, 0, pack_estimate(0, y * estimate_factor)),
    ]
    return frame_of(LiveView(), recorded)


def test_a_frame_is_judged_as_a_run_is():
    delta = sector_bound(SCENARIO.model_reference_bounds)
    eps = SCENARIO.objective.tolerance

    assert judged(1 + 0.9 * delta)['in_sector'] is True
    # What five digits show as 1 is beyond the bound all the same.
    beyond = judged(1 + delta * 1.000001)
    assert beyond['ratio'] == pytest.approx(1, abs=2e-6)
    assert beyond['in_sector'] is False
    assert judged(off=0.9 * eps)['within_tolerance'] is True
    assert judged(off=1.1 * eps)['within_tolerance'] is False


def test_a_frame_without_news_is_not_judged():
    frame = LiveView().frame(SCENARIO, 0.0)

    assert frame['within_tolerance'] is None and frame['in_sector'] is None


def test_the_page_judges_nothing_by_itself():
    script = files(dashboard).joinpath('web/dashboard.js').read_text()
    judged_by = re.findall(r"judge\('tile-[a-z]+', (.+)\);", script)

    assert len(judged_by) >= 4
    assert all(re.fullmatch(r'newest\.\w+|[^<>]+ === 0|null', verdict) for verdict in judged_by)
