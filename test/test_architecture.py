"""docs/architecture.md holds: imports go down the house, and cores need no ROS."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MIDDLE = ('dvs_plant_sim', 'dvs_event_camera', 'dvs_hinf_controller')
BELOW = {
    'dvs_common': set(),
    **{package: {'dvs_common'} for package in MIDDLE},
    'dvs_simulation': {*MIDDLE, 'dvs_common'},
    'dvs_closed_loop': {*MIDDLE, 'dvs_common', 'dvs_simulation'},
}
# Rooms that are made of ROS; every other module is a core or a node, `*_node.py`.
ROS_ROOMS = {
    'dvs_common': {
        'node.demanded_publisher',
        'node.direct_calls',
        'node.fitting_subscription',
        'node.ros_parameters',
        'node.session',
        'node.sole_publisher',
        'node.spin',
        'node.token_publisher',
    },
    'dvs_plant_sim': {'lockstep_driver', 'realtime_driver'},
    'dvs_closed_loop': {
        'bags.bag_recorder',
        'dashboard.dashboard_listener',
        'running.closed_loop',
        'running.composed_loop',
        'running.loop_parameters',
        'running.loop_runner',
        'running.run_recorder',
        'running.tool',
    },
}
MODULES = {
    '.'.join(path.relative_to(ROOT / 'src' / package).with_suffix('').parts): path
    for package in BELOW
    for path in sorted((ROOT / 'src' / package / package).rglob('*.py'))
}


@cache
def tree_of(path):
    return ast.parse(path.read_text())


def modules_of(package):
    return [(name, path) for name, path in MODULES.items() if name.partition('.')[0] == package]


def loaded_at_once(path):
    """Modules that importing the file imports: neither those for types nor those for later."""
    pending = list(tree_of(path).body)
    while pending:
        node = pending.pop()
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module != '__future__':
            yield node.module
        elif isinstance(node, ast.If) and 'TYPE_CHECKING' not in ast.unparse(node.test):
            pending += [*node.body, *node.orelse]
        elif isinstance(node, ast.Try | ast.ClassDef | ast.With):
            pending += node.body


def is_ros(module):
    root = module.partition('.')[0]
    return root in ('rclpy', 'rcl_interfaces') or root.endswith('_msgs')


def is_ros_room(module):
    package, _, stem = module.partition('.')
    return stem.endswith('_node') or stem in ROS_ROOMS.get(package, ())


@pytest.mark.parametrize('package', BELOW)
def test_imports_go_down_the_house(package):
    for name, path in modules_of(package):
        ours = {module.partition('.')[0] for module in loaded_at_once(path)} & set(BELOW)
        assert ours <= BELOW[package] | {package}, name


@pytest.mark.parametrize('package', BELOW)
def test_cores_need_no_ros(package):
    for name, path in modules_of(package):
        for module in () if is_ros_room(name) else loaded_at_once(path):
            assert not is_ros(module), f'{name} imports {module}'
            assert not is_ros_room(module), f'{name} imports {module}'


def test_every_ros_room_is_one():
    for package, stems in ROS_ROOMS.items():
        for stem in stems:
            loaded = set(loaded_at_once(MODULES[f'{package}.{stem}']))
            assert any(is_ros(m) or is_ros_room(m) for m in loaded), f'{package}.{stem} is a core'


def test_matplotlib_is_loaded_in_one_place():
    found = {
        name
        for name, path in MODULES.items()
        if 'matplotlib' in {module.partition('.')[0] for module in loaded_at_once(path)}
    }

    assert found == {'dvs_common.drawing'}


def looked_up_by_name(path):
    """Places that ask a scenario for a parameter by a string instead of an attribute."""
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Subscript):
            asked = ast.unparse(node.value).rpartition('.')[2]
            if asked.lower().endswith('scenario'):
                yield f'{path.name}:{node.lineno} {ast.unparse(node)}'


@pytest.mark.parametrize('package', BELOW)
def test_a_scenario_is_read_by_its_typed_attributes(package):
    assert [place for _, path in modules_of(package) for place in looked_up_by_name(path)] == []


def test_a_look_up_by_name_would_be_found(tmp_path):
    path = tmp_path / 'module.py'
    path.write_text("h = self._scenario['event_threshold']\nscenario[name]\nresult['events']\n")

    assert len(list(looked_up_by_name(path))) == 2


# One home each: elsewhere they are imported.
SINGLE_HOMES = {
    'dvs_common.arrays': r'^FloatArray = ',
    'dvs_common.node.session': r'\bEventsExecutor\(|\brclpy\.init\(',
    # As ast.unparse writes 10**9, 1_000_000_000, * 1e9, 1e9 / and * 1e-9.
    'dvs_common.nanoseconds': r'10 \*\* 9|\b10{9}\b(?!\.)|\* 10{9}\.0|\b10{9}\.0 /|\* 1e-09',
    'dvs_common.scenario.reachability': r'\bmatrix_rank\(|\b_?RANK_TOLERANCE = ',
    'dvs_simulation.judging.measures': r'linalg\.norm\([^()]*equilibrium'
    r'|[<>]=? [\w.]*objective\.tolerance\b|limsup\w* [<>]=? [\w.]*tolerance|[<>]=? 1 \+ 1e-09',
}


@cache
def code_of(path):
    """Code of a file as ast.unparse lays it out, without docstrings and comments."""
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            node.value = ast.Constant(None)
    return ast.unparse(tree)


@pytest.mark.parametrize('home', SINGLE_HOMES)
def test_arrays_time_ranks_judgements_and_the_start_of_ros_have_one_home(home):
    elsewhere = {
        name
        for name, path in MODULES.items()
        if name != home and re.search(SINGLE_HOMES[home], code_of(path), re.MULTILINE)
    }

    assert not elsewhere


# -- nodes and circles ----------------------------------------------------------------------------


@pytest.mark.parametrize('name', [name for name in MODULES if name.endswith('_node')])
def test_a_file_named_node_holds_one_node(name):
    body = ast.parse(MODULES[name].read_text()).body
    classes = [item.name for item in body if isinstance(item, ast.ClassDef)]

    assert len([found for found in classes if found.endswith('Node')]) == 1


def all_imports(path):
    """Our modules that the file imports, now, for types or later."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level:
            folder = path.parents[node.level - 1].relative_to(ROOT / 'src').parts[1:]
            yield '.'.join([*folder, node.module])
        elif isinstance(node, ast.ImportFrom) and node.module in MODULES:
            yield node.module
        elif isinstance(node, ast.ImportFrom):
            yield from (f'{node.module}.{alias.name}' for alias in node.names)


def test_no_modules_import_each_other_in_a_circle():
    above = {
        name: {found for found in all_imports(path) if found in MODULES} - {name}
        for name, path in MODULES.items()
        if not name.endswith('__init__')
    }
    while leaves := [name for name in above if not above[name] & set(above)]:
        for name in leaves:
            del above[name]

    assert not above
