"""Mutated files: every reader reads them or refuses them in one line, and none hangs."""

import json
import shutil

import numpy as np
import pytest
from loop_support import CONFIG
from mutations import Mutations
from rosbags import rosbag1
from sensor_encoders import some_events
from test_bag_files import packets, types
from test_fuzz import GOOD

from dvs_closed_loop.bags.bag import read_bag
from dvs_closed_loop.bags.recording import BagWriter
from dvs_common.errors import ParameterError, SuiteError
from dvs_common.scenario.scenario import Scenario, load_scenario
from dvs_event_camera.files.open_recording import open_recording
from dvs_event_camera.streams import event_packet
from dvs_event_camera.tools import convert_events
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_hinf_controller.design.design_file import read_design_file, write_design_file

HEAD = '/**:\n  ros__parameters:\n    '
DOUBLINGS = ''.join(f'    x{k}: &{chr(98 + k)} {{a: *{chr(97 + k)}}}\n' for k in range(20))
FILES = {
    'an alias of itself': HEAD.rstrip() + ' &a\n    x: *a\n',
    'aliases of aliases': f'{HEAD}x: &a {{y: 1}}\n{DOUBLINGS}',
    'an integer of 5000 digits': f'{HEAD}seed: {"9" * 5000}\n',
    'an integer beyond all doubles': f'{HEAD}set_point: [{"9" * 400}, 1]\n',
    'a nesting of 5000 lists': '[' * 5000,
    'a nesting of 3000 mappings': '{a: ' * 3000 + '1' + '}' * 3000,
    'a key that is a mapping': '? {a: 1}\n: 1\n',
    'a tag of Python': '!!python/object/apply:os.getpid []\n',
    'zeros': '\0' * 100,
}


def read_or_refused(read, path, message):
    """Whether a mutated file was read; its refusal is one line."""
    path.write_bytes(message)
    try:
        read(path)
    except SuiteError as error:
        assert len(str(error).splitlines()) == 1
        assert len(str(error)) < 3000
        return False
    return True


@pytest.mark.parametrize('name', FILES)
def test_a_parameter_file_without_sense_is_refused_in_one_line(name, tmp_path):
    assert not read_or_refused(load_scenario, tmp_path / 'file.yaml', FILES[name].encode())


def test_a_mutated_parameter_file_is_read_or_refused(tmp_path):
    mutations = Mutations(seed=1)
    text = (CONFIG / 'mirror_r3.yaml').read_bytes()
    outcomes = {
        read_or_refused(load_scenario, tmp_path / 'file.yaml', mutations.of(text))
        for _ in range(200)
    }

    assert outcomes == {True, False}


@pytest.fixture(scope='module')
def design_bytes(tmp_path_factory):
    path = tmp_path_factory.mktemp('design') / 'design.json'
    design = design_from_scenario(Scenario.from_values({}))
    write_design_file(
        path,
        method='hinf',
        problem=design.problem,
        controller=design.controller,
        figures={'seconds': 1.0},
    )
    return path.read_bytes()


def test_a_mutated_design_is_read_or_refused(design_bytes, tmp_path):
    mutations = Mutations(seed=2)
    outcomes = {
        read_or_refused(read_design_file, tmp_path / 'design.json', mutations.of(design_bytes))
        for _ in range(1000)
    }

    assert outcomes == {True, False}


@pytest.mark.parametrize(
    'feedthrough', [10**400, [[]], 'NaN', {}], ids=['huge', 'ragged', 'text', 'mapping']
)
def test_a_design_of_numbers_that_are_none_is_refused(feedthrough, design_bytes, tmp_path):
    document = json.loads(design_bytes)
    document['controller']['feedthrough'] = [feedthrough]
    path = tmp_path / 'design.json'

    assert not read_or_refused(read_design_file, path, json.dumps(document).encode())


def test_a_design_nested_too_deep_is_refused(tmp_path):
    path = tmp_path / 'design.json'
    path.write_text('[' * 100_000)

    with pytest.raises(ParameterError, match='is not JSON'):
        read_design_file(path)


def read_recording(path):
    for stretch in open_recording(path).read():
        assert stretch is not None


RECORDINGS = {
    'events.csv': b't,x,y,p\n' + b''.join(b'%d,%d,1,1\n' % (k, k % 9) for k in range(50)),
    'events.dat': b'% Version 2\n% end\n\x0c\x08' + np.arange(80, dtype='<u4').tobytes(),
    'events.raw': b'% evt 2.0\n% end\n' + np.arange(80, dtype='<u4').tobytes(),
    'events.bin': np.arange(400, dtype=np.uint8).tobytes()[:400],
}
CONVERTED = ('.txt', '.npz', '.npy', '.h5', '.aedat4')


@pytest.mark.parametrize('name', RECORDINGS)
def test_a_mutated_recording_is_read_or_refused(name, tmp_path):
    mutations = Mutations(seed=4)
    for _ in range(200):
        read_or_refused(read_recording, tmp_path / name, mutations.of(RECORDINGS[name]))


@pytest.fixture(scope='module')
def converted(tmp_path_factory):
    """The same events in a file of each format that is written."""
    folder = tmp_path_factory.mktemp('converted')
    source = folder / 'events.csv'
    source.write_bytes(RECORDINGS['events.csv'])
    for suffix in CONVERTED:
        convert_events.main([str(source), str(folder / f'out{suffix}')])
    with rosbag1.Writer(folder / 'out.bag') as writer:
        kind = event_packet.MESSAGE_TYPE
        connection = writer.add_connection('/dvs/events', kind, typestore=types(ros1=True))
        for k, packet in enumerate(packets(some_events(500, width=64, height=48))):
            writer.write(connection, k, types().cdr_to_ros1(packet, kind))
    return folder


@pytest.mark.parametrize('suffix', (*CONVERTED, '.bag'))
def test_a_mutated_recording_of_a_structured_format_is_read_or_refused(
    suffix, converted, tmp_path
):
    mutations = Mutations(seed=5)
    whole = (converted / f'out{suffix}').read_bytes()
    assert read_or_refused(read_recording, tmp_path / f'out{suffix}', whole)
    for _ in range(150):
        read_or_refused(read_recording, tmp_path / f'out{suffix}', mutations.of(whole))


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp('bag') / 'run'
    with BagWriter(
        path, dict.fromkeys(('command', 'state'), 'sensor_msgs/msg/JointState')
    ) as writer:
        writer.keep_scenario(Scenario.from_values({}), 'run')
        for k in range(20):
            writer.write('command', k, GOOD['command'](k))
            writer.write('state', k, GOOD['state'](k))
    return path


def test_a_bag_with_mutated_metadata_or_data_is_read_or_refused(bag, tmp_path):
    mutations = Mutations(seed=6)
    shutil.copytree(bag, tmp_path / 'run')
    files = sorted(bag.iterdir(), reverse=True)
    assert [file.name for file in files] == ['run.mcap', 'metadata.yaml']
    (tmp_path / 'run' / 'metadata.yaml').unlink()
    for file in files:
        for _ in range(60):
            read_or_refused(
                lambda _: read_bag(tmp_path / 'run'),
                tmp_path / 'run' / file.name,
                mutations.of(file.read_bytes()),
            )
        shutil.copy(file, tmp_path / 'run' / file.name)
