"""Lockstep: start order does not matter, and the streams are the same to the byte.

Those of three processes, and of a composed loop, are the sampled ones in test_scenarios.py.
"""

import itertools
import time

from loop_support import (
    listening,
    ros_arguments,
    start,
    stop,
    stop_all,
)

from dvs_common.wire import topics

NODES = ('plant_sim', 'event_camera', 'hinf_controller')
STREAMS = (topics.EVENTS, topics.COMMAND)


def streams_started_in(order, domain, processes, samples):
    with listening(domain) as listener:
        for executable in order:
            arguments = ros_arguments({'duration': samples * 0.001})
            processes.append(start(executable, domain, arguments))
            time.sleep(0.6)
        listener.spin_until(
            lambda: all(len(set(listener.streams[topic])) > samples for topic in STREAMS)
        )
        stop_all(processes[-3:])
    # A sample that waits for a late partner is sent, and answered, again with the same bytes.
    return {topic: list(dict.fromkeys(stream)) for topic, stream in listener.streams.items()}


def test_all_six_start_orders_give_the_same_bytes(new_domain, processes):
    # Fewer than are latched: a listener that is matched late misses none.
    samples = 90
    results = {
        order: streams_started_in(order, new_domain(), processes, samples)
        for order in itertools.permutations(NODES)
    }

    first = results[NODES]
    assert [len(first[topic]) for topic in STREAMS] == [samples + 1, samples + 1]
    assert len(set(first[topics.COMMAND])) > 60
    for order, streams in results.items():
        assert streams == first, order


def test_a_restarted_plant_takes_no_latched_command_of_an_earlier_run(domain, processes):
    """The earlier run's commands are latched, from stamp 0 on: each must be asked for anew."""
    samples = 400
    with listening(domain) as listener:
        for executable in ('event_camera', 'hinf_controller'):
            processes.append(start(executable, domain))
        first = start('plant_sim', domain, ros_arguments({'duration': 1000.0}))
        processes.append(first)
        commands = listener.streams[topics.COMMAND]
        assert listener.spin_until(lambda: len(commands) > samples + 100)
        first.kill()
        first.wait()
        listener.spin_until(lambda: False, timeout_s=1.0)
        former = commands[-1]
        commands.clear()

        second = start('plant_sim', domain, ros_arguments({'duration': samples * 0.001}))
        processes.append(second)
        output, _ = second.communicate(timeout=60)
        listener.spin_until(lambda: False, timeout_s=1.0)

    assert second.returncode == 0, output
    # The last one of the earlier run may be sent again to who comes late: it is from the future.
    assert '(2 so far)' not in output
    assert f'finished: {samples} cycles' in output
    answers = {command[:12] for command in set(commands) - {former}}
    assert len(answers) == samples + 1


def test_a_missing_partner_is_named(domain, processes):
    plant = start('plant_sim', domain)
    processes.append(plant)

    assert any('luminosity has no subscriber; is event_camera running?' in s for s in plant.stdout)
    assert stop(plant)[0] == 0
