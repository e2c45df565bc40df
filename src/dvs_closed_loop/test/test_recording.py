"""Bags are written whole, are never overwritten, and stay readable when the disk is full."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from recording_cases import TYPES, packet, small_run
from rosbags.rosbag2 import Reader

from dvs_closed_loop.bags.bag import read_bag
from dvs_closed_loop.bags.recording import STORAGES, BagFullError, BagWriter
from dvs_common.errors import ParameterError
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire import topics

MESSAGE = packet(0, 40, 0)


def noise(seed):
    """A message that no compression makes smaller."""
    return np.random.default_rng(seed).bytes(len(MESSAGE))


def fill(path, storage, most=40_000):
    """Write until the disk is full; return the number of messages that were accepted."""
    with BagWriter(path, TYPES, storage=storage) as bag:
        for k in range(most):
            bag.write(topics.EVENTS, 1000 + k, noise(k))
    raise AssertionError('the disk was never full')


def assert_is_a_beginning(path, least):
    with Reader(path) as reader:
        found = [(time, bytes(data)) for _, time, data in reader.messages()]
        times = [time for time, _ in found]
        assert [data for _, data in found] == [noise(k) for k in range(len(found))]
        assert times == list(range(1000, 1000 + len(times)))
        assert len(times) == reader.message_count
    assert len(times) >= least


@pytest.mark.parametrize('storage', STORAGES)
def test_what_is_written_is_read(storage, tmp_path):
    recorded = small_run()
    scenario = Scenario.from_values({'event_threshold': 0.1, 'pixel_offsets': [0.0, 0.0]})
    with BagWriter(tmp_path / 'bag', TYPES, storage=storage) as bag:
        bag.keep_scenario(scenario, 'some name')
        for topic, received, data in recorded:
            bag.write(topic, received, data)

    found = read_bag(tmp_path / 'bag')

    assert [(m.topic, m.received_ns, m.data) for m in found.messages] == recorded
    assert found.scenario == scenario
    assert found.scenario_name == 'some name'
    assert found.names[topics.EVENTS] == '/events'
    assert not (tmp_path / 'bag' / '.reserve').exists()


def test_an_mcap_file_is_readable_by_the_reference_library(tmp_path):
    recorded = small_run(3000)
    with BagWriter(tmp_path / 'bag', TYPES) as bag:
        for topic, received, data in recorded:
            bag.write(topic, received, data)

    with (tmp_path / 'bag' / 'bag.mcap').open('rb') as file:
        found = [(c.topic, m.log_time, m.data) for _, c, m in make_reader(file).iter_messages()]

    assert found == [(f'/{topic}', received, data) for topic, received, data in recorded]


@pytest.mark.parametrize('storage', STORAGES)
def test_a_bag_is_never_overwritten(storage, tmp_path):
    with BagWriter(tmp_path / 'bag', TYPES, storage=storage) as bag:
        bag.write(topics.EVENTS, 7, MESSAGE)

    with pytest.raises(ParameterError, match='is not overwritten'):
        BagWriter(tmp_path / 'bag', TYPES, storage=storage)

    assert len(read_bag(tmp_path / 'bag').messages) == 1


# The limit is set in another process: it would be that of the whole test run.
LIMITED = """
import resource, sys
from pathlib import Path
from test_recording import fill
from dvs_closed_loop.bags.recording import BagFullError
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]), int(sys.argv[3])))
try:
    fill(Path(sys.argv[1]), sys.argv[2])
except BagFullError as error:
    print(error)
