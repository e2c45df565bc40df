"""What the converter writes is read by the libraries that people have, by their defaults."""

import csv

import aedat
import h5py
import numpy as np
import pytest
from recording_files import convert


def test_aedat4_is_read_by_the_library_aedat(raw, events, tmp_path):
    decoder = aedat.Decoder(convert(raw, tmp_path / 'out.aedat4'))
    sizes = [s for s in decoder.id_to_stream().values() if s['type'] == 'events']
    packets = list(decoder)
    found = np.concatenate([packet['events'] for packet in packets if 'events' in packet])
    edges = np.concatenate([packet['triggers'] for packet in packets if 'triggers' in packet])

    assert (sizes[0]['width'], sizes[0]['height']) == (640, 480)
    assert np.array_equal(found['t'], events.t // 1000)
    assert np.array_equal(found['x'], events.x)
    assert np.array_equal(found['y'], events.y)
    assert np.array_equal(found['on'], events.p == 1)
    assert edges.tolist() == [(12_345, 1), (20_001, 5)]


def test_hdf5_is_read_as_dsec_is(raw, events, tmp_path):
    with h5py.File(convert(raw, tmp_path / 'out.h5')) as file:
        found = {name: file['events'][name][()] for name in ('t', 'x', 'y', 'p')}
        first_of_ms = file['ms_to_idx'][()]
        offset = int(file['t_offset'][()])

    assert np.array_equal(found['t'] + offset, events.t // 1000)
    assert np.array_equal(found['x'], events.x)
    assert np.array_equal(found['p'], events.p)
    for ms in (0, 10, 11, 59):
        assert first_of_ms[ms] == np.searchsorted(found['t'], 1000 * ms)


def test_csv_and_text_and_numpy_files_are_what_their_readers_expect(raw, events, tmp_path):
    with convert(raw, tmp_path / 'out.csv').open(newline='') as file:
        head, *rows = csv.reader(file)
    text = np.loadtxt(convert(raw, tmp_path / 'out.txt'))
    records = np.load(convert(raw, tmp_path / 'out.npy'))
    with np.load(convert(raw, tmp_path / 'out.npz')) as archive:
        columns = {name: archive[name] for name in 'xytp'}

    assert head == ['t', 'x', 'y', 'p']
    expected = np.column_stack([events.t // 1000, events.x, events.y, events.p])
    assert np.array_equal(np.array(rows, np.int64), expected)
    assert np.allclose(text[:, 0], events.t * 1e-9, rtol=0, atol=1e-10)
    assert np.array_equal(text[:, 1:], expected[:, 1:])
    assert records.dtype.names == ('x', 'y', 't', 'p')
    assert records['p'].dtype == bool
    assert np.array_equal(records['t'], events.t // 1000)
    assert np.array_equal(columns['t'], events.t)
    assert set(np.unique(columns['p'])) == {0, 1}


def test_aedat4_is_read_by_the_library_of_its_makers(raw, events, tmp_path):
    dv_processing = pytest.importorskip('dv_processing')
    reader = dv_processing.io.MonoCameraRecording(str(convert(raw, tmp_path / 'out.aedat4')))
    found = np.concatenate([batch.numpy() for batch in iter(reader.getNextEventBatch, None)])

    assert reader.getEventResolution() == (640, 480)
    assert np.array_equal(found['timestamp'], events.t // 1000)
    assert np.array_equal(found['x'], events.x)
    assert np.array_equal(found['y'], events.y)
    assert np.array_equal(found['polarity'] > 0, events.p == 1)


def test_tonic_reads_aedat4_and_npy_with_their_polarities(raw, events, tmp_path):
    tonic = pytest.importorskip('tonic')
    to_frame = tonic.transforms.ToFrame(sensor_size=(640, 480, 2), n_time_bins=1)
    records = np.load(convert(raw, tmp_path / 'out.npy'))
    off, on = to_frame(records)[0].sum(axis=(1, 2))
    # Its last bin ends before the last event.
    assert off == np.count_nonzero(events.p[:-1] == 0)
    assert on == np.count_nonzero(events.p[:-1])
    loaded = tonic.io.read_aedat4(str(convert(raw, tmp_path / 'out.aedat4')))
    assert np.array_equal(loaded['t'], events.t // 1000)
    assert np.array_equal(loaded['on'], events.p == 1)


def test_evlib_reads_text_hdf5_and_aedat4(raw, events, tmp_path):
    evlib = pytest.importorskip('evlib')
    for target in ('out.txt', 'out.h5', 'out.aedat4'):
        frame = evlib.load_events(str(convert(raw, tmp_path / target)), sort=False).collect()
        assert np.array_equal(frame['x'].to_numpy(), events.x)
        assert np.array_equal(frame['y'].to_numpy(), events.y)
        assert np.array_equal(frame['polarity'].to_numpy() > 0, events.p == 1)
        micro = frame['t'].dt.total_microseconds().to_numpy()
        assert np.max(np.abs(micro - events.t // 1000)) <= 1


def test_aestream_reads_aedat4(raw, events, tmp_path):
    aestream = pytest.importorskip('aestream')
    # Its context would start a thread that reads the same packets.
    found = aestream.FileInput(str(convert(raw, tmp_path / 'out.aedat4')), (640, 480)).load()
    assert np.array_equal(found['timestamp'], events.t // 1000)
    assert np.array_equal(found['x'], events.x)
    assert np.array_equal(found['y'], events.y)
    assert np.array_equal(found['polarity'], events.p)


def test_a_table_of_an_aedat4_file_leads_to_its_packets_by_time(tmp_path):
    dv_processing = pytest.importorskip('dv_processing')
    rows = ''.join(f'{k},{k % 9},3,{k % 2}\n' for k in range(70_000))
    (tmp_path / 'in.csv').write_text('t,x,y,p\n' + rows)
    path = convert(tmp_path / 'in.csv', tmp_path / 'out.aedat4')
    reader = dv_processing.io.MonoCameraRecording(str(path))

    assert reader.getTimeRange() == (0, 69_999)
    late = reader.getEventsTimeRange(68_000, 68_010, 'events')
    assert late.numpy()['timestamp'].tolist() == list(range(68_000, 68_010))


def test_faery_reads_csv_and_aedat4(raw, events, tmp_path):
    faery = pytest.importorskip('faery')
    for target in ('out.csv', 'out.aedat4'):
        stream = faery.events_stream_from_file(convert(raw, tmp_path / target))
        found = np.concatenate(list(stream))
        assert np.array_equal(found['t'], events.t // 1000)
        assert np.array_equal(found['x'], events.x)
        assert np.array_equal(found['on'], events.p == 1)
