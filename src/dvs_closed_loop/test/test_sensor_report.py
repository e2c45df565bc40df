"""The report of a sensor's recording: what it holds, and a figure of it."""

import numpy as np
from sensor_encoders import dat_bytes, some_events

from dvs_closed_loop.cli import main
from dvs_closed_loop.reports.sensor_report import SensorCounts


def test_events_are_counted_by_time_polarity_and_pixel():
    events = some_events(5000, width=20, height=10, span_us=95_000)
    counts = SensorCounts(20, 10)
    for part in (slice(0, 1234), slice(1234, None)):
        counts.add(events.take(part))

    interval = (events.t - events.t[0]) // 10_000_000
    for polarity in (0, 1):
        expected = [np.sum((interval == k) & (events.p == polarity)) for k in range(10)]
        assert counts.rates[polarity].tolist() == expected
    assert counts.pixels.sum() == 5000
    assert counts.pixels[3, 7] == np.sum((events.x == 7) & (events.y == 3))


def test_a_file_of_a_sensor_is_reported_and_what_is_cut_off_is_named(tmp_path, capsys):
    path = tmp_path / 'sensor.dat'
    path.write_bytes(dat_bytes(some_events(1000))[:-3])

    code = main(['report', str(path), '--output', str(tmp_path / 'out')])

    out, err = capsys.readouterr()
    assert code == 1
    assert 'dat, 346 x 260 pixels' in out
    assert ' 999 events in 0.0' in out
    assert 'ends in the middle of a word' in err
    assert (tmp_path / 'out' / 'sensor' / 'report.png').read_bytes().startswith(b'\x89PNG')
