"""The command design_controller: output, comparison, warnings and errors."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dvs_common.scenario.scenario import Scenario
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.design.design import design_controller, design_from_scenario
from dvs_hinf_controller.design.design_report import report_text
from dvs_hinf_controller.design.design_tool import main, with_pixels
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.synthesis.methods import METHODS
from dvs_hinf_controller.synthesis.options import DesignOptions
from dvs_hinf_controller.synthesis.synthesis_error import Assumption, SynthesisError

Make = Callable[..., DesignProblem]
JSON_KEYS = [
    'method',
    'pixels',
    'gamma',
    'mu_upper',
    'mu_lower',
    'dc_gain_w1',
    'dc_gain_w2',
    'hinf_gain_w1',
    'delta_star',
    'h_star',
    'small_gain_ok',
    'delta_certified',
    'h_certified',
    'controller_order',
    'fastest_pole',
    'closed_loop_abscissa',
    'max_sampling_period',
    'seconds',
]


def test_json_has_the_keys(params_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['--params-file', str(params_file), '--json']) == 0
    figures = json.loads(capsys.readouterr().out)
    assert set(JSON_KEYS) <= set(figures)
    assert figures['method'] == 'unstructured'
    assert figures['pixels'] == 3
    assert figures['small_gain_ok'] is True


def test_saved_design_runs_as_a_method(params_file: Path, tmp_path: Path) -> None:
    output, figure = tmp_path / 'design.json', tmp_path / 'bode.png'
    arguments = ['--params-file', str(params_file), '--method', 'structured']
    assert main([*arguments, '--output', str(output), '--figure', str(figure)]) == 0
    assert figure.read_bytes().startswith(b'\x89PNG')
    scenario = Scenario.from_values({'method': 'file', 'design_file': str(output)})
    assert design_from_scenario(scenario).method == 'structured'


def test_a_design_in_a_folder_is_called_after_its_scenario(
    params_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ['--params-file', str(params_file), '--method', 'structured']
    assert main([*arguments, '--output', str(tmp_path / 'new')]) == 0
    assert (tmp_path / 'new' / f'{params_file.stem}-structured.json').is_file()
    (tmp_path / 'file').write_text('')
    assert main([*arguments, '--output', str(tmp_path / 'file' / 'folder')]) == 2
    assert "can't be made: Not a directory" in capsys.readouterr().err


@pytest.mark.ensemble
def test_a_comparison_shows_what_works_and_why_the_rest_does_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Fails:
        name = 'fails'

        def synthesize(self, problem: DesignProblem, options: DesignOptions) -> LinearController:
            raise SynthesisError(Assumption.CONFIRMATION, 'no observer gain was found')

    monkeypatch.setitem(METHODS, 'fails', Fails())
    first_order = tmp_path / 'first_order.yaml'
    first_order.write_text(
        '/**: {ros__parameters: {state_matrix: [1.0], input_matrix: [1.0], output_vector: [1.0],'
        ' pixel_offsets: [1.0], pixel_grid: [1, 1], initial_state: [0.1], set_point: [0.0]}}\n'
    )

    assert main(['--params-file', str(first_order), '--compare', '--json']) == 0

    given = capsys.readouterr()
    assert {design['method'] for design in json.loads(given.out)} >= {'unstructured', 'certified'}
    assert 'fails: ' in given.err
    assert 'no observer gain was found' in given.err


def test_a_comparison_saves_no_design(params_file: Path, tmp_path: Path) -> None:
    output = tmp_path / 'design.json'
    with pytest.raises(SystemExit) as ended:
        main(['--params-file', str(params_file), '--compare', '--output', str(output)])
    assert ended.value.code == 2
    assert not output.exists()


def test_report_names_figures_and_verdicts(paper_problem: Make) -> None:
    design = design_controller(paper_problem(3), method='unstructured')
    text = report_text([design, design], event_threshold=0.15)
    assert 'r = 3' in text
    for words in ('h* (published)', 'h certified (guaranteed)', 'mu, upper bound', '1.959'):
        assert words in text
    verdicts = {line.split('  ')[0]: line.split()[-2:] for line in text.splitlines() if line}
    assert verdicts['h <= h*'] == ['yes', 'yes']
    assert verdicts['h <= h certified'] == ['NO', 'NO']


def test_tool_warns_of_a_period_that_is_too_long(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'slow.yaml'
    path.write_text('/**:\n  ros__parameters:\n    sampling_period: 0.1\n')
    assert main(['--params-file', str(path)]) == 0
    assert 'at sampling_period = 0.1 s the loop is unstable' in capsys.readouterr().err


def test_the_tool_prints_what_is_wrong(
    params_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['--params-file', str(tmp_path / 'absent.yaml')]) == 2
    assert 'cannot be read' in capsys.readouterr().err
    assert main(['--params-file', str(params_file), '--pixels', '3']) == 2
    assert 'must be HEIGHTxWIDTH' in capsys.readouterr().err
    bad = tmp_path / 'bad.yaml'
    bad.write_text('/**:\n  ros__parameters:\n    gamma_slack: 0.0\n')
    assert main(['--params-file', str(bad)]) == 2
    assert 'gamma_slack' in capsys.readouterr().err


def test_pixel_grid_replaces_the_scenarios_pixels() -> None:
    scenario = Scenario.from_values({})
    grid = with_pixels(scenario, '4x5')
    scene = grid.scene
    assert (scene.height, scene.width) == (4, 5)
    own = scenario.scene.brightness_offsets
    assert np.abs(scene.brightness_offsets).max() == pytest.approx(
        np.abs(own).max() * 1.5, rel=1e-6
    )
    pitched = scenario.replace(
        pixel_offsets=(), pixel_pitch=(1e-3, 0.0, 0.0, 1e-3), pixel_grid=(2, 2)
    )
    assert with_pixels(pitched, '3x3')['pixel_pitch'] == (1e-3, 0.0, 0.0, 1e-3)


@pytest.mark.parametrize(
    ('values', 'message', 'code'),
    [
        ({'method': 'file'}, 'design_file = : must be given with method: file', 2),
        ({'state_matrix': [-1.0], 'input_matrix': [0.0]}, 'does every input act', 1),
    ],
)
def test_what_can_not_be_designed_is_one_line(
    values: dict[str, Any], message: str, code: int, tmp_path: Path, capsys: Any
) -> None:
    plain = {
        'state_matrix': [1.5],
        'input_matrix': [1.0],
        'output_vector': [1.0],
        'pixel_offsets': [1.0],
        'pixel_grid': [1, 1],
        'initial_state': [0.3],
        'set_point': [0.0],
        'tolerance': 0.1,
    }
    file = tmp_path / 'scenario.yaml'
    file.write_text(json.dumps({'/**': {'ros__parameters': {**plain, **values}}}))

    assert main(['--params-file', str(file)]) == code

    error = capsys.readouterr().err
    assert message in error
    assert error.count('\n') == 1


def test_a_figure_is_no_folder(params_file: Path, tmp_path: Path, capsys: Any) -> None:
    assert main(['--params-file', str(params_file), '--figure', str(tmp_path)]) == 1
    assert f'{tmp_path}: cannot be written: is a folder' in capsys.readouterr().err


def test_a_trade_for_a_plant_without_controller_names_what_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out_of_reach = {
        'state_matrix': [1.0, 0.0, 0.0, 2.0],
        'input_matrix': [1.0, 0.0],
        'set_point': [0.0, 0.0],
    }
    file = tmp_path / 'scenario.yaml'
    file.write_text(json.dumps({'/**': {'ros__parameters': out_of_reach}}))

    assert main(['--params-file', str(file), '--pareto', str(tmp_path / 'trade.csv')]) == 2

    printed = capsys.readouterr()
    assert 'leaves the unstable mode s = 2' in printed.err
    assert printed.out == ''
    assert not (tmp_path / 'trade.csv').exists()
