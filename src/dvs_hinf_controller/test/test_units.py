"""No method depends on the units in which a plant is written down."""

import dataclasses

import numpy as np
import pytest

from dvs_common.scenario.model import PixelScene, PlantModel
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_hinf_controller.analysis.plant_rates import control_rate, plant_rate
from dvs_hinf_controller.design import design_controller
from dvs_hinf_controller.operation import Operation
from dvs_hinf_controller.problem import DesignProblem


def model(a, b, c) -> PlantModel:
    return PlantModel(
        state_matrix=np.array(a, dtype=float),
        input_matrix=np.array(b, dtype=float),
        output_vector=np.array(c, dtype=float),
    )


def converted(
    problem: DesignProblem, *, luminosity=1.0, state=1.0, rate=1.0, command=1.0
) -> DesignProblem:
    """The same problem, written down in other units."""
    plant, held, bounds = problem.model, problem.equilibrium, problem.bounds
    return dataclasses.replace(
        problem,
        model=PlantModel(
            state_matrix=plant.state_matrix * rate,
            input_matrix=plant.input_matrix * rate * state / command,
            output_vector=plant.output_vector * luminosity / state,
        ),
        equilibrium=dataclasses.replace(
            held, state=held.state * state, feedforward=held.feedforward * command
        ),
        scene=PixelScene(
            brightness_offsets=problem.scene.brightness_offsets * luminosity,
            height=problem.scene.height,
            width=problem.scene.width,
        ),
        bounds=ReferenceBounds(lower=bounds.lower * luminosity, upper=bounds.upper * luminosity),
        tolerance=problem.tolerance * state,
    )


@pytest.mark.ensemble
@pytest.mark.parametrize('method', ['unstructured', 'certified'])
@pytest.mark.parametrize(
    'units',
    [
        {'luminosity': 255.0, 'state': 1e-6},
        {'luminosity': 1e-9, 'command': 1e6},
        {'state': 1e6, 'rate': 1e5},
    ],
    ids=str,
)
def test_thresholds_do_not_depend_on_units(paper_problem, method, units) -> None:
    problem = paper_problem(1, mirror=True)
    plain = design_controller(problem, method=method).figures
    other = design_controller(converted(problem, **units), method=method).figures

    assert other.h_certified == pytest.approx(plain.h_certified, rel=0.01)
    assert other.h_star == pytest.approx(plain.h_star, rel=0.02)


def written_anew(problem: DesignProblem, generator) -> DesignProblem:
    """The same problem with units of its own for every state and input, for time and for light."""
    plant, bounds, operation = problem.model, problem.bounds, problem.operation
    states = 10 ** generator.uniform(-6, 6, plant.state_count)
    inputs = 10 ** generator.uniform(-6, 6, plant.input_count)
    rate, luminosity = 10 ** generator.uniform(-6, 6, 2)
    return dataclasses.replace(
        problem,
        model=PlantModel(
            state_matrix=states[:, None] * plant.state_matrix / states * rate,
            input_matrix=states[:, None] * plant.input_matrix / inputs * rate,
            output_vector=plant.output_vector / states * luminosity,
        ),
        scene=dataclasses.replace(
            problem.scene, brightness_offsets=problem.scene.brightness_offsets * luminosity
        ),
        bounds=ReferenceBounds(lower=bounds.lower * luminosity, upper=bounds.upper * luminosity),
        error_weights=1 / states,
        operation=dataclasses.replace(operation, sampling_period=operation.sampling_period / rate),
    )


# A slow stable plant, which needs no feedback and bears any threshold, and one with two inputs.
@pytest.mark.ensemble
@pytest.mark.parametrize('seed', [0, 1])
def test_certified_does_not_depend_on_the_unit_of_any_state_input_time_or_light(
    problem_of, seed
) -> None:
    generator = np.random.default_rng(seed)
    n, m = generator.integers(1, 3, 2).tolist()
    plant = model(
        generator.standard_normal((n, n)),
        generator.standard_normal((n, m)),
        generator.standard_normal(n),
    )
    problem = dataclasses.replace(
        problem_of(plant),
        error_weights=np.ones(n),
        operation=Operation(sampling_period=1e-3),
    )
    plain = design_controller(problem, method='certified').figures
    other = design_controller(written_anew(problem, generator), method='certified').figures

    assert plain.h_certified > 0
    assert other.h_certified == pytest.approx(plain.h_certified, rel=0.02)


