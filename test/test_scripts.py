"""Every script runs, each in its small form; those that need a browser are left to their user."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS = ROOT / 'scripts'
# Run by tests of their own, or with a browser only.
ELSEWHERE = {
    'dashboard_screenshot.py': 'needs chromium; the page itself is tested by test_dashboard',
    'library_doc.py': 'test_library',
    'parameters_doc.py': 'test_docs',
    'security_policy.py': 'test_security',
    'version.py': 'test_manifests',
}
COMMANDS = {
    'bench.py': ('--quick', '--json', 'OUTPUT/bench.json'),
    'figures_camera.py': ('--output', 'OUTPUT'),
    'real_sensor_table.py': ('--quick', '--duration', '1', '--output', 'OUTPUT/real.png'),
    'textbook_figures.py': ('--quick', '--output', 'OUTPUT'),
    'trade_figure.py': ('--quick', '--output', 'OUTPUT/trade.png'),
}
BENCHMARKS = {path.name for path in SCRIPTS.glob('bench_*.py')}


def run(script, *arguments):
    return subprocess.run(
        [sys.executable, str(SCRIPTS / script), *arguments],
        capture_output=True,
        text=True,
        timeout=240,
    )


def test_no_script_is_forgotten():
    scripts = {path.name for path in SCRIPTS.glob('*.py')}

    assert scripts == {*ELSEWHERE, *COMMANDS, *BENCHMARKS}


@pytest.mark.parametrize('script', COMMANDS)
def test_a_script_runs_small_and_leaves_its_files(script, tmp_path):
    arguments = [argument.replace('OUTPUT', str(tmp_path)) for argument in COMMANDS[script]]

    result = run(script, *arguments)

    assert result.returncode == 0, result.stderr
    assert 'Traceback' not in result.stderr
    assert list(tmp_path.iterdir())
    if script == 'bench.py':
        figures = json.loads((tmp_path / 'bench.json').read_text())
        assert {'lockstep_vs_ring', 'camera_vs_numpy', 'design_seconds'} <= figures.keys()
        assert figures['exact_us_per_event_r10000'] > 0


def test_a_benchmark_that_fails_keeps_what_was_measured(tmp_path):
    program = f"""
import sys, types
sys.path.insert(0, {str(SCRIPTS)!r})
for name, measured in (('loop', {{'a': 1.0}}), ('camera', None), ('exact', {{'b': 2.0}})):
    module = types.ModuleType('bench_' + name)
    module.measure = lambda quick, measured=measured: dict(measured)
    sys.modules[module.__name__] = module
import bench
sys.argv[1:] = ['loop', 'camera', 'exact', '--json', {str(tmp_path / 'bench.json')!r}]
sys.exit(bench.main())
"""
    result = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)

    assert result.returncode == 1
    assert 'failed: camera' in result.stderr
    assert json.loads((tmp_path / 'bench.json').read_text()) == {'a': 1.0, 'b': 2.0}


# Each shortcut of a cycle: the one place that it stands in, and the figure that is measured.
SHORTCUTS = {
    'cycle_cdr_gain': 'dvs_common/dvs_common/wire/cdr.py',
    'cycle_generated_variants': 'dvs_common/dvs_common/wire/cdr.py',
    'cycle_memo_gain': 'dvs_common/dvs_common/wire/stamped.py',
    'cycle_look_ahead_gain': 'dvs_hinf_controller/dvs_hinf_controller/running/look_ahead.py',
    'cycle_silent_band_gain': 'dvs_event_camera/dvs_event_camera/pixels/silent_band.py',
}


@pytest.mark.parametrize('key', SHORTCUTS)
def test_a_shortcut_says_what_it_is_worth_as_the_page_of_benchmarks_does(key):
    table = (ROOT / 'docs' / 'benchmarks.md').read_text()
    measured = re.search(rf'^\| `{key}` .*\| ([\d.]+) \|$', table, re.MULTILINE)
    source = ' '.join((ROOT / 'src' / SHORTCUTS[key]).read_text().split())
    sentence = source.partition(f'`{key}`')[0].rpartition('(')[0][-120:]

    assert measured
    assert measured[1] in re.findall(r'\d+(?:\.\d+)?', sentence)
    assert f"'{key}'" in (SCRIPTS / 'bench_cycle.py').read_text()
