"""What a brightness profile costs of the promise."""

from __future__ import annotations

import numpy as np
import pytest

from dvs_common.scenario.brightness_profile import Linearisation
from dvs_common.scenario.scenario import Scenario
from dvs_hinf_controller.analysis.promise import Held, Promise
from dvs_hinf_controller.design import Design, design_from_scenario
from dvs_hinf_controller.operation import Operation
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.sector_means import Sectors

BASE = {
    'pixel_offsets': [0.45, 0.22, 0.46, 0.22, 0.44, 0.22],
    'set_point': [0.0, 0.0],
    'initial_state': [0.03, 0.03],
    'tolerance': 0.05,
}


def scenario(tmp_path, curve: str, **changes: object) -> Scenario:
    path = tmp_path / 'wall.py'
    path.write_text(f'import numpy as np\n\ndef wall(s):\n    return {curve}\n')
    given = {**BASE, 'brightness_profile': f'{path}:wall', 'profile_range': (0.01, 1.01)}
    return Scenario.from_values({**given, 'profile_reach': 0.2, **changes})


@pytest.fixture(scope='module')
def straight() -> Design:
    return design_from_scenario(Scenario.from_values(BASE))


def test_a_straight_profile_costs_nothing_in_any_unit(tmp_path, straight):
    for curve in ('s', '250 * s', '1e-3 * s'):
        scale = eval(curve, {'s': 1.0})
        given = scenario(tmp_path, curve, reference_uncertainty=0.002 * scale)
        found = design_from_scenario(given).figures
        assert found.h_certified == pytest.approx(straight.figures.h_certified, rel=2e-3)
        assert found.costs[-1].threshold == pytest.approx(found.costs[-2].threshold, abs=1e-6)


def test_a_profile_that_falls_is_regulated_as_one_that_rises(tmp_path, straight):
    falling = design_from_scenario(
        scenario(tmp_path, '1.02 - s', pixel_offsets=[0.46, 0.28, 0.47, 0.28, 0.45, 0.28])
    )
    assert falling.problem.model.output_vector == pytest.approx(
        -straight.problem.model.output_vector
    )
    assert falling.figures.h_certified > 0.5 * straight.figures.h_certified


def test_each_percent_of_slope_costs_more_and_is_named(tmp_path, straight):
    found = []
    for bow in (0.1, 0.2, 0.4):
        design = design_from_scenario(scenario(tmp_path, f's + {bow} * (s - 0.5)**2'))
        error = design.problem.operation.linearisation.slope_error
        cost = design.figures.costs[-1]
        assert cost.part == f'brightness profile, slope within {100 * error:.3g} %'
        # Secants from the set-point D have the slopes 1 + bow (2 D - 1 + v).
        assert error == pytest.approx(0.2 * bow, rel=0.1)
        found.append(design.figures.h_certified)
    assert straight.figures.h_certified > found[0] > found[1] > found[2] > 0


def test_no_promise_reaches_beyond_the_stated_range(tmp_path):
    """The bound of the output may not exceed profile_reach, however wide the tolerance is."""
    wide = scenario(tmp_path, 's + 0.1 * (s - 0.5)**2', tolerance=0.4, profile_reach=0.02)
    problem = DesignProblem.from_scenario(wide)
    design = design_from_scenario(wide)
    promise = Promise(problem, design.controller, problem.operation)
    largest = design.figures.delta_certified
    inside = promise.held(Sectors.common(largest * 0.999))
    assert inside.output <= problem.operation.linearisation.luminosity_reach
    assert inside.error < 0.4
    assert promise.held(Sectors.common(largest * 1.01)).error == np.inf


def test_the_output_tolerance_keeps_its_unit(tmp_path):
    problem = DesignProblem.from_scenario(scenario(tmp_path, '10 * s', output_tolerance=0.03))
    assert problem.output_tolerance == pytest.approx(0.3)


def held(design: Design, sector: float, *, period: float = 1e-3, **line: float) -> Held:
    operation = Operation(
        sampling_period=period,
        linearisation=Linearisation(**{'reach': np.inf, **line}),
        interpolates=period > 1e-3,
    )
    promise = Promise(design.problem, design.controller, operation)
    return promise.held(Sectors.common(sector))


def test_the_slope_error_enters_as_the_sector_of_the_deviation_alone(straight):
    """``v = N (delta D + share v)``: N from a straight profile, the share from a curved one."""
    luminosity, sector, error = straight.problem.mean_luminosity, 0.03, 0.1
    plain, curved = (held(straight, sector, slope_error=e).output for e in (0.0, error))
    gain = plain / (sector * (luminosity + plain))
    share = (1 - gain * sector * luminosity / curved) / gain
    assert share == pytest.approx(sector * (1 + error) + error, rel=1e-6)


def test_a_steep_place_in_the_reach_costs_at_long_periods(straight):
    flat, steep = (held(straight, 0.03, period=5e-3, steepness=s).error for s in (1.0, 3.0))
    assert steep > flat * (1 + 1e-4)
    assert held(straight, 0.03, reach=1e-3).error == np.inf


def test_a_positive_luminosity_is_promised_up_to_where_the_steepest_secant_reaches_zero(straight):
    least, error = straight.problem.set_point_luminosity.min(), 0.1
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = (low + high) / 2
        exists = np.isfinite(held(straight, middle, slope_error=error).error)
        low, high = (middle, high) if exists else (low, middle)
    assert (1 + error) * held(straight, low, slope_error=error).output == pytest.approx(
        least, rel=1e-6
    )


@pytest.mark.ensemble
def test_groups_of_pixels_share_a_profile(tmp_path):
    rows = {
        'output_vector': [1.0, 0.0, 0.0, 1.0],
        'bandwidth_limit': 50.0,
        'pixel_grid': [1, 4],
        'pixel_groups': [0, 0, 1, 1],
        'pixel_offsets': [0.5, 0.0, 0.52, 0.0, 0.0, 0.4, 0.0, 0.42],
    }
    straight = design_from_scenario(Scenario.from_values({**BASE, **rows})).figures
    plain = design_from_scenario(scenario(tmp_path, '3 * s', reference_uncertainty=0.006, **rows))
    assert plain.problem.scene.groups.tolist() == [0, 0, 1, 1]
    assert plain.figures.h_certified == pytest.approx(straight.h_certified, rel=2e-3)
    curved = design_from_scenario(scenario(tmp_path, 's + 0.2 * (s - 0.5)**2', **rows)).figures
    assert 0.01 < curved.h_certified < straight.h_certified
