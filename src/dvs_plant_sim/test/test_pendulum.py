"""The pendulum against SciPy's integrator, its energy and its linearisation."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dvs_common.errors import ParameterError
from dvs_plant_sim.pendulum import Pendulum, PendulumConstants

MS = 1_000_000


def constants(**changes):
    values = {'mass': 0.2, 'length': 1.0, 'friction': 0.02, 'gravity': 9.81, **changes}
    return PendulumConstants(**values)


def swing(pendulum, *, seconds, torque, step_ns=MS):
    for _ in range(round(seconds * 1e9 / step_ns)):
        pendulum.advance(step_ns, np.array([torque]))
    return pendulum.state


@pytest.mark.parametrize('torque', [0.0, 0.3, -1.0])
@pytest.mark.parametrize('initial', [(0.3, 0.0), (3.0, -8.0)])
def test_it_moves_as_dop853_integrates_it(torque, initial):
    c = constants()
    exact = solve_ivp(
        lambda _, x: [x[1], c.acceleration(x[0], x[1], torque)],
        (0, 2),
        initial,
        method='DOP853',
        rtol=1e-13,
        atol=1e-13,
    ).y[:, -1]

    state = swing(Pendulum(c, initial_state=np.array(initial)), seconds=2, torque=torque)

    np.testing.assert_allclose(state, exact, rtol=1e-9, atol=1e-9)


def test_without_friction_energy_stays_over_fifty_turns():
    c = constants(friction=0.0)
    pendulum = Pendulum(c, initial_state=np.array([0.1, 8.0]))

    def energy(state):
        return state[1] ** 2 / 2 + c.gravity / c.length * math.cos(state[0])

    before = energy(pendulum.state)
    after = energy(swing(pendulum, seconds=60, torque=0.0, step_ns=10 * MS))

    assert pendulum.state[0] > 50 * 2 * math.pi
    assert after == pytest.approx(before, rel=1e-9)


def test_the_linearisation_is_the_derivative_at_the_top():
    c = constants(mass=0.7, length=1.4, friction=0.3)
    d = 1e-6

    def slope(*step):
        plus = c.acceleration(*[d * s for s in step])
        return (plus - c.acceleration(*[-d * s for s in step])) / (2 * d)

    np.testing.assert_allclose(c.state_matrix[0], [0, 1])
    np.testing.assert_allclose(c.state_matrix[1], [slope(1, 0, 0), slope(0, 1, 0)], rtol=1e-9)
    np.testing.assert_allclose(c.input_matrix[:, 0], [0, slope(0, 0, 1)], rtol=1e-9)


def test_a_long_step_is_as_good_as_many_short_ones_and_none_changes_nothing():
    start = np.array([0.4, 0.2])
    long, short = (Pendulum(constants(), initial_state=start) for _ in range(2))
    long.advance(100 * MS, np.array([0.1]))
    swing(short, seconds=0.1, torque=0.1, step_ns=MS // 2)
    np.testing.assert_allclose(long.state, short.state, rtol=1e-12)

    before = long.state.copy()
    long.advance(0, np.array([5.0]))
    np.testing.assert_array_equal(long.state, before)


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('mass', 0.0),
        ('length', -1.0),
        ('gravity', math.inf),
        ('friction', -0.1),
        ('mass', math.nan),
    ],
)
def test_bad_constants_are_named(name, value):
    with pytest.raises(ParameterError, match=rf'^plant\.{name} = '):
        constants(**{name: value})


def test_a_state_of_another_size_is_refused():
    with pytest.raises(ParameterError, match='angle, angular velocity'):
        Pendulum(constants(), initial_state=np.zeros(3))
