"""Every command in README.md and docs/ is run, page by page, as a reader would."""

import json
import os
import re
import signal
import subprocess
from pathlib import Path

import pytest
from documentation import blocks_of
from loop_support import ROOT, environment

PAGES = [
    page
    for page in (
        ROOT / 'README.md',
        ROOT / 'CONTRIBUTING.md',
        *sorted((ROOT / 'docs').glob('*.md')),
    )
    if page.exists()
]
WITH_COMMANDS = [
    page
    for page in PAGES
    if any(b.language == 'bash' and b.commands and not b.not_run for b in blocks_of(page))
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


def run_page(page, folder, domain):
    outputs = []
    for block in blocks_of(page):
        if block.file:
            file = folder / block.file
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(block.body, encoding='utf-8')
        elif block.language == 'bash' and block.commands and not block.not_run:
            code, output = run_block(block, folder, domain)
            assert code == 0, f'{name_of(page)}:{block.line}\n{block.commands}\n{output}'
            assert 'Traceback' not in output, output
            outputs.append(output)
    return '\n'.join(outputs)


def check_motor(folder, output):
    angles = [float(angle) for angle in re.findall(r'angle (-?[\d.]+)', output)]
    assert abs(angles[-1]) < 0.1
    assert len(set(angles)) > 2


def check_reactors(folder, output):
    results = {
        name: json.loads((folder / 'out' / name / 'result.json').read_text())
        for name in ('reactor', 'calm_reactor', 'hot_reactor', 'certified-exact')
    }
    for name, result in results.items():
        assert result['regulated'], name
        assert result['h'] <= result['h_star']
        assert result['events'] > 10
    assert results['certified-exact']['h'] <= results['certified-exact']['h_certified']
    assert results['calm_reactor']['events'] < 30 < 1000 < results['reactor']['events']
    assert (folder / 'out/calm_reactor/report.html').is_file()


CHECKS = {'docs/hardware.md': check_motor, 'docs/tutorial.md': check_reactors}


# Its motor runs on the wall clock, and swings where another test holds the machine.
ON_THE_WALL_CLOCK = {'docs/hardware.md'}


def pages_to_run():
    return [
        pytest.param(page, marks=pytest.mark.wall_clock)
        if name_of(page) in ON_THE_WALL_CLOCK
        else page
        for page in WITH_COMMANDS
    ]


@pytest.mark.parametrize('page', pages_to_run(), ids=name_of)
def test_every_command_of_a_page_works(page, domain, tmp_path):
    folder = sandbox(tmp_path / 'checkout')
    output = run_page(page, folder, domain)
    CHECKS.get(name_of(page), lambda *_: None)(folder, output)


def test_what_is_not_run_says_why():
    for page in PAGES:
        for block in blocks_of(page):
            assert not block.not_run or len(block.not_run.split()) > 2, (page, block.line)


def test_pages_with_special_checks_exist():
    assert set(CHECKS) <= {name_of(page) for page in WITH_COMMANDS}


def test_the_reader_of_pages_sees_blocks_files_and_reasons(tmp_path):
    page = Path(tmp_path / 'page.md')
    page.write_text(
        'Text.\n\n```bash\nscripts/demo.sh\necho one\n```\n\n<!-- not run: a good reason -->\n'
        '```bash\nfalse\n```\n<!-- file: a/b.py -->\n```python\nx = 1\n```\n'
        '```console\n$ no\n```\n'
    )
    one, reason, file, console = blocks_of(page)
    assert (one.commands, one.line) == ('echo one', 3)
    assert reason.not_run == 'a good reason'
    assert (file.file, file.body) == ('a/b.py', 'x = 1\n')
    assert console.language == 'console'


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
