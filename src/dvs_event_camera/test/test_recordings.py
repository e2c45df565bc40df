"""Files of events: read what others write, write what others read, lose nothing in between."""

import json
import subprocess
import sys
import zipfile

import h5py
import numpy as np
import pytest
from recording_files import EDGES, convert, raw_file
from sensor_encoders import (
    dat_bytes,
    evt2_words,
    evt3_words,
    evt21_words,
    nmnist_bytes,
    same,
    some_events,
    triggers,
)

from dvs_common.errors import ParameterError
from dvs_event_camera.files.damage import DamagedFile
from dvs_event_camera.files.open_recording import open_recording
from dvs_event_camera.streams.sensor_events import SensorEvents, joined
from dvs_event_camera.tools import convert_events, show_events

SUFFIXES = ('.txt', '.csv', '.npz', '.npy', '.h5', '.aedat4')


def read(path, topic=None):
    return joined([stretch.events for stretch in open_recording(path, topic).read()])


def read_until_damage(path):
    parts = []
    with pytest.raises(DamagedFile) as raised:
        for stretch in open_recording(path).read():
            parts.append(stretch.events)
    return joined(parts), str(raised.value)


@pytest.fixture
def labelled(events, tmp_path):
    """A recording with labels, in nanoseconds."""
    noise = (np.arange(len(events)) % 3 == 0).astype(np.uint8)
    path = tmp_path / 'labelled.npz'
    t = events.t + np.arange(len(events)) % 1000
    np.savez(path, x=events.x, y=events.y, t=t, p=events.p, noise=noise, width=640, height=480)
    return SensorEvents(t=t, x=events.x, y=events.y, p=events.p, noise=noise), path


@pytest.mark.parametrize(
    ('head', 'encode', 'encoding'),
    [
        ('% format EVT2;height=480;width=640\n% end\n', evt2_words, 'evt2'),
        ('% date today\n% evt 2.0\n% geometry 640x480\n', evt2_words, 'evt2'),
        ('% format EVT3;height=480;width=640\n% end\n', evt3_words, 'evt3'),
        ('% evt 3.0\n% geometry 640x480\n% end\n', evt3_words, 'evt3'),
        ('% evt 2.1\n% geometry 640x480\n% end\n', evt21_words, 'evt21'),
    ],
)
def test_raw_files_of_every_encoding_are_read(head, encode, encoding, events, tmp_path):
    path = raw_file(tmp_path / 'r.raw', head, encode(events))
    recording = open_recording(path)

    assert (recording.encoding, recording.width, recording.height) == (encoding, 640, 480)
    assert same(read(path), events)


def test_evt21_of_the_first_sensors_has_its_halves_swapped(events, tmp_path):
    halves = evt21_words(events).view('<u4').reshape(-1, 2)[:, ::-1]
    head = '% format EVT21;endianness=legacy;height=480;width=640\n% end\n'

    assert same(read(raw_file(tmp_path / 'r.raw', head, halves)), events)


def test_triggers_of_raw_files(raw, events, tmp_path):
    expected = triggers(*((1000 * t, source, rising) for t, source, rising in EDGES))
    evt3 = raw_file(tmp_path / '3.raw', '% evt 3.0\n% end\n', evt3_words(events, EDGES))
    for path in (raw, evt3):
        found = read(path).triggers
        assert np.array_equal(found.t, expected.t)
        assert np.array_equal(found.source, expected.source)
        assert np.array_equal(found.rising, expected.rising)


def test_evt2_goes_on_after_its_clock_has_run_over(tmp_path):
    over = 2**34
    events = some_events(50, start_us=over - 20_000, span_us=40_000)

    found = read(raw_file(tmp_path / 'r.raw', '% evt 2.0\n% end\n', evt2_words(events)))

    assert same(found, events)


def test_dat_files_and_their_clock_that_runs_over(tmp_path):
    events = some_events(500, start_us=2**32 - 20_000, span_us=40_000)
    path = tmp_path / 'd.dat'
    path.write_bytes(dat_bytes(events))

    assert same(read(path), events)
    assert (open_recording(path).width, open_recording(path).height) == (346, 260)


def test_files_of_nmnist_are_read(tmp_path):
    events = some_events(1000, width=34, height=34, start_us=0, span_us=300_000)
    path = tmp_path / '00001.bin'
    path.write_bytes(nmnist_bytes(events))

    assert same(read(path), events)
    assert open_recording(path).width == 34


