"""The packages and their folders: who may import whom, how large a module is, no lines twice."""

import ast
import re
from collections import defaultdict
from graphlib import CycleError, TopologicalSorter
from io import StringIO
from pathlib import Path
from tokenize import COMMENT, generate_tokens

import pytest
from test_architecture import tree_of

ROOT = Path(__file__).resolve().parents[1]
# Packages from the ground up; those of one line do not import each other.
FLOORS = (
    ('dvs_common',),
    ('dvs_plant_sim', 'dvs_event_camera', 'dvs_hinf_controller'),
    ('dvs_simulation',),
    ('dvs_closed_loop',),
)
# Rooms of each package from the ground up. GROUND are the modules beside the rooms that rooms
# stand on, CORE those that stand on some rooms and below others, ROOF those above all: nodes, the
# command line, what a package exports.
GROUND, CORE, ROOF = 'ground', 'core', 'roof'
ROOMS = {
    'dvs_common': (GROUND, 'wire', 'scenario', 'node', ROOF),
    'dvs_plant_sim': (GROUND, ROOF),
    'dvs_event_camera': (GROUND, 'pixels', 'streams', 'files', CORE, 'tools', ROOF),
    'dvs_hinf_controller': (GROUND, 'analysis', 'synthesis', 'design', 'running', ROOF),
    'dvs_simulation': (
        GROUND, 'judging', 'exact', 'sampled', 'paper', 'sweep', 'commands', ROOF,
    ),
    'dvs_closed_loop': (GROUND, 'bags', 'reports', 'running', 'dashboard', 'commands', ROOF),
}  # fmt: skip
CORES = {
    'dvs_event_camera.event_camera',
    'dvs_event_camera.expected_frame',
    'dvs_event_camera.rehearsal',
    'dvs_event_camera.scenario_pixels',
}
MOST_LINES = 400
SAME_LINES = 10
DATACLASS = {'frozen=True', 'slots=True', 'kw_only=True'}
# Files that are written alike: colcon and pip read each package by itself, so that its setup.py
# can import nothing of the others.
MAY_REPEAT = ('/setup.py',)


def module_name(path, package):
    name = '.'.join(path.relative_to(ROOT / 'src' / package).with_suffix('').parts)
    return name.removesuffix('.__init__')


MODULES = {
    module_name(path, package): path
    for floor in FLOORS
    for package in floor
    for path in sorted((ROOT / 'src' / package / package).rglob('*.py'))
}
PACKAGES = [package for floor in FLOORS for package in floor]
FOLDERS = ('src', 'scripts', 'examples', 'test')
FILES = {
    path.relative_to(ROOT).as_posix(): path
    for folder in FOLDERS
    for path in sorted((ROOT / folder).rglob('*.py'))
}


def modules_of(package):
    return [name for name in MODULES if name.partition('.')[0] == package]


def origin(path, node):
    """Full name of the module that an import in a file takes from."""
    if not node.level:
        return node.module
    folder = path.parents[node.level - 1].relative_to(ROOT / 'src').parts[1:]
    return '.'.join([*folder, *filter(None, [node.module])])


def imported(path, *, late):
    """Our modules that a file imports, not counting types; with `late`, in functions too."""
    pending = list(tree_of(path).body)
    while pending:
        node = pending.pop()
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in MODULES)
        elif isinstance(node, ast.ImportFrom):
            module = origin(path, node)
            for alias in node.names:
                inner = f'{module}.{alias.name}'
                found = inner if inner in MODULES else module
                if found in MODULES:
                    yield found
        elif isinstance(node, ast.If) and 'TYPE_CHECKING' in ast.unparse(node.test):
            pending += node.orelse
        elif late or not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            pending += [
                child for child in ast.iter_child_nodes(node) if isinstance(child, ast.stmt)
            ]


def room_of(name):
    package, *rest = name.split('.')
    if not rest:
        return ROOF
    if rest[0] in ROOMS[package]:
        return rest[0]
    if name in CORES:
        return CORE
    roof = rest[0] in ('cli', '__main__') or rest[0].endswith('_node')
    return ROOF if roof else GROUND


