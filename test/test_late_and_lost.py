"""A controller that starts late, or loses events, becomes exact again by a keyframe."""

import math
import signal
from dataclasses import replace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from loop_support import CONFIG, UNHURRIED, operating, ros_arguments, start, stop, stop_all
from sensor_msgs.msg import Image, JointState, PointCloud2
from std_msgs.msg import Empty
from test_health import latest, reaches, values
from test_kill_rounds import stamp_of

from dvs_common.scenario.scenario import load_scenario
from dvs_common.wire import topics
from dvs_common.wire.events import EventPacket, make_events, pack_events
from dvs_common.wire.keyframe import Keyframe, pack_keyframe, parse_keyframe
from dvs_common.wire.messages import pack_image
from dvs_hinf_controller.analysis.sector import sector
from dvs_simulation.judging.measures import largest, sector_ratio

SCENARIO = load_scenario(CONFIG / 'mirror_r3.yaml')
# Below h_certified, so that nothing else is to be warned of.
H = 0.1
# Nanoseconds from the present sample, and what is seen then.
OUT_OF_TIME = (
    (-50_000_000, 0.5),
    (-1_000_000_000, 0.5),
    (10_000_000_000, 0.5),
    (-1_000_000_000, 0.0),
    (-1_000_000_000, math.nan),
)


def packet(stamp_ns, pixels, polarities, first_index):
    count = len(pixels)
    events = make_events(
        times_ns=np.full(count, stamp_ns, dtype=np.int64),
        pixels=np.array(pixels, dtype=np.int32),
        polarities=np.array(polarities, dtype=np.int8),
        signs=np.ones(count, dtype=np.int8),
        width=3,
        stamp_ns=stamp_ns,
        first_index=first_index,
    )
    return pack_events(EventPacket(stamp_ns=stamp_ns, events=events))


def is_exact(messages, **figures):
    status = latest(messages, 'hinf_controller')
    said = {} if status is None else {v.key: v.value for v in status.values}
    wanted = {'estimator': 'exact', **figures}
    return status is not None and wanted.items() <= said.items()


def expected_estimate(counts):
    constants = sector(
        SCENARIO.model_reference_bounds, event_threshold=H, log_base=SCENARIO['log_base']
    )
    return constants.initial_estimate * np.exp(np.array(counts) * H)


