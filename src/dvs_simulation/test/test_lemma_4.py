"""The sector bound at every instant of random loops: the best invariant that there is."""

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from dvs_common.scenario.model import PixelScene, PlantModel
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_simulation.exact import ClosedLoop, simulate
from dvs_simulation.exact.signals import counts_at, luminosities, sector_ratios
from dvs_simulation.sweep.random_loops import lqg_controller


def random_loop(
    seed: int, states: int, pixels: int, threshold: float, spread: float
) -> ClosedLoop:
    """Random plant with LQG, random pixels and references; the set-point is bright enough."""
    rng = np.random.default_rng(seed)
    model = PlantModel(
        state_matrix=rng.uniform(-3, 3, (states, states)),
        input_matrix=rng.standard_normal((states, rng.integers(1, states + 1))),
        output_vector=rng.standard_normal(states),
    )
    held = model.equilibrium(np.zeros(states), tolerance=1e-9)
    start = rng.uniform(-0.1, 0.1, states)
    offsets = 1 + rng.uniform(0, 0.3, pixels)
    scene = PixelScene(brightness_offsets=offsets, height=1, width=pixels)
    y = scene.luminosity(model, start)
    room = np.expm1(0.9 * threshold * spread)
    bounds = ReferenceBounds(lower=y / (1 + room * rng.random(pixels)), upper=y * (1 + room))
    reference = bounds.lower + (bounds.upper - bounds.lower) * rng.random(pixels)
    return ClosedLoop(
        model=model,
        equilibrium=held,
        scene=scene,
        controller=lqg_controller(
            model, cost=10.0 ** rng.uniform(-2, 0), noise=10.0 ** rng.uniform(-2, 0)
        ),
        bounds=bounds,
        initial_state=start,
        event_threshold=threshold,
        initial_reference=np.clip(reference, bounds.lower, bounds.upper),
    )


loops = st.builds(
    random_loop,
    seed=st.integers(0, 2**31),
    states=st.integers(1, 5),
    pixels=st.integers(1, 12),
    threshold=st.floats(0.005, 0.5),
    spread=st.floats(0, 1),
)


@given(loops)
@settings(max_examples=120, deadline=None)
def test_sector_bound_holds_at_every_event_and_in_between(loop):
    first = simulate(loop, duration=3.0, max_events=3000)
    assume(first.outcome.status in ('completed', 'max_events'))
    end = first.outcome.time
    just_before = np.maximum(first.event_time - 1e-11, 0)
    between = 0.5 * (first.event_time[1:] + first.event_time[:-1])
    instants = np.concatenate([np.linspace(0, end, 300), first.event_time, just_before, between])
    instants = np.sort(instants[instants < end])
    run = simulate(loop, duration=3.0, max_events=3000, sample_times=instants)
    ratios = sector_ratios(loop, run)
    assert ratios.max() <= 1 + 1e-8


@given(loops)
@settings(max_examples=60, deadline=None)
def test_no_pixel_ever_leaves_its_band_unnoticed(loop):
    """Between its thresholds at a dense grid: a missed crossing would show at once."""
    run = simulate(loop, duration=2.0, max_events=2000, sample_times=np.linspace(0, 2, 4001))
    y = luminosities(loop, run.states)
    counts, _ = counts_at(loop, run, run.sample_time)
    level = np.log(y / loop.reference) / loop.event_threshold - counts
    assert np.max(np.abs(level)) <= 1 + 1e-9


@given(loops)
@settings(max_examples=40, deadline=None)
def test_events_are_totally_ordered_and_counts_add_up(loop):
    run = simulate(loop, duration=2.0, max_events=2000)
    ahead = np.diff(run.event_time)
    assert np.all(ahead >= 0)
    assert np.all(np.diff(run.event_pixel.astype(int))[ahead == 0] >= 0)
    assert np.all(run.event_time > 0)
    totals = np.bincount(run.event_pixel, weights=run.event_polarity, minlength=loop.pixel_count)
    np.testing.assert_array_equal(totals, run.counts)
