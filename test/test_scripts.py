"""Every script runs, each in its small form; those that need a browser are left to their user."""

import json
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS = ROOT / 'scripts'
# Run by tests of their own, or with a browser only.
ELSEWHERE = {
    'checkout.py': 'what the others import to find the packages; test_output_option',
    'compile_kernels.py': 'setup.sh runs it, in every checkout that is tested',
    'dashboard_screenshot.py': 'needs chromium; the page itself is tested by test_dashboard',
    'library_doc.py': 'test_library',
    'listener_table.py': 'it takes a running loop; test_plants_of_others runs its listener',
    'parameters_doc.py': 'test_docs',
    'security_policy.py': 'test_security',
    'version.py': 'test_manifests',
}
COMMANDS = {
    'bench.py': ('--quick', '--json', 'OUTPUT/bench.json'),
    'figures_camera.py': ('--output', 'OUTPUT'),
    'profile_figure.py': ('--output', 'OUTPUT', '--wall', 'OUTPUT/wall.png'),
    'real_sensor_table.py': ('--quick', '--duration', '1', '--output', 'OUTPUT'),
    'scale_figure.py': ('--output', 'OUTPUT'),
    'textbook_figures.py': ('--quick', '--output', 'OUTPUT'),
    'trade_figure.py': ('--quick', '--output', 'OUTPUT'),
}
BENCHMARKS = {path.name for path in SCRIPTS.glob('bench_*.py')}
KEYS = {
    'lockstep_vs_ring',
    'composed_vs_ring',
    'sampled_cycles_per_s_r9',
    'controller_mev_100k',
    'controller_mev_1k',
    'latency_p50_vs_ring',
    'latency_p99_vs_ring',
    'camera_mev_346_dense',
    'camera_mev_346_sparse',
    'camera_mev_720p_dense',
    'camera_mev_720p_sparse',
    'camera_mev_346_noisy',
    'camera_two_threads',
    'exact_vs_dop853_r1',
    'exact_vs_dop853_r9',
    'exact_vs_rk45_r100',
    'exact_us_per_event_r10000',
    'start_to_first_command_s',
} | ({'design_vs_dkpy'} if find_spec('dkpy') else set())


def run(script, *arguments):
    return subprocess.run(
        [sys.executable, str(SCRIPTS / script), *arguments],
        capture_output=True,
        text=True,
        timeout=480,
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
        assert figures.keys() >= KEYS
        assert all(figures[key] > 0 for key in KEYS)


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
def test_a_shortcut_names_its_gain_as_the_page_of_benchmarks_does(key):
    table = (ROOT / 'docs' / 'benchmarks.md').read_text()
    measured = re.search(rf'^\| `{key}` .*\| ([\d.]+) \|$', table, re.MULTILINE)
    source = ' '.join((ROOT / 'src' / SHORTCUTS[key]).read_text().split())
    sentence = source.partition(f'`{key}`')[0].rpartition('(')[0][-120:]

    assert measured
    assert measured[1] in re.findall(r'\d+(?:\.\d+)?', sentence)
    assert f"'{key}'" in (SCRIPTS / 'bench_cycle.py').read_text()


def test_a_comparison_names_what_is_slower_by_more_than_the_spread(tmp_path):
    old = {'a_mev': 10.0, 'b_mev': 10.0, 'c_s': 1.0, 'd_s': 1.0, 'e_mev': 5.0, 'e_mev_spread': 0.5}
    new = {'a_mev': 8.0, 'b_mev': 9.5, 'c_s': 1.3, 'd_s': 0.5, 'e_mev': 4.0, 'f_mev': 1.0}
    (tmp_path / 'old.json').write_text(json.dumps(old))
    program = f"""
import sys, types
sys.path.insert(0, {str(SCRIPTS)!r})
module = types.ModuleType('bench_loop')
module.measure = lambda quick: {new}
sys.modules['bench_loop'] = module
import bench
sys.argv[1:] = ['loop', '--compare', {str(tmp_path / 'old.json')!r}]
sys.exit(bench.main())
"""
    result = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)

    assert result.returncode == 0, result.stderr
    slower = [line for line in result.stdout.splitlines() if line.startswith('slower')]
    assert slower == [
        'slower: a_mev: 10 -> 8, 25 % (spread 10 %)',
        'slower: c_s: 1 -> 1.3, 30 % (spread 10 %)',
    ]
