"""package.xml and the requirements name what the code imports: no less, and no more."""

from __future__ import annotations

import ast
import itertools
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest
from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.changelog_generator import FORTHCOMING_LABEL
from catkin_pkg.package import parse_package

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = sorted((ROOT / 'src').glob('dvs_*'), key=lambda path: path.name)
# Names of imports that differ from the rosdep key; a package of ROS has its own name.
KEYS = {
    'PIL': 'python3-pil',
    'aiohttp': 'python3-aiohttp',
    'control': 'python-control-pip',
    'ament_index_python': 'ament_index_python',
    'h5py': 'python3-h5py',
    'hypothesis': 'python3-hypothesis',
    'jinja2': 'python3-jinja2',
    'lz4': 'python3-lz4',
    'matplotlib': 'python3-matplotlib',
    'numba': 'python3-numba',
    'numpy': 'python3-numpy',
    'pytest': 'python3-pytest',
    'rosbags': 'python3-rosbags-pip',
    'scipy': 'python3-scipy',
    'tqdm': 'python3-tqdm',
    'yaml': 'python3-yaml',
}
# Known to PyPI alone: a comment in package.xml lists them.
WITHOUT_KEY = {'aedat', 'distributed', 'evt3', 'mcap', 'mpmath', 'zstandard'}
# Used where they are installed; nothing fails without them.
OPTIONAL = {'cv2', 'dvs_msgs', 'event_camera_msgs', 'hdf5plugin'}
# Generators of messages, by which a test makes the package event_camera_msgs.
OPTIONAL |= {
    'rosidl_adapter',
    'rosidl_generator_c',
    'rosidl_generator_py',
    'rosidl_generator_type_description',
    'rosidl_typesupport_c',
    'rosidl_typesupport_fastrtps_c',
    'rosidl_typesupport_introspection_c',
}
PYPI_NAMES = {'PIL': 'Pillow', 'jinja2': 'Jinja2', 'yaml': 'PyYAML'}
# A message class that is imported by its name.
MESSAGE_TYPE = re.compile(r'\w+/msg/\w+')
NOT_ON_PYPI = re.compile(r'.*_msgs|rcl_interfaces|rclpy|launch|launch_ros|ament_index_python')


def imports(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield node.module or ''
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith('import_module'):
            named = node.args[0]
            if isinstance(named, ast.Constant) and isinstance(named.value, str):
                yield named.value
        elif isinstance(node, ast.Constant) and MESSAGE_TYPE.fullmatch(str(node.value)):
            yield str(node.value).partition('/')[0]


def imported(package: Path, *, tests: bool) -> set[str]:
    """Top-level modules from elsewhere that the package, or its tests, import."""
    files = {path for path in package.rglob('*.py') if path.name != 'setup.py'}
    of_tests = set((package / 'test').rglob('*.py'))
    chosen = of_tests if tests else files - of_tests
    own = {
        package.name,
        'dvs_interfaces',
        *(path.stem for path in (ROOT / 'src').glob('*/test/*.py')),
    }
    found = {name.split('.')[0] for path in chosen for name in imports(path)}
    return found - own - OPTIONAL - sys.stdlib_module_names


def declared(package: Path, *tags: str) -> set[str]:
    manifest = ElementTree.parse(package / 'package.xml')
    return {element.text or '' for tag in tags for element in manifest.iter(tag)}


def keys(names: set[str]) -> set[str]:
    return {KEYS.get(name, name) for name in names - WITHOUT_KEY}


@pytest.mark.parametrize('package', PACKAGES, ids=lambda path: path.name)
def test_a_package_depends_on_what_it_imports(package: Path) -> None:
    runtime = keys(imported(package, tests=False))

    assert declared(package, 'depend', 'exec_depend') == runtime
    in_tests = keys(imported(package, tests=True)) - runtime
    assert declared(package, 'test_depend') == in_tests


@pytest.mark.parametrize('package', PACKAGES, ids=lambda path: path.name)
def test_a_manifest_lists_the_imports_without_a_rosdep_key(package: Path) -> None:
    needed = imported(package, tests=False) | imported(package, tests=True)
    comment = re.search(r'No rosdep key: ([\w, ]+?) \(', (package / 'package.xml').read_text())

    assert set(comment.group(1).split(', ') if comment else ()) == needed & WITHOUT_KEY


def required(*files: str) -> set[str]:
    text = '\n'.join((ROOT / file).read_text() for file in files)
    return {name.lower() for name in re.findall(r'(?m)^([A-Za-z][\w-]*)', text)}


@pytest.mark.parametrize('tests', [False, True], ids=['packages', 'tests'])
def test_the_requirements_name_what_pypi_provides(tests: bool) -> None:
    files = ['requirements.txt', *(['requirements-test.txt'] if tests else [])]
    needed = set().union(*(imported(package, tests=tests) for package in PACKAGES))
    own = {package.name for package in PACKAGES}
    from_pypi = {n for n in needed - own if not NOT_ON_PYPI.fullmatch(n)}

    assert {PYPI_NAMES.get(n, n).lower() for n in from_pypi} - required(*files) == set()


class Named(ast.NodeTransformer):
    """The name in place of `beside(name)`, which adds the folder of a package of ours."""

    def visit_Call(self, node: ast.Call) -> ast.expr:
        assert ast.unparse(node.func) == 'beside'
        return node.args[0]


def setup_arguments(package: Path) -> dict[str, object]:
    """What setup.py gives setuptools; its package.xml is read as at a build."""
    tree = ast.parse((package / 'setup.py').read_text(encoding='utf-8'))
    call = next(
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func) == 'setup'
    )
    return {
        keyword.arg or '': ast.literal_eval(Named().visit(keyword.value))
        for keyword in call.keywords
        if keyword.arg in ('install_requires', 'extras_require', 'entry_points')
    }