def test_a_refused_keyframe_proves_nothing_and_a_gap_is_asked_about_and_put_right(
    domain, processes
):
    controller = start('hinf_controller', domain, ros_arguments({'event_threshold': H}))
    processes.append(controller)
    with operating(domain) as operator:
        estimates = operator.collect(JointState, 'estimate', 100)
        requests = operator.collect(Empty, 'keyframe_request', 100)
        messages = operator.collect(DiagnosticArray, '/diagnostics', 100)
        events = operator.node.create_publisher(
            PointCloud2, 'events', topics.handshake_qos('lockstep')
        )
        keyframes = operator.node.create_publisher(
            PointCloud2, 'keyframe', topics.latched_qos(depth=1)
        )

        def send(message):
            received = len(estimates)
            events.publish(message)
            assert operator.spin_until(lambda: len(estimates) > received)

        def keyframe(stamp_ns, counts, next_index=0):
            bounds = SCENARIO.model_reference_bounds
            pixels = slice(len(counts))
            state = Keyframe(
                stamp_ns=stamp_ns,
                epoch=7,
                age_s=stamp_ns * 1e-9,
                events=next_index,
                next_index=next_index,
                event_threshold=H,
                counts=np.array(counts),
                signs=np.ones(len(counts), dtype=np.int8),
                lower=bounds.lower[pixels],
                upper=bounds.upper[pixels],
            )
            keyframes.publish(pack_keyframe(state, height=1, width=len(counts)))

        assert operator.spin_until(lambda: events.get_subscription_count() == 1)
        assert operator.spin_until(lambda: operator.node.count_publishers('estimate') == 1)
        operator.spin_until(lambda: False, timeout_s=0.5)
        send(packet(0, [], [], 0))
        keyframe(0, [0, 0])

        def is_refused():
            status = latest(messages, 'hinf_controller')
            reported = {} if status is None else {v.key: v.value for v in status.values}
            return (
                reported.get('messages refused') == '1'
                and reported['estimator'] == 'no keyframe yet'
            )

        assert operator.spin_until(is_refused)
        keyframe(0, [0, 0, 0])
        assert operator.spin_until(lambda: is_exact(messages))
        send(packet(1_000_000, [0, 1], [1, -1], 0))
        assert np.allclose(estimates[-1].position, expected_estimate([1, -1, 0]), rtol=1e-14)

        # Three events, numbers 2 to 4, never arrive.
        requests.clear()
        send(packet(3_000_000, [2], [1], 5))
        assert operator.spin_until(lambda: requests)
        assert reaches(operator, messages, 'hinf_controller', DiagnosticStatus.ERROR, 'lost')
        send(packet(4_000_000, [0], [1], 6))
        keyframe(3_000_000, [4, -1, 1], next_index=6)
        assert operator.spin_until(lambda: is_exact(messages, resynchronisations='1'))
        send(packet(5_000_000, [], [], 7))

        assert np.array_equal(estimates[-1].position, expected_estimate([5, -1, 1]))
        figures = {v.key: v.value for v in latest(messages, 'hinf_controller').values}
        assert figures['events lost'] == '3'
        assert figures['resynchronisations'] == '1'

        # Frames contradict the last pixel again and again.
        anchors = operator.node.create_publisher(Image, 'anchor', topics.stream_qos())
        assert operator.spin_until(lambda: anchors.get_subscription_count() == 1)
        certified = float(figures['h_certified'])
        light = np.array(estimates[-1].position)
        for k, factor in enumerate((3, 1 / 3, 3, 1 / 3), start=6):
            y = (light * [1, 1, factor]).reshape(1, 3)
            anchors.publish(pack_image(k * 1_000_000, y, '64FC1'))
            send(packet(k * 1_000_000, [], [], 7))

        def is_masked():
            status = latest(messages, 'hinf_controller')
            reported = {} if status is None else {v.key: v.value for v in status.values}
            others = reported.get('h_certified', 'being worked out')
            return reported.get('pixels masked') == '1' and others not in (
                'being worked out',
                str(certified),
            )

        messages.clear()
        assert operator.spin_until(is_masked)
        figures = {v.key: v.value for v in latest(messages, 'hinf_controller').values}
        assert figures['masked pixels'] == '2'
        assert 0 < float(figures['h_certified']) != certified
    _, output = stop(controller)
    assert '3 events were lost before 0.003000 s' in output
    assert 'resynchronised by a keyframe: 1 pixels corrected' in output


def test_unknown_references_end_a_controller_that_is_to_stop_then(domain, processes):
    stopping = {'event_threshold': H, 'unknown_references': 'stop'}
    controller = start('hinf_controller', domain, ros_arguments(stopping))
    processes.append(controller)
    unknown = Keyframe(
        stamp_ns=0,
        epoch=7,
        age_s=0.0,
        events=0,
        next_index=0,
        event_threshold=H,
        counts=np.zeros(3, np.int64),
        signs=np.ones(3, np.int8),
        lower=np.zeros(3),
        upper=np.full(3, np.inf),
    )
    with operating(domain) as operator:
        commands = operator.collect(JointState, 'command', topics.handshake_qos('lockstep'))
        health = operator.collect(DiagnosticArray, '/diagnostics', 100)
        keyframes = operator.node.create_publisher(
            PointCloud2, 'keyframe', topics.latched_qos(depth=1)
        )
        events = operator.node.create_publisher(
            PointCloud2, 'events', topics.handshake_qos('lockstep')
        )
        assert operator.spin_until(lambda: keyframes.get_subscription_count() == 1)
        keyframes.publish(pack_keyframe(unknown, height=1, width=3))
        operator.spin_until(lambda: False, timeout_s=0.3)
        events.publish(packet(0, [], [], 0))
        assert operator.spin_until(lambda: controller.poll() is not None)
    output, _ = controller.communicate()
    assert controller.returncode == 4, output
    assert 'references unknown (unknown_references: stop)' in output
    # Until then an ERROR, and the input that holds the equilibrium.
    said = [(status.level, status.message) for message in health for status in message.status]
    assert any(l == DiagnosticStatus.ERROR and 'references unknown' in m for l, m in said)
    assert np.allclose(commands[0].position, SCENARIO.equilibrium.feedforward)