"""


@pytest.mark.parametrize('storage', STORAGES)
@pytest.mark.parametrize('limit', [700_000, 1_234_567])
def test_a_limit_on_file_sizes_leaves_a_readable_bag(limit, storage, tmp_path):
    result = subprocess.run(
        [sys.executable, '-c', LIMITED, str(tmp_path / 'bag'), storage, str(limit)],
        env={**os.environ, 'PYTHONPATH': os.pathsep.join([str(Path(__file__).parent), *sys.path])},
        capture_output=True,
        text=True,
    )

    assert 'what was recorded before is kept' in result.stdout, result.stderr
    assert_is_a_beginning(tmp_path / 'bag', least=200)


@pytest.fixture
def tiny_disk(tmp_path):
    disk = tmp_path / 'disk'
    disk.mkdir()
    command = ['mount', '-t', 'tmpfs', '-o', 'size=6m', 'tmpfs', str(disk)]
    mounted = subprocess.run(command, capture_output=True, text=True)
    if mounted.returncode:
        pytest.skip(f"this machine can't mount a tmpfs here: {mounted.stderr.strip()}")
    yield disk
    subprocess.run(['umount', str(disk)], check=True)


@pytest.mark.parametrize('storage', STORAGES)
def test_a_full_disk_leaves_a_readable_bag(storage, tiny_disk):
    with pytest.raises(BagFullError, match=r'No space left|disk is full'):
        fill(tiny_disk / 'bag', storage)

    assert_is_a_beginning(tiny_disk / 'bag', least=4000)


def test_a_disk_that_is_full_already_is_reported_at_the_start(tiny_disk):
    with (tiny_disk / 'ballast').open('wb') as file:
        os.posix_fallocate(file.fileno(), 0, 5 * 2**20)

    with pytest.raises(ParameterError, match='No space left'):
        BagWriter(tiny_disk / 'bag', TYPES)


def test_chunks_are_compressed_and_carry_checksums_and_the_time_of_publication(tmp_path):
    with BagWriter(tmp_path / 'bag', TYPES) as bag:
        for k in range(2000):
            bag.write(topics.EVENTS, 1000 + k, MESSAGE, published_ns=500 + k)
        bag.write(topics.EVENTS, 5000, MESSAGE)

    assert bag.size_bytes < 0.1 * 2000 * len(MESSAGE)
    with (tmp_path / 'bag' / 'bag.mcap').open('rb') as file:
        records = StreamReader(file, emit_chunks=True).records
        chunks = [record for record in records if isinstance(record, Chunk)]
        file.seek(0)
        times = [
            (message.log_time, message.publish_time)
            for _, _, message in make_reader(file, validate_crcs=True).iter_messages()
        ]
    assert {chunk.compression for chunk in chunks} == {'zstd'}
    assert all(chunk.uncompressed_crc for chunk in chunks)
    assert times == [*((1000 + k, 500 + k) for k in range(2000)), (5000, 5000)]


def test_every_stream_of_the_contract_has_a_definition(tmp_path):
    with BagWriter(tmp_path / 'bag', TYPES, storage='sqlite3') as bag:
        bag.write(topics.EVENTS_LABEL, 1, MESSAGE)
        bag.write(topics.EVENTS_PACKET, 2, MESSAGE)

    with Reader(tmp_path / 'bag') as reader:
        kinds = {connection.topic: connection.msgdef.data for connection in reader.connections}
    assert set(kinds) == {'/' + topic.lstrip('/') for topic in TYPES}
    assert [topic for topic, text in kinds.items() if not text] == ['/keyframe_request']


KILLED = """
import sys, time
from pathlib import Path
from test_recording import MESSAGE, TYPES, topics
from dvs_closed_loop.bags.recording import BagWriter
bag = BagWriter(Path(sys.argv[1]), TYPES, storage=sys.argv[2])
for k in range(100_000):
    bag.write(topics.EVENTS, 1000 + k, MESSAGE)
    print(k, time.monotonic(), flush=True)
    time.sleep(0.02)
"""


@pytest.mark.parametrize('storage', STORAGES)
def test_a_recorder_that_is_killed_leaves_all_but_the_last_second(storage, tmp_path):
    with subprocess.Popen(
        [sys.executable, '-c', KILLED, str(tmp_path / 'bag'), storage],
        env={**os.environ, 'PYTHONPATH': os.pathsep.join([str(Path(__file__).parent), *sys.path])},
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        written = [process.stdout.readline().split() for _ in range(120)]
        process.kill()
        written += [line.split() for line in process.stdout]
    last_s = float(written[-1][1])

    (file,) = (path for path in (tmp_path / 'bag').iterdir() if path.suffix in ('.mcap', '.db3'))
    found = read_bag(file)

    times = [message.received_ns for message in found.messages]
    assert times == list(range(1000, 1000 + len(times)))
    safe = [k for k, at_s in written if float(at_s) < last_s - 1.5]
    assert len(times) >= len(safe) > 0
