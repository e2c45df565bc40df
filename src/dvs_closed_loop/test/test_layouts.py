"""Every topic and field that a layout names exists in the wire contract."""

import ast
import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import yaml
from rosbags.typesys import Stores, get_typestore

from dvs_closed_loop.bags.streams import STREAMS
from dvs_common.wire.events import FRAME_ID

LAYOUTS = Path(__file__).parents[1] / 'layouts'
TYPES = get_typestore(Stores.ROS2_JAZZY)
BY_NAME = {'/' + name.lstrip('/'): stream for name, stream in STREAMS.items()}
# PlotJuggler names what is in a JointState by the joint: topic/joint/part.
JOINT = re.compile(r'(/\w+)/([xuz][1-9])/(position|effort)')
PART_OF = {'/state': 'position', '/command': 'effort', '/estimate': 'position'}


def assert_field(topic, path):
    """Follow field names and indices, as in position[0], through the type's definition."""
    assert topic in BY_NAME, topic
    type_name = BY_NAME[topic].type_name
    for step in re.split(r'[./]', path):
        name, index = re.fullmatch(r'(\w+)(\[\d+\])?', step).groups()
        fields = dict(TYPES.get_msgdef(type_name).fields)
        assert name in fields, f'{type_name} has no {name}'
        kind, detail = fields[name]
        is_sequence = kind.name in ('ARRAY', 'SEQUENCE')
        assert is_sequence == (index is not None), f'{topic} {path}'
        type_name = detail if kind.name == 'NAME' else type_name


def test_the_plotjuggler_layout_shows_topics_of_the_loop():
    root = ElementTree.parse(LAYOUTS / 'plotjuggler.xml').getroot()
    names = [curve.get(key) for curve in root.iter('curve') for key in ('curve_x', 'curve_y')]
    names = [name for name in names if name]
    names += [c.get('name') for c in root.iter('curve') if c.get('curve_x') is None]
    # The plugin reads the topics from one attribute (parser_configuration.cpp).
    selected = set(root.find('.//selected_topics').get('value').split(';'))
    # Stamps of lockstep begin at 0: the time of arrival serves all.
    assert root.find('.//use_header_stamp').get('value') == 'false'

    assert len(names) >= 9
    assert selected <= set(BY_NAME)
    for name in names:
        joint = JOINT.fullmatch(name)
        if joint:
            topic, _, part = joint.groups()
            assert BY_NAME[topic].type_name == 'sensor_msgs/msg/JointState'
            assert PART_OF[topic] == part
        else:
            topic, _, path = name[1:].partition('/')
            topic = f'/{topic}'
            assert_field(topic, path)
        assert topic in selected


def test_the_foxglove_layout_shows_topics_of_the_loop():
    layout = json.loads((LAYOUTS / 'foxglove.json').read_text())
    panels = layout['configById']

    def leaves(node):
        if isinstance(node, str):
            return [node]
        return [*leaves(node['first']), *leaves(node['second'])]

    assert sorted(leaves(layout['layout'])) == sorted(panels)
    paths = []
    for name, panel in panels.items():
        if name.startswith('Plot!'):
            paths += [entry['value'] for entry in panel['paths']]
            # Stamps of lockstep are not the clock of the player.
            assert {entry['timestampMethod'] for entry in panel['paths']} == {'receiveTime'}
            assert panel['foxglovePanelTitle'] == panel['lichtblickPanelTitle']
            paths += [panel['xAxisPath']['value']] if 'xAxisPath' in panel else []
    assert len(paths) >= 9
    for path in paths:
        topic, _, field = path.partition('.')
        assert_field(topic, field)
    image = BY_NAME[panels['Image!events']['imageMode']['imageTopic']]
    assert image.type_name == 'sensor_msgs/msg/Image'
    health = BY_NAME[panels['DiagnosticSummary!health']['topicToRender']]
    assert health.type_name == 'diagnostic_msgs/msg/DiagnosticArray'


def test_the_rqt_layout_shows_topics_of_the_loop():
    manager = json.loads((LAYOUTS / 'rqt.perspective').read_text())['groups']['pluginmanager']
    running = ast.literal_eval(manager['keys']['running-plugins']['repr'])
    groups = manager['groups']

    assert set(groups) == {
        f'plugin__{plugin.replace("/", "__")}__{k}' for plugin, ks in running.items() for k in ks
    }
    fields = []
    for name, group in groups.items():
        keys = group['groups'].get('plugin', {'keys': {}})['keys']
        settings = {key: ast.literal_eval(value['repr']) for key, value in keys.items()}
        fields += settings.get('topics', [])
        if 'ImageView' in name:
            assert BY_NAME[settings['topic']].type_name == 'sensor_msgs/msg/Image'
    assert len(fields) == 6
    for field in fields:
        topic, _, path = field[1:].partition('/')
        assert_field(f'/{topic}', path)


@pytest.mark.parametrize('field', ['/state.positions[0]', '/stat.position[0]', '/events.width[0]'])
def test_a_wrong_field_would_be_found(field):
    topic, _, path = field.partition('.')
    with pytest.raises(AssertionError):
        assert_field(topic, path)


def test_the_layouts_are_installed():
    from ament_index_python.packages import get_package_share_directory

    share = Path(get_package_share_directory('dvs_closed_loop')) / 'layouts'
    assert sorted(file.name for file in share.iterdir()) == [
        'foxglove.json',
        'plotjuggler.xml',
        'rqt.perspective',
        'rviz.rviz',
    ]


def test_the_rviz_layout_shows_topics_of_the_loop():
    manager = yaml.safe_load((LAYOUTS / 'rviz.rviz').read_text())['Visualization Manager']
    assert manager['Global Options']['Fixed Frame'] == FRAME_ID
    displays = {display['Name']: display for display in manager['Displays']}
    for name in ('Events', 'Picture'):
        display = displays[name]
        kind = display['Class'].partition('/')[2]
        stream = STREAMS[display['Topic']['Value']]
        assert stream.type_name.endswith(f'/{kind}')
        qos = stream.offered_qos
        assert display['Topic']['Reliability Policy'].upper() == qos.reliability.name
        assert display['Topic']['Durability Policy'].upper() == qos.durability.name