def test_every_room_is_on_the_plan_and_has_a_word_on_what_it_is_for():
    for package in PACKAGES:
        folders = list((ROOT / 'src' / package / package).glob('*/__init__.py'))
        assert {path.parent.name for path in folders} == {*ROOMS[package]} - {GROUND, CORE, ROOF}
        assert all(ast.get_docstring(ast.parse(path.read_text())) for path in folders)


def imports_upward(name):
    """Modules above `name` that it imports."""
    package = name.partition('.')[0]
    floor = {p: k for k, packages in enumerate(FLOORS) for p in packages}
    rooms = ROOMS[package]
    for other in imported(MODULES[name], late=True):
        below = other.partition('.')[0]
        if below != package:
            is_below = floor[below] < floor[package]
        else:
            is_below = other == package or (
                rooms.index(room_of(other)) <= rooms.index(room_of(name))
            )
        if not is_below:
            yield other


@pytest.mark.parametrize('package', PACKAGES)
def test_imports_go_down_between_packages_and_between_rooms(package):
    for name in modules_of(package):
        assert list(imports_upward(name)) == [], name


def test_no_import_goes_round_in_a_circle():
    graph = {name: {*imported(path, late=False)} - {name} for name, path in MODULES.items()}

    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(' -> '.join(error.args[1]))


def test_no_module_of_the_packages_the_tests_and_the_scripts_has_over_400_lines():
    lengths = {name: len(path.read_text().splitlines()) for name, path in FILES.items()}

    assert {name: lines for name, lines in lengths.items() if lines > MOST_LINES} == {}


def is_test(path):
    return 'test' in path.relative_to(ROOT).parts[:-1]


def docstring_of(node):
    body = getattr(node, 'body', None)
    first = body[0] if isinstance(body, list) and body else None
    is_text = isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant)
    return first if is_text else None


