import json
from pathlib import Path

import pytest
import yaml

from dvs_common.scenario.scenario import load_scenario
from dvs_simulation.cli import main
from dvs_simulation.judging.figure import phase_portrait_title

CONFIG = Path(__file__).resolve().parents[3] / 'config'

SCENARIO = """
/**:
  ros__parameters:
    duration: {duration}
    event_threshold: {threshold}
"""


def plain(values):
    return {k: list(v) if isinstance(v, tuple) else v for k, v in values.items() if v != ()}


def params_file(tmp_path, duration=2.0, threshold=0.15):
    path = tmp_path / 'mine.yaml'
    path.write_text(SCENARIO.format(duration=duration, threshold=threshold))
    return str(path)


def simulate(tmp_path, *options, **parameters):
    file = params_file(tmp_path, **parameters)
    code = main(['simulate', '--params-file', file, '--output', str(tmp_path / 'out'), *options])
    kind = 'sampled' if '--sampled' in options else 'exact'
    path = tmp_path / 'out' / f'mine-{kind}' / 'result.json'
    return code, json.loads(path.read_text()) if path.exists() else None


@pytest.mark.ensemble
def test_an_exact_run_writes_result_and_figure(tmp_path, capsys):
    code, result = simulate(tmp_path)
    assert code == 0
    assert result['regulated'] is True
    assert result['outcome'] == 'completed'
    assert result['limsup_error'] < result['tolerance']
    assert 0.5 < result['sector_ratio_max'] <= 1
    assert result['h_certified'] < result['h'] < result['h_star']
    assert (tmp_path / 'out' / 'mine-exact' / 'figure.png').stat().st_size > 20_000
    assert 'regulated' in capsys.readouterr().out


@pytest.mark.ensemble
def test_a_run_that_leaves_its_tolerance_is_reported_as_such(tmp_path, capsys):
    code, result = simulate(tmp_path, '--event-threshold', '0.5', '--duration', '10')
    assert code == 1
    assert result['regulated'] is False
    assert 'NOT regulated' in capsys.readouterr().out


def test_the_sampled_mode_gives_the_verdict_of_the_ros_loop(tmp_path):
    code, result = simulate(tmp_path, '--sampled', duration=1.0)
    assert code == 0
    assert result['cycles'] == 1001
    assert result['regulated'] is True


@pytest.mark.ensemble
def test_a_hot_pixel_leaves_the_mean_the_certificate_and_the_verdict(tmp_path):
    hot = {'hot_pixel_fraction': 0.12, 'hot_pixel_rate': 60.0, 'duration': 6.0, 'seed': 1}
    values = dict(load_scenario(CONFIG / 'real_sensor.yaml').values) | {'mode': 'lockstep'} | hot
    file = tmp_path / 'hot.yaml'
    file.write_text(yaml.safe_dump({'/**': {'ros__parameters': plain(values)}}))

    code = main(['simulate', '--params-file', str(file), '--sampled', '--output', str(tmp_path)])

    result = json.loads((tmp_path / 'hot-sampled' / 'result.json').read_text())
    assert (code, result['pixels_masked']) == (0, 1)
    assert result['sector_ratio_max'] < 1
    assert not result['certified']


@pytest.mark.parametrize('option', ['--duration', '--event-threshold'])
def test_bad_values_are_named(tmp_path, capsys, option):
    code, _ = simulate(tmp_path, option, '-1')
    assert code != 0
    assert option[2:].replace('-', '_') in capsys.readouterr().err


def test_a_plant_of_its_own_is_not_simulated(capsys):
    assert main(['simulate', '--params-file', str(CONFIG / 'pendulum.yaml')]) == 2
    assert 'plant_executable = dvs_plant_sim/pendulum_sim: is not' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('states', 'title'),
    [
        (2, 'Phase portrait'),
        (3, 'Phase portrait (not shown: x3)'),
        (5, 'Phase portrait (not shown: x3 to x5)'),
    ],
)
def test_a_phase_portrait_names_the_states_that_it_does_not_show(states, title):
    assert phase_portrait_title(states) == title


@pytest.mark.ensemble
def test_a_method_of_the_command_line_designs_the_controller(tmp_path):
    _, plain = simulate(tmp_path)
    _, other = simulate(tmp_path, '--method', 'structured')

    assert other['h_certified'] > plain['h_certified'] + 0.003


def exact(tmp_path, name, **values):
    """Result of an exact run of a shipped scenario with other values."""
    scenario = load_scenario(CONFIG / f'{name}.yaml').replace(method='unstructured', **values)
    file = tmp_path / 'mine.yaml'
    file.write_text(yaml.safe_dump({'/**': {'ros__parameters': plain(scenario.values)}}))
    main(['simulate', '--params-file', str(file), '--output', str(tmp_path / 'out')])

    def none(token):
        raise AssertionError(token)

    text = (tmp_path / 'out' / 'mine-exact' / 'result.json').read_text()
    return json.loads(text, parse_constant=none)


@pytest.mark.ensemble
@pytest.mark.parametrize(
    ('values', 'promised'),
    [
        ({'event_threshold': 0.0838}, True),
        ({'event_threshold': 0.0840}, False),
        ({'event_threshold': 0.0838, 'constant_load': [1e-4]}, False),
        ({'event_threshold': 0.0838, 'output_disturbance': 1e-4}, False),
    ],
)
def test_an_exact_run_is_promised_within_both_certificates_where_nothing_acts(
    tmp_path, values, promised
):
    assert exact(tmp_path, 'textbook/heading', duration=1.0, **values)['certified'] is promised


@pytest.mark.ensemble
def test_a_run_that_ends_at_a_luminosity_that_is_not_positive_has_broken_off(tmp_path, capsys):
    result = exact(tmp_path, 'textbook/ball_and_beam', duration=8.0, event_threshold=0.9)

    assert result['outcome'] == 'zeno' and result['limsup_error'] is None
    assert 'mine: NOT regulated: broken off' in capsys.readouterr().out


@pytest.mark.ensemble
def test_what_any_threshold_holds_is_null(tmp_path):
    stable = {'state_matrix': [-1.0, 1.0, 0.0, -2.0], 'settling_time': 0.0, 'duration': 0.5}
    result = exact(tmp_path, 'textbook/flexible_mode', **stable)

    assert result['h_star'] is result['h_certified'] is None
    assert result['certified'] is True
