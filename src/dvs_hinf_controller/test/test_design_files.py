"""Designs in files: saved, read for the problem at hand, or refused by name."""

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dvs_common.errors import ParameterError
from dvs_common.scenario.model import PixelScene, PlantModel
from dvs_common.writing import WriteError
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.design.design import (
    design_controller,
    load_design,
    save_design,
)
from dvs_hinf_controller.design.design_report import as_json_object
from dvs_hinf_controller.problem import DesignProblem

Make = Callable[..., DesignProblem]


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


def test_json_knows_no_infinity(paper_problem: Make) -> None:
    design = design_controller(paper_problem(1), method='unstructured')
    endless = dataclasses.replace(
        design, figures=dataclasses.replace(design.figures, h_star=math.inf)
    )
    assert as_json_object(endless)['h_star'] is None
    json.dumps(as_json_object(endless), allow_nan=False)


def test_no_threshold_is_a_number_that_compares_with_others(paper_problem):
    design = design_controller(paper_problem(1, mirror=True))
    none = dataclasses.replace(
        design, figures=dataclasses.replace(design.figures, h_certified=-math.inf)
    )

    found = as_json_object(none)

    assert found['h_certified'] == 0.0
    assert 'h_certified' not in found['unlimited']