def aside(tree):
    """Imports and docstrings of a module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node
        elif text := docstring_of(node):
            yield text


def code_lines(source):
    """Lines of a module without imports, docstrings, comments and layout."""
    tree = ast.parse(source)
    skipped = {*aside(tree)}
    for node in ast.walk(tree):
        if isinstance(getattr(node, 'body', None), list):
            node.body = [child for child in node.body if child not in skipped] or [ast.Pass()]
    return [line.strip() for line in ast.unparse(tree).splitlines() if line.strip()]


def written_lines(source):
    """The same as they are written, where a call may take ten lines."""
    lines = source.splitlines()
    for token in generate_tokens(StringIO(source).readline):
        if token.type == COMMENT:
            row, column = token.start
            lines[row - 1] = lines[row - 1][:column]
    for node in aside(ast.parse(source)):
        lines[node.lineno - 1 : node.end_lineno] = [''] * (node.end_lineno - node.lineno + 1)
    return [line.strip() for line in lines if line.strip()]


def said_twice(sources, lines_of=code_lines):
    """Stretches of ten lines that stand in two places, with the places."""
    places = defaultdict(list)
    for name, source in sources.items():
        lines = lines_of(source)
        for start in range(len(lines) - SAME_LINES + 1):
            places['\n'.join(lines[start : start + SAME_LINES])].append(name)
    return {text: names for text, names in places.items() if len(names) > 1}


def test_no_two_places_have_the_same_ten_lines():
    sources = {name: path.read_text() for name, path in FILES.items()}
    written = {name: text for name, text in sources.items() if not name.endswith(MAY_REPEAT)}

    assert len(written) > len(MODULES)
    assert not said_twice(sources, code_lines)
    assert not said_twice(written, written_lines)


def test_ten_lines_that_differ_in_layout_only_would_be_found():
    lines = [f'x{k} = call({k}, {k})' for k in range(10)]
    spread = [f'    x{k} = call(\n        {k}, {k}\n    )  # why' for k in range(10)]

    assert said_twice({'a': '\n'.join(lines), 'b': 'def f():\n' + '\n'.join(spread)})
    assert not said_twice({'a': '\n'.join(lines), 'b': '\n'.join(lines[:9])})


def test_a_call_that_is_spread_over_ten_lines_in_two_places_would_be_found():
    lines = ['call(', *(f'    {k},' for k in range(8)), ')']
    one = '\n'.join(['import a', *lines[:5], '\n    # why', *lines[5:]])
    other = '\n'.join(['def f():', '    """Text."""', *(f'    {line}  # how' for line in lines)])

    assert said_twice({'a': one, 'b': other}, written_lines)
    assert not said_twice({'a': one, 'b': other}, code_lines)
    assert not said_twice({'a': one, 'b': other.replace('3', '-3')}, written_lines)


def loose_dataclasses(path):
    """Dataclasses of a file that may change, take other attributes or are made by place."""
    for node in ast.walk(ast.parse(path.read_text())):
        for decorator in node.decorator_list if isinstance(node, ast.ClassDef) else ():
            name, *_ = ast.unparse(decorator).partition('(')
            options = {*map(ast.unparse, getattr(decorator, 'keywords', ()))}
            if name.endswith('dataclass') and not options >= DATACLASS:
                yield node.name


def test_dataclasses_are_frozen_slotted_and_keyword_only():
    programs = {name: path for name, path in FILES.items() if not is_test(path)}
    loose = {name: [*loose_dataclasses(path)] for name, path in programs.items()}

    assert len(programs) > len(MODULES)
    assert {name: found for name, found in loose.items() if found} == {}


@pytest.mark.parametrize('arguments', ['', '()', '(frozen=True, slots=True)', '(kw_only=True)'])
def test_a_dataclass_that_is_not_would_be_found(tmp_path, arguments):
    path = tmp_path / 'module.py'
    path.write_text(f'@dataclass{arguments}\nclass A:\n    x: int\n')

    assert [*loose_dataclasses(path)] == ['A']


COMPILERS = ('kernel', 'jit')


def compiled_functions(tree):
    """Functions of a module that are compiled."""
    for function in tree.body:
        if isinstance(function, ast.FunctionDef) and any(
            ast.unparse(decorator) in COMPILERS for decorator in function.decorator_list
        ):
            yield function


def is_kernel(module, name):
    """Whether it is a kernel, the folder of which the cache watches, too."""
    tree = tree_of(MODULES[module]) if module in MODULES else ast.Module([], [])
    return any(function.name == name for function in compiled_functions(tree))


def used_from_elsewhere(path):
    """What compiled functions of a file use from other folders of ours, kernels aside."""
    tree = ast.parse(path.read_text())
    foreign = {
        alias.asname or alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if (module := origin(path, node)).startswith('dvs_')
        and MODULES.get(module, path).parent != path.parent
        and not is_kernel(module, alias.name)
    }
    for function in compiled_functions(tree):
        names = {
            node.id
            for part in function.body
            for node in ast.walk(part)
            if isinstance(node, ast.Name)
        }
        yield from sorted(names & foreign)


@pytest.mark.parametrize('package', PACKAGES)
def test_compiled_functions_use_their_own_folder_only_which_the_cache_on_disk_watches(package):
    for name in modules_of(package):
        assert 'njit' not in MODULES[name].read_text() or name == 'dvs_common.kernel_cache'
        assert list(used_from_elsewhere(MODULES[name])) == [], name


def test_a_compiled_function_that_uses_another_folder_would_be_found():
    path = ROOT / 'src/dvs_simulation/dvs_simulation/exact/kernel/made_up.py'
    source = (
        'from dvs_common.nanoseconds import x\nfrom .heap import y\n@jit\ndef f(): return x + y'
    )

    class Written(type(path)):
        def read_text(self, *_arguments, **_options):
            return source

    assert list(used_from_elsewhere(Written(path))) == ['x']


def test_html_is_written_by_templates_only():
    for name, path in MODULES.items():
        assert not re.search(r'</?(html|body|table|div|p|h\d|svg)\b', path.read_text()), name


# What the documentation of rosbags names.
PUBLIC = {'rosbags.rosbag1', 'rosbags.rosbag2', 'rosbags.typesys', 'rosbags.typesys.store'}


def test_bags_are_read_and_written_by_public_interfaces():
    for name, path in MODULES.items():
        text = path.read_text()
        used = re.findall(r"(?:from|import|import_module\()\s*'?(rosbags[\w.]*)", text)
        assert {*used} <= PUBLIC, name
        assert not used or not re.search(r'(?:reader|rosbag[12]|typestore|types)\._', text), name


def test_tests_of_a_file_stay_on_one_worker_which_makes_once_what_they_share(request):
    if not request.config.getoption('loadgroup', False):
        pytest.skip('there is one worker')

    assert request.node.nodeid.endswith('@test_house')
