"""The critical threshold of a user's own plant: random and adversarial runs beside the bounds."""

from pathlib import Path

import numpy as np
import pytest

from dvs_common.scenario.scenario import load_scenario
from dvs_simulation.cli import main
from dvs_simulation.commands import sweep
from dvs_simulation.exact import ClosedLoop, simulate
from dvs_simulation.judging.trace import decode_trace
from dvs_simulation.sampled.sampled_loop import run_sampled
from dvs_simulation.sweep.own_plant import own_thresholds, run_own_plant_task
from dvs_simulation.sweep.sweep_figures import save_study_figure

ROOT = Path(__file__).resolve().parents[3]
FILE = ROOT / 'config' / 'mirror_r1.yaml'


@pytest.fixture(scope='module')
def rows():
    scenario = load_scenario(FILE).replace(duration=6.0)
    found = run_own_plant_task(
        scenario=scenario, method='structured', thresholds=[0.1, 0.45], runs=3, seed=0
    )
    return [{key: str(value) for key, value in row.items()} for row in found]


def test_a_fine_threshold_holds_the_tolerance_and_a_coarse_one_does_not(rows):
    (line,) = own_thresholds(rows)

    assert line.h_certified < line.h_star < line.adversarial == 0.45


def test_an_adversarial_disturbance_is_at_least_as_bad_as_a_random_one(rows):
    for random, adversarial in zip(rows[::2], rows[1::2], strict=True):
        assert (random['kind'], adversarial['kind']) == ('random', 'adversarial')
        assert float(adversarial['limsup']) >= float(random['limsup'])


def test_a_run_that_has_not_settled_has_not_left_eps():
    """A slowest pole that needs 20 s in a scenario of 4 s, below the certified threshold."""
    heading = load_scenario(ROOT / 'config' / 'textbook' / 'heading.yaml')
    slow = heading.replace(settling_time=0.0, duration=4.0)
    rows = run_own_plant_task(
        scenario=slow, method='unstructured', thresholds=[0.08], runs=3, seed=0
    )

    assert rows[0]['h_certified'] > 0.08
    assert all(0 < row['limsup'] < row['tolerance'] for row in rows)


def test_a_dim_start_is_known_as_well_as_the_promise_takes_it():
    """Forty steps once found a start at which the references were known less, and left eps."""
    scenario = load_scenario(FILE)
    rows = run_own_plant_task(
        scenario=scenario, method='unstructured', thresholds=[0.09878985], runs=40, seed=0
    )

    assert all(row['h'] < row['h_certified'] for row in rows)
    assert all(row['limsup'] < row['tolerance'] for row in rows)


def test_a_file_is_refused_by_the_other_studies(tmp_path, capsys):
    options = ['--params-file', str(FILE), '--output', str(tmp_path / 'out.csv')]

    assert main(['sweep', '--study', 'pixels', *options]) == 2
    assert 'is for --study threshold' in capsys.readouterr().err


def test_the_figure_has_a_panel_a_method(tmp_path, rows):
    save_study_figure('own_plant', rows, tmp_path / 'own.png')

    assert (tmp_path / 'own.png').stat().st_size > 10_000


def test_a_constant_load_moves_the_exact_loop_and_the_sampled_one_alike():
    parameters = {'duration': 0.3, 'sampling_period': 1e-4, 'method': 'structured'}
    scenario = load_scenario(FILE).replace(
        **parameters, constant_load=(0.3,), output_disturbance=0.001
    )
    sampled = run_sampled(scenario)
    trace = decode_trace(sampled.messages)
    times = np.minimum(trace.times_s, 0.3)
    loop = ClosedLoop.from_scenario(scenario, sampled.design.controller)
    exact = simulate(loop, duration=0.3, sample_times=times)
    free = simulate(
        ClosedLoop.from_scenario(
            scenario.replace(constant_load=(), output_disturbance=0.0),
            sampled.design.controller,
        ),
        duration=0.3,
        sample_times=times,
    )

    assert np.abs(exact.states - trace.states).max() < 2e-3
    assert np.abs(free.states - trace.states).max() > 1e-2


def test_each_scenario_has_a_file_of_its_name(monkeypatch, tmp_path, capsys):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(sweep, 'run_study', interrupted)
    for stem in ('mirror_r1', 'paper_r1'):
        file = FILE.with_name(f'{stem}.yaml')
        arguments = ['--study', 'threshold', '--params-file', str(file)]
        assert main(['sweep', *arguments, '--output', str(tmp_path)]) == 0
        assert f'{tmp_path}/own_plant-{stem}.csv' in capsys.readouterr().out
