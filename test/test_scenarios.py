"""Every scenario in config/ regulates, run as three node processes over Fast DDS."""

import json

import pytest
from loop_support import CONFIG, run_closed_loop
from scenario_checks import BYTES, RECORDED, check_scenario

LOCKSTEP = sorted(p.stem for p in CONFIG.glob('*.yaml') if 'mode: lockstep' in p.read_text())
# README.md has its command; test_documented_commands.py runs and checks that.
OF_THE_README = 'mirror_r3'


def test_the_published_scenarios_are_there():
    published = {'paper_r1', 'paper_r3', 'paper_r9', 'mirror_r1', 'mirror_r3', 'mirror_r9'}
    assert published | {'platform'} <= set(LOCKSTEP)


def test_bytes_are_recorded_for_every_scenario():
    assert set(RECORDED['scenarios']) == set(LOCKSTEP)
    if not BYTES:
        pytest.skip('this machine rounds otherwise than the one that recorded the bytes')


@pytest.mark.parametrize('scenario', sorted({*LOCKSTEP} - {OF_THE_README}))
def test_scenario_regulates(scenario, domain, tmp_path):
    run = run_closed_loop(scenario, domain, tmp_path)

    assert run.returncode == 0, run.stdout + run.stderr
    check_scenario(tmp_path, scenario)


@pytest.mark.wall_clock
def test_realtime_mode_regulates_at_250_hz(new_domain, tmp_path):
    # An operating system that is not a realtime one may hiccup by 20 ms, too much for this plant:
    # one of three runs has to go through.
    for attempt in range(3):
        output = tmp_path / str(attempt)
        run = run_closed_loop('mirror_r3_realtime', new_domain(), output)
        if run.returncode == 0:
            break

    assert run.returncode == 0, run.stdout + run.stderr
    result = json.loads((output / 'mirror_r3_realtime' / 'result.json').read_text())
    assert result['regulated']
    # Six seconds from the first command on, which comes when the machine lets it.
    assert 6 <= result['simulated_seconds'] < 8
    assert result['wall_seconds'] == pytest.approx(result['simulated_seconds'], abs=0.1)
    samples = round(result['simulated_seconds'] / 0.004) + 1
    assert result['cycles'] + result['samples_skipped'] == samples
    assert result['cycles'] >= 1000


def test_a_threshold_far_too_coarse_is_judged_as_not_regulated(domain, tmp_path):
    coarse = tmp_path / 'coarse.yaml'
    text = (CONFIG / 'mirror_r3.yaml').read_text()
    coarse.write_text(text.replace('event_threshold: 0.15', 'event_threshold: 0.6'))

    run = run_closed_loop(coarse, domain, tmp_path, '--duration', '2')

    assert run.returncode == 1
    assert 'exceeds h*' in run.stderr