def test_a_controller_that_starts_late_is_resynchronised(domain, processes):
    arguments = ros_arguments(
        {
            'mode': 'realtime',
            'sampling_period': 0.004,
            'duration': 0.0,
            'nonphysical_luminosity': 'clamp',
        }
    )
    for executable in ('event_camera', 'hinf_controller', 'plant_sim'):
        processes.append(
            start(executable, domain, [*arguments, '-p', 'nonphysical_luminosity:=clamp'])
        )
    with operating(domain) as operator:
        messages = operator.collect(DiagnosticArray, '/diagnostics', 100)
        assert operator.spin_until(lambda: is_exact(messages))
        operator.spin_until(lambda: False, timeout_s=1.0)
        stop(processes[1])
        operator.forget(messages)
        late = start('hinf_controller', domain, arguments)
        processes.append(late)

        assert operator.spin_until(lambda: is_exact(messages))
    _, output = stop(late)
    assert 'resynchronised by a keyframe' in output


def worst_sector_ratio(operator, luminosities, estimates):
    """Worst |z - y| / (delta_z |y|) of the samples to come."""
    operator.forget(luminosities, estimates)
    assert operator.spin_until(lambda: len(luminosities) > 200 and len(estimates) > 200)
    bound = sector(
        SCENARIO.model_reference_bounds, event_threshold=0.15, log_base=SCENARIO['log_base']
    ).error_bound
    y = {stamp_of(image): np.frombuffer(image.data) for image in luminosities}
    z = {stamp_of(estimate): np.array(estimate.position) for estimate in estimates}
    shared = sorted(y.keys() & z.keys())
    assert len(shared) > 150
    rows = [np.array([found[stamp] for stamp in shared]) for found in (y, z)]
    return largest(sector_ratio(*rows, error_bound=bound, dead_band=0.0))


@pytest.mark.parametrize(
    'order',
    [
        ('event_camera',),
        ('event_camera', 'hinf_controller'),
        ('hinf_controller', 'event_camera'),
        ('event_camera', 'deactivate'),
    ],
    ids='-'.join,
)
def test_a_camera_that_starts_again_in_the_midst_gives_its_references(order, domain, processes):
    started = {}
    for executable in ('plant_sim', 'hinf_controller', 'event_camera'):
        started[executable] = start(executable, domain, ros_arguments(UNHURRIED))
        processes.append(started[executable])
    with operating(domain) as operator:
        messages = operator.collect(DiagnosticArray, '/diagnostics', 100)
        luminosities = operator.collect(Image, 'luminosity', 1000)
        estimates = operator.collect(JointState, 'estimate', 1000)
        # Near the set-point, far from what the parameters say of the first references.
        assert operator.spin_until(lambda: is_exact(messages) and len(luminosities) > 500)
        for executable in order:
            if executable != 'deactivate':
                started[executable].kill()
                started[executable].wait()
        for executable in order:
            if executable != 'deactivate':
                started[executable] = start(executable, domain)
                processes.append(started[executable])
        if 'deactivate' in order:
            assert operator.transition('hinf_controller', 'deactivate')
            assert operator.transition('hinf_controller', 'activate')
        operator.forget(messages)
        assert operator.spin_until(lambda: is_exact(messages))
        assert worst_sector_ratio(operator, luminosities, estimates) <= 1 + 1e-9
    stop_all(list(started.values()))


