"""The table of events, its files and its statistics, from a bag."""

import csv
import math
import re

import numpy as np
import pytest

from dvs_common.wire.events import EVENT_DTYPE, EventPacket, make_events, pack_events
from dvs_event_camera.files.bag_recording import CloudDecoder
from dvs_event_camera.streams.event_packet import pack_event_packet
from dvs_event_camera.tools import show_events
from dvs_event_camera.tools.stream_statistics import StreamStatistics

rosbag2 = pytest.importorskip('rosbags.rosbag2')

MS = 1_000_000
START = 1_700_000_000_000_000_000


def packets():
    rng = np.random.default_rng(0)
    index = 0
    for k in range(1, 6):
        count = int(rng.integers(1, 6))
        stamp = START + k * MS
        yield EventPacket(
            stamp_ns=stamp,
            events=make_events(
                times_ns=np.sort(rng.integers(stamp - MS + 1, stamp + 1, count)),
                pixels=rng.integers(0, 12, count),
                polarities=rng.choice(np.array([-1, 1], np.int8), count),
                signs=np.ones(count, np.int8),
                width=4,
                stamp_ns=stamp,
                first_index=index,
            ),
        )
        index += count


def rows():
    return [
        (int(e['x']), int(e['y']), p.stamp_ns + int(e['t']), int(e['polarity']))
        for p in packets()
        for e in p.events
    ]


@pytest.fixture(params=['PointCloud2', 'EventPacket'])
def bag(request, tmp_path):
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    definition = (
        'std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\n'
        'string encoding\nbool is_bigendian\nuint8[] events\n'
    )
    store.register(get_types_from_msg(definition, 'event_camera_msgs/msg/EventPacket'))
    clouds = request.param == 'PointCloud2'
    kind = 'sensor_msgs/msg/PointCloud2' if clouds else 'event_camera_msgs/msg/EventPacket'
    path = tmp_path / 'bag'
    with rosbag2.Writer(path, version=9) as writer:
        connection = writer.add_connection('/robot/events', kind, typestore=store)
        other = writer.add_connection('/robot/other', 'std_msgs/msg/String', typestore=store)
        writer.write(other, START, b'\x00\x01\x00\x00\x01\x00\x00\x00\x00')
        for number, packet in enumerate(packets()):
            message = (
                pack_events(packet)
                if clouds
                else pack_event_packet(packet, height=3, width=4, sequence=number)
            )
            writer.write(connection, packet.stamp_ns + 2 * MS, message)
    return path


def test_events_are_shown_as_a_table(bag, capsys):
    assert show_events.main(['show_events', str(bag)]) == 0
    out, err = capsys.readouterr()
    lines = [tuple(map(int, line.split())) for line in out.splitlines()[1:]]
    assert out.split('\n')[0].split() == ['x', 'y', 't', 'p']
    assert sorted(lines) == sorted(rows())
    assert [line[2] for line in lines] == sorted(line[2] for line in lines)
    assert re.search(rf'5 packets, {len(rows())} events .* events/s, .* ON, 0 lost, 0 out of', err)


def test_csv_and_npz(bag, tmp_path, capsys):
    table, archive = tmp_path / 'events.csv', tmp_path / 'events.npz'
    arguments = ['show_events', str(bag), '--csv', str(table), '--npz', str(archive)]
    assert show_events.main(arguments) == 0
    assert capsys.readouterr().out == ''
    # Microseconds and what is beyond them; OFF is 0, as other programs have it.
    expected = sorted((x, y, t, max(p, 0)) for x, y, t, p in rows())
    with table.open(newline='') as stream:
        head, *lines = csv.reader(stream)
    assert head == ['t', 'x', 'y', 'p', 'ns']
    numbers = [tuple(map(int, line)) for line in lines]
    assert sorted((x, y, 1000 * t + ns, p) for t, x, y, p, ns in numbers) == expected
    with np.load(archive) as found:
        columns = [found[name] for name in 'xytp']
    assert [column.dtype.str[1:] for column in columns] == ['u2', 'u2', 'i8', 'u1']
    assert sorted(zip(*(c.tolist() for c in columns), strict=True)) == expected


def test_limit_and_seconds_bound_what_is_shown(bag, capsys):
    show_events.main(['show_events', str(bag), '--limit', '3'])
    assert len(capsys.readouterr().out.splitlines()) == 4
    show_events.main(['show_events', str(bag), '--seconds', '0.0015'])
    times = [int(line.split()[2]) for line in capsys.readouterr().out.splitlines()[1:]]
    assert max(times) <= START + 2 * MS


