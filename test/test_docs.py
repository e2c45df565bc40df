"""Pages that are made from the code are up to date, and pages name what exists."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

from dvs_common.scenario.parameters import SCHEMA
from dvs_common.wire import topics
from dvs_common.wire.events import LABELLED_EVENT_DTYPE

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / 'docs'
NUMPY_NAMES = {'UINT16': 'u2', 'INT32': 'i4', 'UINT32': 'u4', 'INT8': 'i1', 'UINT8': 'u1'}


def test_the_page_of_parameters_is_not_stale():
    script = ROOT / 'scripts' / 'parameters_doc.py'
    check = subprocess.run([sys.executable, script, '--check'], capture_output=True, text=True)

    assert check.returncode == 0, check.stderr


def test_the_page_of_parameters_has_a_row_for_each():
    text = (DOCS / 'parameters.md').read_text()

    assert re.findall(r'(?m)^\| `([\w.]+)` \|', text) == list(SCHEMA)


def test_the_wire_contract_has_a_row_for_every_topic():
    text = (DOCS / 'wire_contract.md').read_text()
    rows = set(re.findall(r'(?m)^\| `([\w/]+)` \|', text))

    names = {v for k, v in vars(topics).items() if k.isupper() and isinstance(v, str)}
    assert names <= rows


def test_the_wire_contract_has_the_layout_of_an_event():
    text = (DOCS / 'wire_contract.md').read_text()
    text = text[text.index('## An event') : text.index('## Keyframe')]
    rows = re.findall(r'(?m)^\| `(\w+)` \| (\d+) \| (\w+) \|', text)

    layout = {name: (int(offset), NUMPY_NAMES[kind]) for name, offset, kind in rows}
    assert layout == {
        name: (offset, kind.str[1:])
        for name, (kind, offset) in LABELLED_EVENT_DTYPE.fields.items()
    }


def test_the_index_lists_every_page():
    pages = {page.name for page in DOCS.glob('*.md')} - {'README.md'}

    assert set(re.findall(r'\]\((\w[\w-]*\.md)\)', (DOCS / 'README.md').read_text())) == pages
    assert set(re.findall(r'\]\(docs/([\w-]+\.md)\)', (ROOT / 'README.md').read_text())) >= pages


PAGES = (ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *sorted(DOCS.glob('*.md')))
LINK = re.compile(r'\]\((?!https?://)([^)#\s]*)(?:#([^)\s]+))?\)')


def anchors(page):
    """Anchors that GitHub gives the headings of a page."""
    text = re.sub(r'(?ms)^```.*?^```$', '', page.read_text(encoding='utf-8'))
    titles = [title.replace('`', '').lower() for title in re.findall(r'(?m)^#{1,6} (.*)$', text)]
    return {re.sub(r'[^\w\- ]', '', title).strip().replace(' ', '-') for title in titles}


@pytest.mark.parametrize('page', PAGES, ids=lambda path: path.name)
def test_links_lead_to_files_and_headings(page):
    for target, anchor in LINK.findall(page.read_text(encoding='utf-8')):
        path = (page.parent / target).resolve() if target else page
        assert path.exists(), target
        assert not anchor or path.suffix != '.md' or anchor in anchors(path), f'{target}#{anchor}'


@pytest.mark.parametrize('page', PAGES, ids=lambda path: path.name)
def test_a_page_begins_with_one_heading_and_what_it_answers(page):
    title, _, rest = page.read_text(encoding='utf-8').partition('\n')
    paragraph = rest.strip().partition('\n\n')[0]

    assert title.startswith('# ')
    assert len(paragraph.split()) > 8, paragraph
    assert not re.match(r'[#|<!]|```', paragraph), paragraph


def definition(path, dotted):
    """Node of the syntax tree that defines a name, `Class.method` too; None if there is none."""
    body = ast.parse(path.read_text(encoding='utf-8')).body
    found = None
    for name in dotted.split('.'):
        found = next((node for node in body if name in names_of(node)), None)
        body = getattr(found, 'body', [])
    return found


def names_of(node):
    if isinstance(node, ast.ClassDef | ast.FunctionDef):
        return [node.name]
    targets = getattr(node, 'targets', [getattr(node, 'target', None)])
    return [target.id for target in targets if isinstance(target, ast.Name)]


def source_file(name):
    """File of the architecture page: below its package, or below the root."""
    package = name.partition('/')[0]
    return ROOT / name if package in ('scripts', 'test') else ROOT / 'src' / package / name


def test_the_table_of_questions_names_files_that_define_the_answer():
    text = (DOCS / 'architecture.md').read_text(encoding='utf-8')
    rows = re.findall(r'(?m)^\| ([^|]+\?) \| `([^`]+)` \| `([^`]+)` \|$', text)

    assert len(rows) >= 30
    for question, file, name in rows:
        assert definition(source_file(file), name) is not None, (question, file, name)


def test_the_table_of_dvs_common_has_every_module():
    text = (DOCS / 'architecture.md').read_text(encoding='utf-8')
    table = text.partition('## `dvs_common`, module by module')[2].partition('\n\nThe running')[0]
    modules = {path.stem for path in (ROOT / 'src/dvs_common/dvs_common').rglob('*.py')}

    assert len(table) > 1000
    assert sorted(modules - {'__init__'} - set(re.findall(r'`(\w+)`', table))) == []


def rooms(package):
    """Folders of a package that hold modules of their own."""
    code = ROOT / 'src' / package / package
    return {path.parent for path in code.glob('*/__init__.py')} or {code}


def test_every_room_of_every_package_has_its_paragraph():
    text = (DOCS / 'architecture.md').read_text(encoding='utf-8')
    parts = re.split(r'(?m)^### `(dvs_\w+)`.*$', text.partition('\n## The way')[0])[1:]
    assert set(parts[::2]) == {path.name for path in (ROOT / 'src').glob('dvs_*')}

    for package, part in zip(parts[::2], parts[1::2], strict=True):
        paragraphs = re.findall(
            r'(?ms)^(?:- \*\*`(\w+)/`\*\*|One room:) (.*?)(?=^- |\n\n|\Z)', part
        )
        assert {name or package for name, _ in paragraphs} == {r.name for r in rooms(package)}
        for name, paragraph in paragraphs:
            folder = ROOT / 'src' / package / package / name
            first = re.findall(r'`(\w+\.py)`', paragraph.rpartition(': ')[2])
            assert first and all((folder / module).is_file() for module in first), paragraph


def test_the_way_of_an_event_names_files_that_exist():
    text = (DOCS / 'architecture.md').read_text(encoding='utf-8')
    way = text.partition('## The way of one event')[2].partition('\n## ')[0]
    files = re.findall(r'`(dvs_\w+/[\w/]+\.py)`', way)

    assert len(files) > 10
    assert [file for file in files if not source_file(file).is_file()] == []


@pytest.mark.parametrize('page', ['README.md', 'CONTRIBUTING.md', *DOCS.glob('*.md')], ids=str)
def test_files_that_a_page_names_exist(page):
    text = re.sub(r'(?ms)^```.*?^```$', '', (ROOT / page).read_text(encoding='utf-8'))
    named = re.findall(r'`((?:src|test|scripts|config|examples|docs)/[\w./-]*\w)`', text)

    assert [name for name in named if not (ROOT / name).exists()] == []


def test_what_contributing_names_beside_a_file_is_there():
    """A row's further file names stand for files in the folder that the row names first."""
    text = (ROOT / 'CONTRIBUTING.md').read_text(encoding='utf-8')
    for row in re.findall(r'(?m)^\| (?:a|an) .*$', text):
        first = re.search(r'`(src/[^`]+)`', row)
        folder = ROOT / (first[1] if first else '.')
        folder = folder if folder.is_dir() else folder.parent
        for name in re.findall(r'`(\w+\.py)`', row):
            assert (folder / name).is_file(), name


TOOL = re.compile(r'\b(ros2 [a-z]+|rqt|rviz2|plotjuggler|colcon|rosdep)\b')


def tools_of(text):
    """ROS tools in the code of a page: between backticks, and after the start of a line."""
    code = [
        *re.findall(r'`([^`\n]+)`', text),
        *re.findall(r'^(?:\$ )?(ros2 .*)$', text, re.MULTILINE),
    ]
    return {tool for piece in code if (match := TOOL.match(piece)) for tool in [match[1]]}


def test_every_ros_tool_that_a_page_names_is_in_the_table_of_what_was_tried():
    index = (ROOT / 'docs' / 'README.md').read_text(encoding='utf-8')
    table = index.partition('## ROS tools')[2]
    tried = set(TOOL.findall(table))
    named = set()
    for page in (ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *(ROOT / 'docs').glob('*.md')):
        named |= tools_of(page.read_text(encoding='utf-8'))

    assert {'ros2 run', 'ros2 bag', 'ros2 launch', 'rqt', 'colcon'} <= named <= tried
