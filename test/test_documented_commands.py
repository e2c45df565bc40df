"""Every command in README.md and docs/ is run, section by section, as a reader would."""

import json
import os
import re
import signal
import subprocess
from pathlib import Path

import pytest
from documentation import blocks_of
from loop_support import ROOT, environment
from scenario_checks import check_whole_run

PAGES = [
    page
    for page in (
        ROOT / 'README.md',
        ROOT / 'CONTRIBUTING.md',
        *sorted((ROOT / 'docs').glob('*.md')),
    )
    if page.exists()
]
TIMEOUT_S = 240


def name_of(page):
    return page.relative_to(ROOT).as_posix()


def sandbox(folder):
    """Folder that looks like the checkout and keeps what the commands write."""
    folder.mkdir()
    for entry in ROOT.iterdir():
        if entry.name not in ('out', '.git'):
            (folder / entry.name).symlink_to(entry)
    return folder


def run_block(block, folder, domain):
    process = subprocess.Popen(
        ['bash', '-euo', 'pipefail', '-c', block.commands],
        cwd=folder,
        env=environment(domain),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    )
    try:
        output, _ = process.communicate(timeout=TIMEOUT_S)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
    return process.returncode, output


def is_run(block):
    return bool(block.language == 'bash' and block.commands and not block.not_run)


def run_section(page, section, folder, domain):
    """Run the commands of a section, with the files that it and those before it have written."""
    outputs = []
    for block in blocks_of(page):
        if block.file:
            file = folder / block.file
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(block.body, encoding='utf-8')
        elif is_run(block) and block.section == section:
            code, output = run_block(block, folder, domain)
            assert code == 0, f'{name_of(page)}:{block.line}\n{block.commands}\n{output}'
            assert 'Traceback' not in output, output
            outputs.append(output)
    return '\n'.join(outputs)


WITH_COMMANDS = [page for page in PAGES if any(map(is_run, blocks_of(page)))]
SECTIONS = [
    (page, section)
    for page in WITH_COMMANDS
    for section in dict.fromkeys(b.section for b in blocks_of(page) if is_run(b))
]


def check_motor(folder, output):
    angles = [float(angle) for angle in re.findall(r'angle (-?[\d.]+)', output)]
    assert abs(angles[-1]) < 0.1
    assert len(set(angles)) > 2


def result_of(folder, name):
    result = json.loads((folder / 'out' / name / 'result.json').read_text())
    assert result['regulated']
    assert result['h'] <= result['h_star']
    assert result['events'] > 10
    return result


def check_certified(folder, output):
    result = result_of(folder, 'certified-exact')
    assert result['h'] <= result['h_certified']


def check_reactors(folder, output):
    events = {name: result_of(folder, name)['events'] for name in ('reactor', 'calm_reactor')}
    assert events['calm_reactor'] < 30 < 1000 < events['reactor']
    assert (folder / 'out/calm_reactor/report.html').is_file()


def check_cart_pole(folder, output):
    assert 'cart_pole: regulated' in output
    assert (folder / 'out/cart_pole/figure.png').is_file()
    assert (folder / 'out/cart_pole/bag').is_dir()


def check_mirror_r3(folder, output):
    check_whole_run(folder / 'out' / 'mirror_r3', 'mirror_r3')


def check_hot_reactor(folder, output):
    result_of(folder, 'hot_reactor')


CHECKS = {
    'README.md: What runs': check_mirror_r3,
    'docs/bring_your_own_simulator.md: 5. Run it': check_cart_pole,
    'docs/hardware.md: Replace the plant': check_motor,
    'docs/tutorial.md: 3. Ask the question (5 minutes)': check_certified,
    'docs/tutorial.md: 4. Your own linear plant (5 minutes)': check_reactors,
    'docs/tutorial.md: 5. Your own non-linear plant (10 minutes)': check_hot_reactor,
}
# Their motor runs on the wall clock, and swings where another test holds the machine.
ON_THE_WALL_CLOCK = {
    'docs/hardware.md: Replace the plant',
    'docs/hardware.md: In both modes, with `PlantNode`',
}


def title_of(page, section):
    return f'{name_of(page)}: {section}'


def sections_to_run():
    for page, section in SECTIONS:
        title = title_of(page, section)
        marks = [pytest.mark.wall_clock] * (title in ON_THE_WALL_CLOCK)
        yield pytest.param(page, section, id=title, marks=marks)


@pytest.mark.parametrize(('page', 'section'), list(sections_to_run()))
def test_every_command_of_a_section_works(page, section, domain, tmp_path):
    folder = sandbox(tmp_path / 'checkout')
    output = run_section(page, section, folder, domain)
    CHECKS.get(title_of(page, section), lambda *_: None)(folder, output)


def test_what_is_not_run_has_a_reason():
    for page in PAGES:
        for block in blocks_of(page):
            assert not block.not_run or len(block.not_run.split()) > 2, (page, block.line)


def test_sections_that_are_named_here_exist():
    assert {*CHECKS, *ON_THE_WALL_CLOCK} <= {title_of(*section) for section in SECTIONS}


def test_the_reader_of_pages_sees_blocks_files_and_reasons(tmp_path):
    page = Path(tmp_path / 'page.md')
    page.write_text(
        'Text.\n\n## One\n\n```bash\nscripts/demo.sh\necho one\n```\n\n'
        '<!-- not run: a good reason -->\n```bash\nfalse\n```\n'
        '<!-- file: a/b.py -->\n```python\n## two\nx = 1\n```\n'
        '```console\n$ no\n```\n'
    )
    one, reason, file, console = blocks_of(page)
    assert (one.commands, one.line, one.section) == ('echo one', 5, 'One')
    assert reason.not_run == 'a good reason'
    assert (file.file, file.body) == ('a/b.py', '## two\nx = 1\n')
    assert (console.language, console.section) == ('console', 'One')


def python_blocks(page):
    return [b for b in blocks_of(page) if b.language == 'python' and not (b.file or b.not_run)]


@pytest.mark.parametrize('page', [page for page in PAGES if python_blocks(page)], ids=name_of)
def test_every_python_snippet_of_a_page_runs(page, domain, tmp_path):
    folder = sandbox(tmp_path / 'checkout')
    program = '\n'.join(block.body for block in python_blocks(page))
    run = subprocess.run(
        [ROOT / 'scripts' / 'run.sh', ROOT / '.venv' / 'bin' / 'python', '-c', program],
        cwd=folder,
        env=environment(domain),
        capture_output=True,
        text=True,
    )

    assert run.returncode == 0, run.stderr
