"""A relay drops, doubles, reorders and delays the messages of a loop: it heals itself."""

import random

import pytest
from loop_support import operating, ros_arguments, start, stop_all
from sensor_msgs.msg import Image, JointState, PointCloud2
from test_kill_rounds import ROUNDING, Rounds

from dvs_common.wire import topics
from dvs_common.wire.events import parse_events

KINDS = {
    'luminosity': Image,
    'events': PointCloud2,
    'command': JointState,
    'keyframe': PointCloud2,
}
# Who publishes what under another name, so that it passes through the relay.
SOURCES = {
    'plant_sim': ('luminosity',),
    'event_camera': ('events', 'keyframe'),
    'hinf_controller': ('command',),
}
SHARE = 0.002
# Keyframes are rare, and so are packets with events in them.
KEYFRAME_SHARE = 0.3
EVENTS_SHARE = 0.1


def qos_of(topic, mode):
    if topic == 'keyframe':
        return topics.latched_qos(depth=1)
    return topics.stream_qos() if topic == 'luminosity' else topics.handshake_qos(mode)


def share_of(topic, message):
    if topic == 'events' and len(parse_events(message).events):
        return EVENTS_SHARE
    return KEYFRAME_SHARE if topic == 'keyframe' else SHARE


class Relay:
    """Passes messages on; now and then it loses, doubles, delays one or swaps it with the next."""

    def __init__(self, operator, seed, mode):
        self._random = random.Random(seed)
        self.disturbed = 0
        self.is_quiet = False
        for topic, kind in KINDS.items():
            qos = qos_of(topic, mode)
            publisher = operator.node.create_publisher(kind, topic, qos)
            self._carry(operator.node, kind, topic, qos, publisher)

    def _carry(self, node, kind, topic, qos, publisher):
        held = []

        def take(message):
            waiting = held[:]
            held.clear()
            if self.is_quiet or self._random.random() > share_of(topic, message):
                copies = [message]
            else:
                self.disturbed += 1
                way = self._random.choice(('drop', 'double', 'hold'))
                copies = {'drop': [], 'double': [message] * 2, 'hold': []}[way]
                if way == 'hold':
                    # It comes after its successor: late, and out of order.
                    held.append(message)
            for sent in (*copies, *waiting):
                publisher.publish(sent)

        node.create_subscription(kind, f'{topic}_sent', take, qos, raw=True)


def relayed(seed, samples, domain, processes, mode='lockstep'):
    with operating(domain) as operator:
        relay = Relay(operator, seed, mode)
        rounds = Rounds(operator, domain, processes, mode, seed)
        for name, sent in SOURCES.items():
            arguments = ros_arguments({'duration': 0.0}, rounds.file)
            for topic in sent:
                arguments += ['-r', f'{topic}:={topic}_sent']
            rounds.running[name] = start(name, domain, arguments)
            processes.append(rounds.running[name])
        while len(rounds.states) < samples:
            ratio = rounds.ratio_while_exact()
            assert ratio <= 1 + ROUNDING, (ratio, rounds.health)
        relay.is_quiet = True
        rounds.forget()
        operator.spin_until(lambda: rounds.is_inside() or rounds.has_run_away(), timeout_s=60)
        assert rounds.is_inside() or (mode == 'realtime' and rounds.has_named_an_error()), (
            rounds.health
        )
        for _ in range(3):
            ratio = rounds.ratio_while_exact()
            assert ratio <= 1 + ROUNDING, (ratio, rounds.health)
        disturbed = relay.disturbed
        assert rounds.exact_windows > 2
        assert rounds.judged_windows or rounds.has_named_an_error(), rounds.health
    stop_all(processes)
    return disturbed


def test_a_lockstep_loop_heals_itself_behind_a_relay_that_disturbs_its_messages(domain, processes):
    assert relayed(1, 2000, domain, processes) > 5


def test_a_realtime_loop_is_never_silently_wrong_behind_such_a_relay(domain, processes):
    assert relayed(2, 1500, domain, processes, 'realtime') > 5


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.parametrize('mode', ['lockstep', 'realtime'])
@pytest.mark.parametrize('seed', range(2, 7))
def test_a_loop_heals_itself_behind_a_relay_for_long(seed, mode, domain, processes):
    assert relayed(seed, 20_000, domain, processes, mode) > 50
