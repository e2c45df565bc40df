import dataclasses
import json
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dvs_common.errors import ParameterError
from dvs_common.scenario.model import PixelScene, PlantModel
from dvs_common.scenario.scenario import Scenario
from dvs_common.writing import WriteError
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.design.design import (
    as_json_object,
    design_controller,
    design_from_scenario,
    load_design,
    measure,
    save_design,
)
from dvs_hinf_controller.design.design_report import report_text
from dvs_hinf_controller.design.design_tool import main, with_pixels
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.state_space import state_response
from dvs_hinf_controller.synthesis.methods import ENTRY_POINTS, METHODS
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


def test_unstructured_meets_the_paper(paper_problem: Make) -> None:
    """Must hold 1, default settings."""
    figures = design_controller(paper_problem(3), method='unstructured').figures
    assert figures.gamma == pytest.approx(1.9567, rel=2e-3)
    assert figures.h_star == pytest.approx(0.15622, rel=5e-3)
    assert figures.h_star == pytest.approx(0.1562, rel=1e-2)
    assert figures.small_gain_ok
    assert figures.max_sampling_period > 4e-3


@pytest.mark.parametrize(
    ('r', 'optimum', 'printed'), [(1, 0.15101, 0.1511), (3, 0.15023, 0.1510), (9, 0.14984, 0.1508)]
)
def test_structured_meets_the_paper(
    paper_problem: Make, r: int, optimum: float, printed: float
) -> None:
    """Must hold 1, default settings."""
    figures = design_controller(paper_problem(r), method='structured').figures
    assert figures.mu_upper == pytest.approx(2.3860, rel=5e-3)
    assert 0.98 * figures.mu_upper <= figures.mu_lower <= figures.mu_upper
    assert figures.h_star == pytest.approx(optimum, rel=5e-3)
    assert figures.h_star == pytest.approx(printed, rel=1e-2)


def test_pixels_change_thresholds_and_not_the_controller(paper_problem: Make) -> None:
    one, nine = (
        design_controller(paper_problem(r), method='unstructured').controller for r in (1, 9)
    )
    np.testing.assert_array_equal(one.state_matrix, nine.state_matrix)


def test_figures_of_a_static_gain_are_closed_forms(
    problem_of: Callable[[PlantModel], DesignProblem],
) -> None:
    # x' = x + u, u = -4 (x + w): G = T = -4 / (s + 3).
    model = PlantModel(
        state_matrix=np.ones((1, 1)), input_matrix=np.ones((1, 1)), output_vector=np.ones(1)
    )
    k = LinearController(
        state_matrix=np.zeros((0, 0)),
        input_vector=np.zeros(0),
        output_matrix=np.zeros((1, 0)),
        feedthrough=np.array([-4.0]),
    )
    figures = measure(problem_of(model), k)
    assert figures.gamma == pytest.approx(math.sqrt(2) * 4 / 3, rel=1e-6)
    assert figures.mu_upper == pytest.approx(8 / 3, rel=1e-3)
    assert figures.dc_gain_w1 == figures.dc_gain_w2 == pytest.approx(4 / 3)
    assert figures.delta_star == pytest.approx(0.05 / (4 / 3 * 1.05))
    assert figures.delta_certified == pytest.approx(figures.delta_star, rel=5e-4)
    assert figures.delta_certified <= figures.delta_star
    assert figures.closed_loop_abscissa == pytest.approx(-3)
    assert figures.controller_order == 0
    assert figures.fastest_pole == 0


def test_destabilizing_controller_has_no_figures(paper_problem: Make) -> None:
    k = LinearController(
        state_matrix=np.zeros((0, 0)),
        input_vector=np.zeros(0),
        output_matrix=np.zeros((1, 0)),
        feedthrough=np.zeros(1),
    )
    with pytest.raises(SynthesisError, match='closed-loop pole has real part 5'):
        measure(paper_problem(1), k)


@pytest.mark.parametrize('method', METHODS)
def test_unstabilizable_plant_is_named_by_every_method(method: str, problem_of: Callable) -> None:
    model = PlantModel(
        state_matrix=np.diag([1.0, -1.0]),
        input_matrix=np.array([[0.0], [1.0]]),
        output_vector=np.ones(2),
    )
    with pytest.raises(SynthesisError, match='stabilizability'):
        design_controller(problem_of(model), method=method)
    dual = PlantModel(
        state_matrix=np.diag([1.0, -1.0]),
        input_matrix=np.ones((2, 1)),
        output_vector=np.array([0.0, 1.0]),
    )
    with pytest.raises(SynthesisError, match='detectability'):
        design_controller(problem_of(dual), method=method)


def test_unknown_method_lists_the_known(paper_problem: Make) -> None:
    with pytest.raises(ParameterError, match='unstructured, structured, certified'):
        design_controller(paper_problem(1), method='lqg')