@pytest.mark.parametrize(
    ('head', 'line', 'unit'),
    [
        ('', '{x} {y} {t} {p}', 1),
        ('    x     y                   t  p\n', '{x} {y} {t} {q:+d}', 1),
        ('x,y,t,p\n', '{x},{y},{t},{q}', 1),
        ('', '{s:.6f} {x} {y} {p}', 1),
        ('# t x y p\n', '{s:.9f} {x} {y} {p}', 1),
        ('', '{u} {x} {y} {p}', 1),
        ('timestamp,x,y,polarity\n', '{u},{x},{y},{p}', 1),
    ],
)
def test_text_with_and_without_a_head_is_read(head, line, unit, events, tmp_path):
    path = tmp_path / 'e.txt'
    rows = [
        line.format(x=x, y=y, t=t, p=p, q=2 * p - 1, s=t / 1e9, u=t // 1000)
        for t, x, y, p in zip(
            events.t.tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist(), strict=True
        )
    ]
    path.write_text(head + '\n'.join(rows) + '\n')

    assert same(read(path), events)


def test_text_keeps_nanoseconds_since_the_epoch(tmp_path):
    path = tmp_path / 'e.txt'
    path.write_text('1744227144.732712001 1 2 0\n1744227145.000000003 3 4 1\n')

    assert read(path).t.tolist() == [1744227144732712001, 1744227145000000003]


def test_hdf5_in_the_layouts_of_others(events, tmp_path):
    micro = events.t // 1000
    with h5py.File(tmp_path / 'dsec.h5', 'w') as file:
        columns = {'x': events.x, 'y': events.y, 't': (micro - 7).astype('u4'), 'p': events.p}
        for name, column in columns.items():
            file.create_dataset(f'events/{name}', data=column, compression='gzip')
        file['t_offset'] = np.int64(7)
    with h5py.File(tmp_path / 'metavision.hdf5', 'w') as file:
        kind = [('x', '<u2'), ('y', '<u2'), ('p', '<i2'), ('t', '<i8')]
        records = np.empty(len(events), kind)
        for name, column in (('x', events.x), ('y', events.y), ('p', events.p), ('t', micro)):
            records[name] = column
        file['CD/events'] = records
        edges = np.array([(1, 500, 2)], [('p', '<i2'), ('t', '<i8'), ('id', '<i2')])
        file['EXT_TRIGGER/events'] = edges
        file.attrs['geometry'] = '640x480'
    with h5py.File(tmp_path / 'v2e.h5', 'w') as file:
        file['events'] = np.column_stack([micro, events.x, events.y, events.p]).astype('u4')
    with h5py.File(tmp_path / 'utils.h5', 'w') as file:
        columns = {'xs': events.x, 'ys': events.y, 'ts': micro * 1e-6, 'ps': events.p == 1}
        for name, column in columns.items():
            file[f'events/{name}'] = column

    assert same(read(tmp_path / 'dsec.h5'), events)
    found = read(tmp_path / 'metavision.hdf5')
    assert found.triggers.t.tolist() == [500_000]
    assert np.array_equal(found.packed(), events.packed())
    assert open_recording(tmp_path / 'metavision.hdf5').width == 640
    assert same(read(tmp_path / 'v2e.h5'), events)
    assert same(read(tmp_path / 'utils.h5'), events)


@pytest.mark.parametrize('suffix', SUFFIXES)
def test_a_converted_recording_is_the_same(suffix, raw, events, tmp_path, capsys):
    target = convert(raw, tmp_path / f'out{suffix}')
    found = read(target)

    assert np.array_equal(found.packed(), events.packed())
    assert found.triggers.t.tolist() == [1000 * t for t, _, _ in EDGES]
    assert found.triggers.source.tolist() == [0, 1]
    assert found.triggers.rising.tolist() == [1, 0]
    capsys.readouterr()
    summaries = []
    for path in (raw, target):
        assert show_events.main(['show_events', str(path), '--json']) == 0
        summaries.append(json.loads(capsys.readouterr().out))
    assert summaries[0].pop('encoding') == 'evt2'
    summaries[1].pop('encoding')
    assert summaries[0] == summaries[1]


@pytest.mark.parametrize('suffix', ['.txt', '.csv', '.npz', '.npy', '.h5'])
def test_labels_and_nanoseconds_are_never_lost(suffix, labelled, tmp_path):
    events, path = labelled

    assert same(read(convert(path, tmp_path / f'out{suffix}')), events)


def test_aedat4_has_no_place_for_labels_and_refuses_them(labelled, tmp_path, capsys):
    _, path = labelled

    assert convert_events.main([str(path), str(tmp_path / 'out.aedat4')]) == 2
    assert 'no place for noise labels' in capsys.readouterr().err
    assert not (tmp_path / 'out.aedat4').exists()


@pytest.mark.parametrize(
    ('suffix', 'cut'),
    [
        ('.raw', 3),
        ('.dat', 3),
        ('.bin', 2),
        ('.txt', 4),
        ('.csv', 4),
        ('.npy', 5),
        ('.aedat4', 400),
    ],
)
def test_a_file_that_ends_early_is_read_up_to_there(suffix, cut, raw, tmp_path, capsys):
    small = some_events(100, width=34, height=34)
    path = tmp_path / f'whole{suffix}'
    if suffix == '.raw':
        path = raw
    elif suffix == '.dat':
        path.write_bytes(dat_bytes(small))
    elif suffix == '.bin':
        path.write_bytes(nmnist_bytes(small))
    else:
        convert(raw, path)
    whole = read(path)
    cut_file = tmp_path / f'cut{suffix}'
    cut_file.write_bytes(path.read_bytes()[:-cut])

    found, message = read_until_damage(cut_file)

    assert len(whole) - 2 * 65536 <= len(found) < len(whole)
    assert np.array_equal(found.packed(), whole.packed()[: len(found)])
    assert str(cut_file) in message
    assert '\n' not in message
    assert show_events.main(['show_events', str(cut_file), '--json']) == 1
    out, err = capsys.readouterr()
    assert json.loads(out.splitlines()[-1])['events'] == len(found)
    assert err.count('\n') == 1
    assert convert_events.main([str(cut_file), str(tmp_path / 'rescued.npz')]) == 1
    assert len(read(tmp_path / 'rescued.npz')) == len(found)


@pytest.mark.parametrize(
    'suffix', ['.raw', '.dat', '.txt', '.npz', '.npy', '.h5', '.aedat4', '.mcap', '.db3', '.bag']
)
@pytest.mark.parametrize('content', [b'', b'\x93garbage \xff\n' * 9])
def test_what_is_empty_or_something_else_is_refused_in_one_line(suffix, content, tmp_path, capsys):
    path = tmp_path / f'x{suffix}'
    path.write_bytes(content)

    assert show_events.main(['show_events', str(path)]) == 2
    err = capsys.readouterr().err
    assert err.count('\n') == 1
    assert str(path) in err


@pytest.mark.parametrize('x', [-5, 70_000])
@pytest.mark.parametrize('suffix', ['.txt', '.npz', '.npy', '.h5'])
def test_a_column_out_of_range_ends_the_reading_and_is_not_wrapped(suffix, x, tmp_path):
    path = tmp_path / f'odd{suffix}'
    t, column, ones = np.array([1000, 2000, 3000]), np.array([3, x, 3]), np.ones(3, int)
    if suffix == '.txt':
        np.savetxt(path, np.column_stack([t * 1e-6, column, ones, ones]), fmt='%.6f %d %d %d')
    elif suffix == '.npz':
        np.savez(path, t=t, x=column, y=ones, p=ones)
    elif suffix == '.npy':
        records = np.zeros(3, [('x', '<i4'), ('y', '<i4'), ('t', '<i8'), ('p', '?')])
        records['x'], records['t'] = column, t
        np.save(path, records)
    else:
        with h5py.File(path, 'w') as file:
            for name, values in (('t', t), ('x', column), ('y', ones), ('p', ones)):
                file[f'events/{name}'] = values

    found, message = read_until_damage(path)

    assert set(found.x.tolist()) <= {3}
    assert len(found) == (suffix == '.txt')
    assert str(path) in message


def test_a_corrupted_archive_is_read_up_to_there(labelled, tmp_path):
    path = convert(labelled[1], tmp_path / 'out.npz')
    with zipfile.ZipFile(path) as archive:
        at = archive.getinfo('p.npy').header_offset
    octets = bytearray(path.read_bytes())
    octets[at + 100 : at + 140] = b'\xff' * 40
    path.write_bytes(octets)

    with pytest.raises(DamagedFile, match='damaged'):
        list(open_recording(path).read())


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (['IN', 'out.xyz'], 'must end in one of'),
        (['IN', 'IN'], 'another file'),
        (['IN', 'out.aedat4', '--size', '640'], 'WIDTHxHEIGHT'),
        (['nowhere.raw', 'out.csv'], 'does not exist'),
    ],
)
def test_what_cannot_be_converted_is_refused_in_one_line(arguments, reason, raw, tmp_path, capsys):
    resolved = [str(raw) if a == 'IN' else a for a in arguments]
    resolved[1] = resolved[1] if resolved[1] == str(raw) else str(tmp_path / resolved[1])

    assert convert_events.main(resolved) == 2
    err = capsys.readouterr().err
    assert reason in err
    assert err.count('\n') == 1


