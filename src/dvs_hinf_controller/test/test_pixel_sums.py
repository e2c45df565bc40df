"""Sums over many pixels, taken once, agree with a look at each of them."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dvs_common.scenario.model import PixelScene
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_common.scenario.scenario import load_scenario
from dvs_hinf_controller.design.design import measure
from dvs_hinf_controller.many_pixels import ManyPixels
from dvs_hinf_controller.pixel_sums import FewPixels
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.sector_means import Sectors, SeenPixels
from dvs_hinf_controller.synthesis.methods import METHODS
from dvs_hinf_controller.synthesis.options import DesignOptions

ROOT = Path(__file__).resolve().parents[3]
ONE = DesignProblem.from_scenario(load_scenario(ROOT / 'config' / 'mirror_r1.yaml'))


def of_pixels(seed, count, *, spread):
    """Problem with pixels whose references are known to between 0.1 % and a factor e^spread."""
    generator = np.random.default_rng(seed)
    scene = PixelScene(
        brightness_offsets=generator.uniform(-0.1, 0.4, count), height=1, width=count
    )
    light = scene.luminosity(ONE.model, ONE.equilibrium.state)
    widths = 10 ** generator.uniform(-3, math.log10(spread), count)
    bounds = ReferenceBounds(lower=light * np.exp(-widths), upper=light * np.exp(widths))
    return replace(ONE, scene=scene, bounds=bounds)


def both(problem):
    seen = SeenPixels(
        scene=problem.scene,
        model=problem.model,
        state=problem.equilibrium.state,
        bounds=problem.bounds,
    )
    return FewPixels(seen), ManyPixels(seen)


@given(
    seed=st.integers(0, 2**31),
    count=st.integers(1, 400),
    spread=st.sampled_from([2e-3, 0.05, 0.4, 3.0]),
    level=st.floats(0.0, 18.0),
)
@settings(max_examples=60, deadline=None)
def test_sums_taken_once_give_the_means_of_all_sectors(seed, count, spread, level):
    few, many = both(of_pixels(seed, count, spread=spread))
    for name in ('rms', 'mean', 'worst_ratio', 'widest', 'least', 'group_means'):
        assert getattr(many, name) == pytest.approx(getattr(few, name), rel=1e-12), name
    for sectors in (Sectors(level=level), Sectors(level=level, own_widths=False)):
        means = [
            sums.sector_means(sectors, slope_error=0.02, unknown=0.01) for sums in (few, many)
        ]
        assert means[1].share == pytest.approx(means[0].share, rel=1e-12)
        assert means[1].constant == pytest.approx(means[0].constant, rel=1e-12)
        assert means[1].largest == pytest.approx(means[0].largest, rel=1e-12)


@given(seed=st.integers(0, 2**31), level=st.floats(-3.0, 0.0), near=st.floats(0.0, 0.99))
@settings(max_examples=40, deadline=None)
def test_where_sums_do_not_reach_they_bound_the_means_from_above(seed, level, near):
    few, many = both(of_pixels(seed, 200, spread=1.0))
    means = [sums.sector_means(Sectors(level=level)) for sums in (few, many)]
    assert np.all(means[1].share >= means[0].share * (1 - 1e-12))
    assert np.all(means[1].constant >= means[0].constant * (1 - 1e-12))
    bends = [sums.bend(np.array([0.3]), near * few.least, 0.01) for sums in (few, many)]
    assert np.all(bends[1] >= bends[0] * (1 - 1e-12))
    assert bends[1] <= bends[0] * 1.01 or near > 0.5


def test_a_design_for_many_pixels_has_the_figures_of_a_look_at_each(monkeypatch):
    problem = of_pixels(3, 5000, spread=0.05)
    controller = METHODS['structured'].synthesize(problem, DesignOptions())
    many = measure(problem, controller)
    monkeypatch.setattr('dvs_hinf_controller.pixel_sums._FEW', 5000)
    few = measure(replace(problem), controller)
    assert isinstance(problem.pixels, ManyPixels)
    for name in ('h_star', 'h_certified', 'h_certified_continuous', 'delta_certified'):
        assert getattr(many, name) == pytest.approx(getattr(few, name), rel=1e-5), name
    assert many.h_certified <= few.h_certified * (1 + 1e-9)


def test_pixel_groups_have_sums_of_their_own():
    problem = of_pixels(4, 300, spread=0.05)
    groups = np.arange(300) % 2
    model = replace(ONE.model, output_vector=np.vstack([ONE.model.gradient, [0.5, 0.6]]))
    problem = replace(problem, model=model, scene=replace(problem.scene, groups=groups))
    few, many = both(problem)
    means = [sums.sector_means(Sectors(level=0.1)) for sums in (few, many)]
    assert means[1].constant == pytest.approx(means[0].constant, rel=1e-12)
    assert many.least == pytest.approx(few.least)
    assert many.least.size == 2