@pytest.mark.parametrize('package', PACKAGES, ids=lambda path: path.name)
def test_pip_gets_every_import(package: Path) -> None:
    """Each is required or in an extra; all bounds are those of the requirements files."""
    arguments = setup_arguments(package)
    install, extras = arguments['install_requires'], arguments['extras_require']
    assert isinstance(install, list) and isinstance(extras, dict)
    named = {*install, *itertools.chain(*extras.values())}
    names = {re.split(r'[\[<>=]', requirement)[0].lower() for requirement in named}

    needed = imported(package, tests=False) | imported(package, tests=True)
    from_pypi = {n for n in needed if not NOT_ON_PYPI.fullmatch(n)}
    assert {PYPI_NAMES.get(n, n).lower() for n in from_pypi} - names == set()
    ours = {other.name for other in PACKAGES}
    everywhere = ''.join(file.read_text() for file in ROOT.glob('requirements*.txt')).lower()
    assert {n for n in named - ours if f'{n.lower()}\n' not in everywhere} == set()


@pytest.mark.parametrize('package', PACKAGES, ids=lambda path: path.name)
def test_a_manifest_is_valid_and_gives_setup_py_its_fields(package: Path) -> None:
    manifest = parse_package(package / 'package.xml', warnings=(warnings := []))
    setup = (package / 'setup.py').read_text()

    assert warnings == []
    assert manifest.name == package.name
    assert manifest.licenses[0] == 'Apache-2.0'
    assert manifest.licenses[0].file == 'LICENSE'
    assert manifest.get_build_type() == 'ament_python'
    assert (package / 'LICENSE').read_text() == (ROOT / 'LICENSE').read_text()
    assert (package / 'resource' / package.name).exists()
    for field in ('version', 'description', 'license', 'maintainer'):
        assert f"{field}=manifest.findtext('{field}')" in setup


def test_the_version_is_that_of_the_file_version() -> None:
    check = [sys.executable, ROOT / 'scripts' / 'version.py', '--check']

    assert subprocess.run(check).returncode == 0
    heading = re.search(r'(?m)^(\d+\.\d+\.\d+) \(', (ROOT / 'CHANGELOG.rst').read_text())
    assert heading is not None
    assert heading[1] == (ROOT / 'VERSION').read_text().strip()


def test_all_packages_have_one_maintainer() -> None:
    found = [parse_package(package / 'package.xml').maintainers for package in PACKAGES]
    people = {(person.name, person.email) for maintainers in found for person in maintainers}

    assert len(people) == 1


@pytest.mark.parametrize('package', PACKAGES, ids=lambda path: path.name)
def test_a_changelog_is_one_that_catkin_tools_read(package: Path) -> None:
    text = (package / 'CHANGELOG.rst').read_text()
    title = f'Changelog for package {package.name}'
    head = f'{"^" * len(title)}\n{title}\n{"^" * len(title)}\n\n'

    assert text.startswith(head)
    released = rf'{re.escape((ROOT / "VERSION").read_text().strip())} \([\d-]+\)'
    assert re.match(rf'({FORTHCOMING_LABEL}|{released})\n-+\n\* \S', text[len(head) :])
    assert get_changelog_from_path(str(package), package.name) is not None


def test_colcon_runs_the_tests_of_a_package(tmp_path: Path) -> None:
    """Every setup.py names pytest among what its tests need, which makes colcon run it."""
    for package in PACKAGES:
        extras = setup_arguments(package)['extras_require']
        assert isinstance(extras, dict) and any('pytest>' in need for need in extras['test'])
    colcon = 'import sys; from colcon_core.command import main; sys.exit(main())'
    run = subprocess.run(
        [sys.executable, '-c', colcon, '--log-base', str(tmp_path / 'log'), 'test']
        + ['--build-base', str(tmp_path / 'build'), '--packages-select', 'dvs_plant_sim']
        + ['--event-handlers', 'console_direct+'],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )

    assert re.search(r'\d+ passed', run.stdout), run.stdout + run.stderr
    assert run.returncode == 0, run.stdout + run.stderr