def test_the_rate_of_a_plant_does_not_depend_on_the_units_of_its_states() -> None:
    plain = model([[-0.1, 0.6], [0.1, -0.5]], [[1.0], [1.0]], [1.0, 1.0])
    units = np.array([1e-8, 1e4])
    a = units[:, None] * plain.state_matrix / units
    other = model(a, plain.input_matrix, plain.output_vector)

    assert plant_rate(other) == pytest.approx(plant_rate(plain), rel=1e-6)


@pytest.mark.parametrize('state', [1e-6, 1e6])
def test_structured_designs_exist_in_any_units(paper_problem, state) -> None:
    """Mu weighs luminosity against states, so that its optimum does depend on their units."""
    figures = design_controller(converted(paper_problem(1), state=state)).figures

    assert figures.h_certified > 0.04


def test_the_rate_of_a_plant() -> None:
    assert plant_rate(model([[0.0]], [[1.0]], [1.0])) == 1
    assert plant_rate(model([[0.0, 7.0], [0.0, 0.0]], [[0.0], [1.0]], [1.0, 0.0])) == 7


def test_a_fast_stable_mode_does_not_set_the_pace_of_control() -> None:
    fast = model([[1.0, 0.0], [0.0, -1000.0]], [[1.0], [1.0]], [1.0, 0.0])

    assert plant_rate(fast) == 1000
    assert control_rate(fast) == 1
    assert control_rate(model([[-2.0, 0.0], [0.0, -9.0]], [[1.0], [1.0]], [1.0, 1.0])) == 2


def test_a_fast_stable_mode_does_not_raise_the_norm(problem_of) -> None:
    """Appended to the plant and hardly excited, it leaves the least norm where it was."""
    slow = model([[1.0]], [[1.0]], [1.0])
    fast = model([[1.0, 0.0], [0.0, -1000.0]], [[1.0], [1e-3]], [1.0, 0.0])
    plain, extended = (
        design_controller(problem_of(plant), method='unstructured').figures.gamma
        for plant in (slow, fast)
    )

    assert extended == pytest.approx(plain, rel=0.02)


@pytest.mark.parametrize(
    ('a', 'b', 'c'),
    [
        ([[0.0]], [[1.0]], [1.0]),
        ([[0, 1, 0], [0, 0, 1], [0, 0, 0]], [[0], [0], [1]], [1, 0, 0]),
        ([[0, 31.416], [-31.416, -0.31416]], [[0], [1]], [1, 0]),
    ],
    ids=['xdot = u', 'three integrators', 'a flexible mode'],
)
def test_certified_is_never_worse_than_another_method(problem_of, a, b, c) -> None:
    problem = problem_of(model(a, b, c))
    thresholds = {
        method: design_controller(problem, method=method).figures.h_certified
        for method in ('unstructured', 'structured', 'certified')
    }

    assert thresholds['certified'] >= 0.999 * max(thresholds.values()) > 0


@pytest.mark.ensemble
def test_a_plant_of_many_states_has_a_certified_design(problem_of) -> None:
    """Ten states that pull at each other, two inputs, one pixel."""
    generator = np.random.default_rng(5)
    a = generator.normal(size=(10, 10)) / np.sqrt(10)
    problem = problem_of(model(a, generator.normal(size=(10, 2)), generator.normal(size=10)))
    thresholds = {
        method: design_controller(problem, method=method).figures.h_certified
        for method in ('unstructured', 'structured', 'certified')
    }

    assert np.linalg.eigvals(a).real.max() > 0.4
    assert thresholds['certified'] >= max(thresholds.values()) > 0


@pytest.mark.ensemble
@pytest.mark.parametrize('method', ['unstructured', 'structured', 'certified'])
def test_a_state_may_have_any_unit_where_the_error_weighs_it(paper_problem, method) -> None:
    """W = 1/unit of each state: the same question, though A and B spread over twelve decades."""
    plain = paper_problem(1, mirror=True)
    units = np.array([1e-6, 1e6])
    other = dataclasses.replace(
        plain,
        model=model(
            plain.model.state_matrix * units[:, None] / units,
            plain.model.input_matrix * units[:, None],
            plain.model.output_vector / units,
        ),
        equilibrium=dataclasses.replace(plain.equilibrium, state=plain.equilibrium.state * units),
        error_weights=1 / units,
    )
    found, wanted = (
        design_controller(problem, method=method).figures for problem in (other, plain)
    )

    assert found.h_certified == pytest.approx(wanted.h_certified, rel=5e-3)
