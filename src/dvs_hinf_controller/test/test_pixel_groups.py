"""Several pixel groups: one design, one estimator and one certificate for k means."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from plants import plants

from dvs_common.errors import ParameterError
from dvs_common.scenario.model import PixelScene, PlantModel
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_common.wire.events import EVENT_DTYPE, EventPacket
from dvs_hinf_controller.analysis.hinf_norm import hinf_norm
from dvs_hinf_controller.analysis.peak_gain import ChannelGains, channel_gains, peak_gains
from dvs_hinf_controller.analysis.published_norms import published_norms
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.design.bode_figure import save_bode_figure
from dvs_hinf_controller.design.design import (
    design_controller,
    load_design,
    measure,
    save_design,
)
from dvs_hinf_controller.design.live_certificate import LiveCertificate
from dvs_hinf_controller.operation import Operation
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.running.event_controller import EventController
from dvs_hinf_controller.state_space import StateSpace, state_response

pytestmark = pytest.mark.ensemble

# Two double integrators; each of two stripes sees mainly one of them.
AXES = PlantModel(
    state_matrix=np.kron(np.eye(2), [[0.0, 1.0], [0.0, 0.0]]),
    input_matrix=np.kron(np.eye(2), [[0.0], [1.0]]),
    output_vector=np.array([[1.0, 0.0, 0.2, 0.0], [0.1, 0.0, 1.0, 0.0]]),
)
GROUPS = np.array([0, 1, 1, 0, 1])
OPERATION = Operation(sampling_period=5e-3, latency=2e-3, disturbance_bound=np.full(2, 1e-3))
H = 0.05
SECOND = 10**9


def problem_of(model, groups, *, operation=None, luminosity=None, **values):
    size = 5 if groups is None else groups.size
    y = np.linspace(0.9, 1.1, size) if luminosity is None else luminosity
    return DesignProblem(
        model=model,
        equilibrium=model.equilibrium(np.zeros(model.state_count), tolerance=1e-9),
        scene=PixelScene(brightness_offsets=y, height=1, width=size, groups=groups),
        bounds=ReferenceBounds(lower=y * 0.99, upper=y * 1.01),
        tolerance=0.2,
        log_base=math.e,
        operation=operation,
        **values,
    )


@pytest.fixture(scope='module')
def quadrotor():
    problem = problem_of(AXES, GROUPS, error_weights=np.array([1.0, 0.0, 1.0, 0.0]))
    return design_controller(problem, method='unstructured')


def split(controller, groups):
    """The same controller on the mean of all pixels, by the means of the groups."""
    shares = np.bincount(groups) / groups.size
    return dataclasses.replace(
        controller,
        input_vector=controller.input_vector[:, None] * shares,
        feedthrough=controller.feedthrough[:, None] * shares,
    )


# -- equal rows are one group -------------------------------------------------------------------


@settings(max_examples=4)
@given(plants(max_states=2, max_inputs=1), st.booleans())
def test_equal_groups_have_the_figures_of_one(model, sampled):
    operation = OPERATION if sampled else None
    if operation is not None:
        operation = dataclasses.replace(
            operation, disturbance_bound=np.full(model.input_count, 1e-3)
        )
    one = problem_of(model, None, operation=operation)
    design = design_controller(one, method='unstructured')
    rows = dataclasses.replace(model, output_vector=np.tile(model.output_vector, (2, 1)))
    two = problem_of(rows, GROUPS, operation=operation, luminosity=np.linspace(0.9, 1.1, 5))

    figures = measure(two, split(design.controller, GROUPS))

    for name in (
        'gamma',
        'dc_gain_w1',
        'dc_gain_w2',
        'hinf_gain_w1',
        'delta_star',
        'h_star',
        'state_peak_gain',
        'output_peak_gain',
        'delta_certified',
        'h_certified_continuous',
        'h_certified',
        'max_sampling_period',
    ):
        assert getattr(figures, name) == pytest.approx(
            getattr(design.figures, name), rel=3e-3, abs=1e-6
        ), name


def packets(seed, count=12, pixels=5):
    generator = np.random.default_rng(seed)
    for number in range(1, count + 1):
        events = np.zeros(generator.integers(0, 6), EVENT_DTYPE)
        events['t'] = np.sort(-generator.integers(0, SECOND // 100, events.size))
        events['x'] = generator.integers(0, pixels, events.size)
        events['polarity'] = generator.choice([-1, 1], events.size)
        events['sign'] = 1
        yield number * SECOND // 100, events


def commands_of(problem, controller, seed, **options):
    running = EventController(
        problem, controller, event_threshold=H, command_limit=np.full(1, np.inf), **options
    )
    index, commands = 0, []
    for stamp_ns, events in packets(seed):
        events['index'] = index + np.arange(events.size)
        index += events.size
        running.take(EventPacket(stamp_ns=stamp_ns, events=events))
        running.look_ahead()
        commands.append(running.command)
    return np.array(commands)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), masked=st.sets(st.integers(0, 4), max_size=2))
def test_equal_groups_have_the_commands_of_one(seed, masked):
    generator = np.random.default_rng(seed)
    model = PlantModel(
        state_matrix=[[0.3]], input_matrix=[[1.0]], output_vector=generator.uniform(0.5, 2, 1)
    )
    k = LinearController(
        state_matrix=generator.standard_normal((2, 2)) - 2 * np.eye(2),
        input_vector=generator.standard_normal(2),
        output_matrix=generator.standard_normal((1, 2)),
        feedthrough=generator.standard_normal(1),
    )
    used = np.setdiff1d(np.arange(5), list(masked))
    rows = dataclasses.replace(model, output_vector=np.tile(model.output_vector, (2, 1)))
    if np.unique(GROUPS[used]).size < 2:
        return
    shares = np.bincount(GROUPS[used]) / used.size
    two = dataclasses.replace(
        k,
        input_vector=k.input_vector[:, None] * shares,
        feedthrough=k.feedthrough[:, None] * shares,
    )

    alone = commands_of(problem_of(model, None), k, seed, pixel_mask=sorted(masked))
    apart = commands_of(problem_of(rows, GROUPS), two, seed, pixel_mask=sorted(masked))

    assert np.abs(alone).max() > 0
    assert apart == pytest.approx(alone, rel=1e-9, abs=1e-12)


# -- norms and gains ------------------------------------------------------------------------------


def test_the_published_norms_are_those_of_the_plant_with_all_pixels(quadrotor):
    # u = sum_j K_j mean_i(zbar_i), zbar_i = c_j'(x + w1_i) + w2_i; r copies of x (paper, eq. 23).
    g = state_response(AXES, quadrotor.controller)
    r, n = GROUPS.size, AXES.state_count
    shares = np.bincount(GROUPS)
    means = np.zeros((2, r))
    means[GROUPS, np.arange(r)] = 1 / shares[GROUPS]
    w1 = np.hstack([means[:, [i]] @ AXES.gradients[[GROUPS[i]]] for i in range(r)])

    def norm(columns):
        loop = StateSpace(
            a=g.a,
            b=g.b @ columns,
            c=np.tile(g.c, (r, 1)),
            d=np.zeros((r * n, columns.shape[1])),
        )
        return hinf_norm(loop).upper

    norms = published_norms(quadrotor.problem, g)
    assert norms.gamma == pytest.approx(norm(np.hstack([w1, means])), rel=1e-5)
    assert norms.hinf_gain_w1 == pytest.approx(norm(w1), rel=1e-5)
    assert math.isnan(norms.mu_upper)


def test_plants_that_do_not_meet_have_the_norm_of_the_worse_one():
    def plant(*poles):
        n = len(poles)
        return PlantModel(
            state_matrix=np.diag(poles), input_matrix=np.eye(n), output_vector=np.eye(n)
        )

    both = design_controller(
        problem_of(plant(1.0, 2.0), np.array([0, 1])), method='unstructured'
    ).figures.gamma
    alone = []
    for pole in (1.0, 2.0):
        one = dataclasses.replace(plant(pole), output_vector=np.ones(1))
        alone.append(design_controller(problem_of(one, None), method='unstructured').figures.gamma)
    assert both == pytest.approx(math.sqrt(2) * max(alone), rel=0.02)


def test_the_gains_of_several_groups_are_those_of_every_pair(quadrotor):
    g = state_response(AXES, quadrotor.controller)
    found = channel_gains(g, AXES.gradients)
    for j in range(2):
        column = dataclasses.replace(g, b=g.b[:, [j]], d=g.d[:, [j]])
        for i, row in enumerate(AXES.gradients):
            one = peak_gains(column, row)
            assert found.output[i, j] == pytest.approx(one.output, rel=1e-3)
            assert found.state[j] == pytest.approx(one.state, rel=1e-3)


@given(
    st.lists(st.floats(0, 2), min_size=4, max_size=4),
    st.lists(st.floats(0, 1), min_size=2, max_size=2),
)
def test_the_bound_of_the_means_is_the_limit_of_its_own_iteration(entries, share):
    gains = ChannelGains(state=np.ones(2), output=np.array(entries).reshape(2, 2))
    constant, share = np.array([1.0, 0.5]), np.array(share)
    radius = np.abs(np.linalg.eigvals(share[:, None] * gains.output)).max()
    assume(abs(radius - 1) > 0.02)
    found, w = gains.amplified(constant, share), constant
    for _ in range(2000):
        if w.max() > 1e6:
            break
        w = constant + share * (gains.output @ w)
    assert (found is None) == (radius > 1)
    if found is not None:
        assert w == pytest.approx(found, rel=1e-6)


# -- designs --------------------------------------------------------------------------------------


def test_certified_is_not_worse_than_unstructured_with_two_groups():
    problem = problem_of(
        AXES,
        GROUPS,
        operation=Operation(sampling_period=5e-3),
        error_weights=np.array([1.0, 0.0, 1.0, 0.0]),
        settling_time=15.0,
    )
    certified = design_controller(problem, method='certified').figures
    unstructured = design_controller(problem, method='unstructured').figures
    assert certified.h_certified > max(unstructured.h_certified, 0.02)
    assert certified.h_certified < certified.h_certified_continuous
    assert certified.closed_loop_abscissa <= -math.log(50) / 15.0


def test_a_plant_that_no_single_stripe_sees_is_detectable_by_both():
    AXES.require_detectable()
    for row in np.eye(4)[[0, 2]]:
        with pytest.raises(ParameterError, match='does not see the unstable mode'):
            dataclasses.replace(AXES, output_vector=row).require_detectable()


def test_what_takes_one_group_refuses_two_by_name(quadrotor, tmp_path):
    with pytest.raises(ParameterError, match='2 pixel groups; method structured takes'):
        design_controller(quadrotor.problem, method='structured')
    with pytest.raises(ParameterError, match='2 pixel groups; the Bode figure takes'):
        save_bode_figure([quadrotor], tmp_path / 'bode.png')
    with pytest.raises(ParameterError, match=r'^pixel_groups = \[0\]'):
        dataclasses.replace(
            quadrotor.problem, scene=dataclasses.replace(quadrotor.problem.scene, groups=None)
        )


def test_a_design_of_two_groups_is_read_as_it_was_written(quadrotor, tmp_path):
    save_design(quadrotor, tmp_path / 'design.json')
    again = load_design(tmp_path / 'design.json', quadrotor.problem)
    for name in ('state_matrix', 'input_vector', 'output_matrix', 'feedthrough'):
        assert np.array_equal(getattr(again.controller, name), getattr(quadrotor.controller, name))
    assert again.figures.h_certified == quadrotor.figures.h_certified
    swapped = dataclasses.replace(
        quadrotor.problem,
        scene=dataclasses.replace(quadrotor.problem.scene, groups=1 - GROUPS),
    )
    with pytest.raises(ParameterError, match='another pixel set'):
        load_design(tmp_path / 'design.json', swapped)


# -- a group without a pixel --------------------------------------------------------------------


def test_a_group_without_a_pixel_leaves_no_command_and_no_certificate(quadrotor):
    problem, masked = quadrotor.problem, [0, 3]
    assert np.all(GROUPS[masked] == 0)
    running = EventController(
        problem,
        quadrotor.controller,
        event_threshold=H,
        command_limit=np.full(2, np.inf),
        pixel_mask=masked,
    )
    assert running.lacks_pixels
    assert np.array_equal(running.command, problem.equilibrium.feedforward)
    healthy = np.isin(np.arange(GROUPS.size), masked, invert=True)
    with pytest.raises(ParameterError, match='must leave a pixel of pixel group 0'):
        problem.of_pixels(healthy)
    assert not problem.sees_all_groups(healthy)
    live = LiveCertificate(quadrotor).of(healthy)
    assert live.delta_certified == 0
    assert live.values(H)['h_certified'] == 'none: no pixel of a pixel group is left'