def test_users_method_is_registered(paper_problem: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    class Mine:
        name = 'mine'

        def synthesize(self, problem: DesignProblem, options: DesignOptions) -> LinearController:
            return METHODS['unstructured'].synthesize(problem, options)

    monkeypatch.setitem(METHODS, 'mine', Mine())
    assert design_controller(paper_problem(1), method='mine').figures.gamma < 1.97


@pytest.fixture
def register(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str, str], None]:
    """Return what installs a package of one module that registers the method `mine`."""

    def install(source: str, loads: str = 'my_method:Mine') -> None:
        (tmp_path / 'my_method.py').write_text(source)
        monkeypatch.delitem(sys.modules, 'my_method', raising=False)
        info = tmp_path / 'my_method-1.0.dist-info'
        info.mkdir()
        (info / 'METADATA').write_text('Metadata-Version: 2.1\nName: my_method\nVersion: 1.0\n')
        (info / 'entry_points.txt').write_text(f'[{ENTRY_POINTS}]\nmine = {loads}\n')
        monkeypatch.syspath_prepend(tmp_path)

    return install


OWN_METHOD = """
from dvs_hinf_controller.synthesis.methods import METHODS

class Mine:
    name = 'mine'
    synthesize = METHODS['unstructured'].synthesize
"""


def test_a_method_that_an_installed_package_registers_designs_like_any_other(
    register: Callable[..., None], params_file: Path, capsys: Any
) -> None:
    register(OWN_METHOD)

    assert main(['--params-file', str(params_file), '--method', 'mine', '--json']) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures['method'] == 'mine'
    assert figures['gamma'] == pytest.approx(1.9567, rel=2e-3)
    assert main(['--params-file', str(params_file), '--method', 'yours']) == 2
    assert (
        'method = yours: must be one of unstructured, structured, certified, mine, file'
        in capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ('source', 'loads', 'reason'),
    [
        ('import no_such_module', 'my_method:Mine', "No module named 'no_such_module'"),
        ('', 'my_method:Mine', "has no attribute 'Mine'"),
        ('Mine = 3', 'my_method:Mine', 'has no synthesize'),
    ],
)
def test_a_registered_method_that_is_none_is_refused_by_name(
    register: Callable[..., None], paper_problem: Make, source: str, loads: str, reason: str
) -> None:
    register(source, loads)

    with pytest.raises(ParameterError, match=f'method = mine: .* {loads}.*{reason}'):
        design_controller(paper_problem(1), method='mine')


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('gamma_slack', 0.0),
        ('gamma_slack', math.nan),
        ('bandwidth_limit', -1.0),
        ('bandwidth_limit', math.inf),
        ('process_noise', 0.0),
    ],
)
def test_options_name_what_is_wrong(name: str, value: float) -> None:
    with pytest.raises(ParameterError, match=name):
        DesignOptions(**{name: value})


@pytest.mark.parametrize('method', ['unstructured', 'structured'])
def test_bandwidth_limit_caps_the_control_effort(paper_problem: Make, method: str) -> None:
    """The cost on u keeps ``sup |u/w|`` below about ``||G|| bandwidth / ||B||``."""
    free = design_controller(paper_problem(1), method=method)
    slow = design_controller(
        paper_problem(1), method=method, options=DesignOptions(bandwidth_limit=20.0)
    )
    w = np.geomspace(0.1, 1e5, 400)
    efforts = []
    for design in (free, slow):
        model = design.problem.model
        t = state_response(model, design.controller).response(w)[:, :, 0] @ model.output_vector
        efforts.append(np.abs(design.controller.response(w)[:, 0] * (1 + t)).max())
    assert efforts[1] <= slow.figures.mu_upper * 20.0 / math.sqrt(2)
    assert efforts[1] < 0.85 * efforts[0]
    assert slow.figures.gamma > free.figures.gamma
    assert slow.figures.closed_loop_abscissa < 0


# Design files


def test_design_file_keeps_every_digit(paper_problem: Make, tmp_path: Path) -> None:
    design = design_controller(paper_problem(3), method='unstructured')
    path = tmp_path / 'design.json'
    save_design(design, path)
    loaded = load_design(path, paper_problem(3))
    for field in dataclasses.fields(LinearController):
        np.testing.assert_array_equal(
            getattr(loaded.controller, field.name), getattr(design.controller, field.name)
        )
    assert loaded.method == 'unstructured'
    assert loaded.figures == design.figures


def test_loaded_figures_are_those_of_the_problem_at_hand(
    paper_problem: Make, tmp_path: Path
) -> None:
    path = tmp_path / 'design.json'
    save_design(design_controller(paper_problem(3), method='unstructured'), path)
    finer = load_design(path, paper_problem(3, tolerance=0.025))
    assert finer.figures.h_star < 0.1