def test_an_unknown_suffix_names_those_that_are_known(tmp_path):
    path = tmp_path / 'a.jpeg'
    path.write_bytes(b'1')

    with pytest.raises(ParameterError, match=r'\.raw'):
        open_recording(path)


# The HDF5 library ends the process itself, after naming the file.
@pytest.mark.processes
@pytest.mark.parametrize('suffix', [s for s in SUFFIXES if s != '.h5'])
def test_a_full_disk_is_named_and_leaves_nothing_useless(suffix, tmp_path, capfd):
    source = tmp_path / 'events.csv'
    rows = ''.join(f'{k},{k % 7},{k % 5},1\n' for k in range(40_000))
    source.write_text('t,x,y,p\n' + rows)
    target = tmp_path / f'out{suffix}'
    code = (
        'import resource, signal, sys\n'
        'from dvs_event_camera.tools import convert_events\n'
        'signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n'
        'resource.setrlimit(resource.RLIMIT_FSIZE, (9000, 9000))\n'
        f'sys.exit(convert_events.main([{str(source)!r}, {str(target)!r}, "--size", "7x5"]))'
    )
    result = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True)

    assert result.returncode == 1, result.stderr
    assert f'{target.name}: cannot be written: ' in result.stderr
    assert target.exists() == (suffix in ('.txt', '.csv'))