@pytest.mark.parametrize(
    'arguments',
    [
        ['/nowhere'],
        ['BAG', '--topic', 'other'],
        ['BAG', '--csv', '/nowhere/e.csv'],
        ['BAG', '--limit', '-3'],
        ['BAG', '--seconds', 'nan'],
    ],
)
def test_what_is_wrong_is_printed_in_one_line(arguments, bag, capsys):
    arguments = [str(bag) if a == 'BAG' else a for a in arguments]
    assert show_events.main(['show_events', *arguments]) == (1 if '--csv' in arguments else 2)
    err = capsys.readouterr().err
    assert err.startswith('show_events: ')
    assert err.count('\n') == 1


def stretches(*packets, received_ns=None):
    """Stretches of packets as they are read one after the other."""
    decoder = CloudDecoder()
    received_ns = received_ns or [packet.stamp_ns for packet in packets]
    return [
        decoder.decode(pack_events(packet), received)
        for packet, received in zip(packets, received_ns, strict=True)
    ]


def test_statistics_count_losses_and_disorder():
    statistics = StreamStatistics()
    found = list(packets())
    received = [p.stamp_ns + 4 * MS + MS * (k % 2) for k, p in enumerate(found)]
    kept = [0, 1, 3, 4, 0]
    shown = stretches(*(found[k] for k in kept), received_ns=[received[k] for k in kept])
    for stretch in shown[:4]:
        statistics.add(stretch)
    report = statistics.report()
    assert report.messages == 4
    assert report.lost_events == len(found[2].events)
    assert report.unordered_events == 0
    assert report.delay_s == pytest.approx(0.0045, abs=6e-4)
    # A camera that begins anew has lost nothing.
    statistics.add(shown[4])
    again = statistics.report()
    assert (again.restarts, again.lost_events) == (1, report.lost_events)
    assert again.seconds == pytest.approx(report.seconds, abs=2e-3)
    assert ', 1 restarts, ' in str(again)


def test_an_index_that_goes_back_is_a_restart_and_a_packet_twice_counts_once():
    def packet(stamp_ns, index):
        events = np.zeros(1, EVENT_DTYPE)
        events['index'] = index
        return EventPacket(stamp_ns=stamp_ns, events=events)

    statistics = StreamStatistics()
    for stretch in stretches(*(packet(*p) for p in ((0, 10), (MS, 4), (MS, 4), (2 * MS, 5)))):
        statistics.add(stretch)
    report = statistics.report()

    assert (report.lost_events, report.restarts, report.repeated) == (0, 1, 1)
    assert (report.messages, report.events) == (4, 3)
    assert ', 1 restarts, 1 packets twice, ' in str(report)


def test_an_event_from_before_the_last_packet_is_out_of_order():
    events = np.zeros(2, EVENT_DTYPE)
    events['index'] = [0, 1]
    late = np.zeros(2, EVENT_DTYPE)
    late['index'], late['t'] = [2, 3], [-3 * MS, 0]
    statistics = StreamStatistics()
    for stretch in stretches(
        EventPacket(stamp_ns=START, events=events), EventPacket(stamp_ns=START + MS, events=late)
    ):
        statistics.add(stretch)

    report = statistics.report()

    assert (report.unordered_events, report.lost_events, report.restarts) == (1, 0, 0)


@pytest.mark.parametrize(
    ('events', 'rate'),
    [(20, '20.0 events/s'), (9_000, '9000.0 events/s'), (50_000, '0.050 Mev/s')],
)
def test_the_rate_is_printed_in_a_unit_that_can_be_read(events, rate):
    second = np.zeros(events, EVENT_DTYPE)
    second['index'] = np.arange(events)
    statistics = StreamStatistics()
    for stretch in stretches(
        EventPacket(stamp_ns=0, events=second[:0]), EventPacket(stamp_ns=10**9, events=second)
    ):
        statistics.add(stretch)

    assert f' in 1.000 s: {rate}, ' in str(statistics.report())


def test_empty_stream_has_a_line_too():
    report = StreamStatistics().report()

    assert str(report) == 'no packet received'
    assert math.isnan(report.delay_s)


def test_a_packet_without_events_has_no_rate_and_no_share():
    statistics = StreamStatistics()
    silence = EventPacket(stamp_ns=0, events=np.zeros(0, EVENT_DTYPE))
    statistics.add(stretches(silence, received_ns=[10**18])[0])

    assert '1 packets, 0 events in 0.000 s: - events/s, - % ON' in str(statistics.report())
    assert 'delay unknown (stamps are of another clock), jitter -' in str(statistics.report())