def test_a_wrong_initial_state_and_messages_out_of_time_leave_the_estimate_in_its_sector(
    domain, processes
):
    loop = ros_arguments(UNHURRIED)
    for executable in ('plant_sim', 'event_camera'):
        processes.append(start(executable, domain, loop))
    wrong = [*loop, '-p', 'initial_state:=[0.9, 0.2]']
    processes.append(start('hinf_controller', domain, wrong))
    with operating(domain) as operator:
        messages = operator.collect(DiagnosticArray, '/diagnostics', 100)
        luminosities = operator.collect(Image, 'luminosity', 1000)
        estimates = operator.collect(JointState, 'estimate', 1000)
        assert operator.spin_until(lambda: is_exact(messages))
        assert worst_sector_ratio(operator, luminosities, estimates) <= 1 + 1e-9

        packets = operator.collect(PointCloud2, 'events', topics.handshake_qos('lockstep', 100))
        light = operator.node.create_publisher(Image, 'luminosity', topics.stream_qos())
        events = operator.node.create_publisher(
            PointCloud2, 'events', topics.handshake_qos('lockstep', 100)
        )
        assert operator.spin_until(lambda: any(p.width for p in packets))
        # This process, and the one that they are for.
        assert operator.spin_until(
            lambda: min(p.get_subscription_count() for p in (light, events)) >= 2
        )
        for offset_ns, y in OUT_OF_TIME:
            stamp_ns = stamp_of(luminosities[-1]) + offset_ns
            light.publish(pack_image(stamp_ns, np.full((1, 3), y), '64FC1'))
        events.publish(next(p for p in reversed(packets) if p.width))

        def are_counted():
            statuses = [latest(messages, name) for name in ('event_camera', 'hinf_controller')]
            if None in statuses:
                return False
            camera, controller = map(values, statuses)
            again = ('packets received twice', 'packets out of time', 'messages refused')
            return int(camera['frames out of time']) == len(OUT_OF_TIME) and any(
                int(controller[key]) for key in again
            )

        assert operator.spin_until(are_counted)
        assert is_exact(messages)
        assert worst_sector_ratio(operator, luminosities, estimates) <= 1 + 1e-9
    stop_all(processes)


def test_a_controller_that_starts_after_a_change_of_threshold_is_exact(domain, processes):
    for executable in ('plant_sim', 'event_camera', 'hinf_controller'):
        processes.append(start(executable, domain, ros_arguments(UNHURRIED)))
    plant = processes[0]
    with operating(domain) as operator:
        messages = operator.collect(DiagnosticArray, '/diagnostics', 100)
        states = operator.collect(JointState, 'state', 100)
        estimates = operator.collect(JointState, 'estimate', 100)
        keyframes = []
        operator.node.create_subscription(
            PointCloud2, 'keyframe', keyframes.append, topics.latched_qos(depth=1), raw=True
        )
        asking = operator.node.create_publisher(Empty, 'keyframe_request', topics.stream_qos())

        def passes(samples):
            seen = len(states)
            return operator.spin_until(lambda: len(states) > seen + samples, timeout_s=60)

        assert passes(500)
        for threshold in (0.1, 0.08):
            assert operator.set_parameters('event_camera', event_threshold=threshold).successful
            assert passes(300)
        code, output = stop(processes[-1])
        assert code == 0, output
        operator.forget(messages)
        processes.append(start('hinf_controller', domain))
        assert operator.spin_until(lambda: is_exact(messages, h='0.08'))
        assert passes(300)
        plant.send_signal(signal.SIGSTOP)
        operator.forget(keyframes)
        asking.publish(Empty())
        assert operator.spin_until(lambda: keyframes)
        assert np.array_equal(estimates[-1].position, estimate_of(keyframes[-1], 0.08))
        plant.send_signal(signal.SIGCONT)
    *_, output = stop_all(processes)
    assert 'resynchronised by a keyframe: 3 pixels corrected' in output


def estimate_of(message, event_threshold):
    """What the counts of a keyframe mean."""
    keyframe = parse_keyframe(bytes(message))
    first = SCENARIO.model_reference_bounds
    assert np.all(keyframe.lower != first.lower)
    bounds = replace(first, lower=keyframe.lower, upper=keyframe.upper)
    constants = sector(bounds, event_threshold=event_threshold, log_base=SCENARIO['log_base'])
    log_b = np.log(SCENARIO['log_base'])
    return constants.initial_estimate * np.exp(keyframe.counts * (event_threshold * log_b))