def test_static_controller_survives_the_file(problem_of: Callable, tmp_path: Path) -> None:
    model = PlantModel(
        state_matrix=np.ones((1, 1)), input_matrix=np.ones((1, 1)), output_vector=np.ones(1)
    )
    design = design_controller(problem_of(model), method='unstructured')
    static = LinearController(
        state_matrix=np.zeros((0, 0)),
        input_vector=np.zeros(0),
        output_matrix=np.zeros((1, 0)),
        feedthrough=np.array([-4.0]),
    )
    path = tmp_path / 'design.json'
    save_design(dataclasses.replace(design, controller=static), path)
    assert load_design(path, problem_of(model)).controller.order == 0


def test_design_for_another_problem_is_refused_by_name(
    paper_problem: Make, tmp_path: Path
) -> None:
    path = tmp_path / 'design.json'
    save_design(design_controller(paper_problem(3), method='unstructured'), path)
    problem = paper_problem(3)
    plant = dataclasses.replace(problem.model, state_matrix=np.diag([2.0, 5.0]))
    with pytest.raises(ParameterError, match=r'another plant \(state_matrix differs\)'):
        load_design(path, dataclasses.replace(problem, model=plant))
    with pytest.raises(ParameterError, match='another set-point'):
        load_design(path, paper_problem(3, mirror=True))
    with pytest.raises(ParameterError, match=r'another pixel set \(width differs\)'):
        load_design(path, paper_problem(1))
    swapped = PixelScene(
        brightness_offsets=problem.scene.brightness_offsets[::-1], height=1, width=3
    )
    with pytest.raises(ParameterError, match=r'another pixel set \(fingerprint differs\)'):
        load_design(path, dataclasses.replace(problem, scene=swapped))


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('', 'is not JSON'),
        ('[]', 'schema_version None'),
        ('{"schema_version": 2}', 'schema_version 2, must be 1'),
        ('{"schema_version": 1}', 'is no design'),
    ],
)
def test_broken_design_files_are_named(
    paper_problem: Make, tmp_path: Path, text: str, message: str
) -> None:
    path = tmp_path / 'design.json'
    path.write_text(text)
    with pytest.raises(ParameterError, match=message):
        load_design(path, paper_problem(1))
    with pytest.raises(ParameterError, match='cannot be read'):
        load_design(tmp_path / 'absent.json', paper_problem(1))
    with pytest.raises(WriteError, match='cannot be written'):
        save_design(
            design_controller(paper_problem(1), method='unstructured'), tmp_path / 'no' / 'd.json'
        )


# The tool


@pytest.fixture
def params_file(tmp_path: Path) -> Path:
    path = tmp_path / 'scenario.yaml'
    path.write_text('/**:\n  ros__parameters:\n    method: unstructured\n')
    return path


def test_json_has_the_keys(params_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['--params-file', str(params_file), '--json']) == 0
    figures = json.loads(capsys.readouterr().out)
    assert set(JSON_KEYS) <= set(figures)
    assert figures['method'] == 'unstructured'
    assert figures['pixels'] == 3
    assert figures['small_gain_ok'] is True


def test_json_knows_no_infinity(paper_problem: Make) -> None:
    design = design_controller(paper_problem(1), method='unstructured')
    endless = dataclasses.replace(
        design, figures=dataclasses.replace(design.figures, h_star=math.inf)
    )
    assert as_json_object(endless)['h_star'] is None
    json.dumps(as_json_object(endless), allow_nan=False)


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


def test_a_comparison_shows_what_works_and_why_the_rest_does_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Fails:
        name = 'fails'

        def synthesize(self, problem: DesignProblem, options: DesignOptions) -> LinearController:
            raise SynthesisError(Assumption.CONFIRMATION, 'the moon is in the wrong quarter')

    monkeypatch.setitem(METHODS, 'fails', Fails())
    first_order = tmp_path / 'first_order.yaml'
    first_order.write_text(
        '/**: {ros__parameters: {state_matrix: [1.0], input_matrix: [1.0], output_vector: [1.0],'
        ' pixel_offsets: [1.0], pixel_grid: [1, 1], initial_state: [0.1], set_point: [0.0]}}\n'
    )

    assert main(['--params-file', str(first_order), '--compare', '--json']) == 0

    told = capsys.readouterr()
    assert {design['method'] for design in json.loads(told.out)} >= {'unstructured', 'certified'}
    assert 'fails: ' in told.err
    assert 'the moon is in the wrong quarter' in told.err


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


def test_tool_says_what_is_wrong(
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


def test_a_megapixel_changes_no_norm() -> None:
    scenario = Scenario.from_values({'method': 'unstructured'})
    many = design_from_scenario(with_pixels(scenario, '720x1280')).figures
    few = design_from_scenario(scenario).figures
    assert many.pixels == 921600
    assert many.gamma == pytest.approx(few.gamma)


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


def test_no_threshold_is_a_number_that_compares_with_others(paper_problem):
    design = design_controller(paper_problem(1, mirror=True))
    none = dataclasses.replace(
        design, figures=dataclasses.replace(design.figures, h_certified=-math.inf)
    )

    found = as_json_object(none)

    assert found['h_certified'] == 0.0
    assert 'h_certified' not in found['unlimited']
