"""package.xml and the requirements name what the code imports: no less, and no more."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = sorted((ROOT / 'src').glob('dvs_*'), key=lambda path: path.name)
# Names of imports that differ from the rosdep key; a package of ROS has its own name.
KEYS = {
    'PIL': 'python3-pil',
    'aiohttp': 'python3-aiohttp',
    'ament_index_python': 'ament_index_python',
    'hypothesis': 'python3-hypothesis',
    'matplotlib': 'python3-matplotlib',
    'numba': 'python3-numba',
    'numpy': 'python3-numpy',
    'pytest': 'python3-pytest',
    'scipy': 'python3-scipy',
    'tqdm': 'python3-tqdm',
    'yaml': 'python3-yaml',
}
# Known to PyPI alone: a comment in package.xml says so.
WITHOUT_KEY = {'control', 'distributed', 'mcap', 'mpmath', 'rosbags'}
# Used where they are installed; nothing fails without them.
OPTIONAL = {'cv2', 'event_camera_msgs'}
PYPI_NAMES = {'PIL': 'Pillow', 'yaml': 'PyYAML'}
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
def test_what_has_no_key_is_said(package: Path) -> None:
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


@pytest.mark.parametrize('package', PACKAGES, ids=lambda path: path.name)
def test_name_version_licence_and_build_type_agree(package: Path) -> None:
    manifest = ElementTree.parse(package / 'package.xml')
    setup = (package / 'setup.py').read_text()
    version = manifest.findtext('version')

    assert manifest.findtext('name') == package.name
    assert f"version='{version}'" in setup
    assert manifest.findtext('license') == 'Apache-2.0'
    assert "license='Apache-2.0'" in setup
    assert manifest.findtext('export/build_type') == 'ament_python'
    assert 'Apache License' in (ROOT / 'LICENSE').read_text()
    assert (package / 'resource' / package.name).exists()
    described = manifest.findtext('description') or ''
    assert f"description='{described}'" in setup
