"""Problems that several tests share: the paper's example, its mirror image, random plants."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dvs_common.scenario.model import PixelScene, PlantModel
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_hinf_controller.problem import DesignProblem

# Pixel displacements of the paper, section IV.
OFFSETS = np.array(
    [[0, 0], [1, 0], [-1, 0], [-1, 1], [0, 1], [1, 1], [1, -1], [0, -1], [-1, -1]]
) * np.array([0.01])


@pytest.fixture(scope='session')
def paper_model() -> PlantModel:
    return PlantModel(
        state_matrix=np.array([[2.0, 10.0], [0.0, 5.0]]),
        input_matrix=np.array([[1.0], [1.0]]),
        output_vector=np.array([2.0, 1.0]) / math.sqrt(5),
    )


@pytest.fixture(scope='session')
def paper_problem(paper_model: PlantModel) -> Callable[..., DesignProblem]:
    def make(
        r: int, *, mirror: bool = False, tolerance: float = 0.05, log_base: float = math.e
    ) -> DesignProblem:
        sign = -1.0 if mirror else 1.0
        set_point = sign * np.array([-0.2321, 0.0928])
        start = set_point + 0.25
        scene = PixelScene.from_offsets(paper_model, OFFSETS[:r], height=1, width=r)
        return DesignProblem(
            model=paper_model,
            equilibrium=paper_model.equilibrium(set_point, tolerance=1e-3),
            scene=scene,
            bounds=ReferenceBounds.around(scene.luminosity(paper_model, start), 0.002),
            tolerance=tolerance,
            log_base=log_base,
        )

    return make


@pytest.fixture(scope='session')
def problem_of() -> Callable[[PlantModel], DesignProblem]:
    """One pixel of luminosity 1 at the set-point 0, q(0) known."""

    def make(model: PlantModel) -> DesignProblem:
        one = np.ones(1)
        return DesignProblem(
            model=model,
            equilibrium=model.equilibrium(np.zeros(model.state_count), tolerance=1e-6),
            scene=PixelScene(brightness_offsets=one, height=1, width=1),
            bounds=ReferenceBounds(lower=one, upper=one),
            tolerance=0.05,
            log_base=math.e,
        )

    return make


@pytest.fixture
def params_file(tmp_path: Path) -> Path:
    """File of a scenario with the defaults, and the method that designs fastest."""
    path = tmp_path / 'scenario.yaml'
    path.write_text('/**:\n  ros__parameters:\n    method: unstructured\n')
    return path
