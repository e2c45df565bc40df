"""An inverted pendulum driven by a torque: non-linear, and not the paper's plant."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dvs_common.arrays import FloatArray, finite_array
from dvs_common.errors import ParameterError
from dvs_common.nanoseconds import as_seconds

# Local error of a Runge-Kutta step of this length: about (rate * step)^5 / 120, 1e-15 at 4 rad/s.
_LONGEST_STEP_NS = 500_000


@dataclass(frozen=True, slots=True, kw_only=True)
class PendulumConstants:
    """Point mass on a massless rod, with viscous friction in the pivot.

    Parameters
    ----------
    mass
        kg, > 0.
    length
        m, > 0.
    friction
        N m s/rad, >= 0.
    gravity
        m/s^2, > 0.

    Raises
    ------
    ParameterError
        If a value is out of range.
    """

    mass: float
    length: float
    friction: float
    gravity: float

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name in ('mass', 'length', 'gravity'):
            if not 0 < getattr(self, name) < math.inf:
                raise ParameterError(f'plant.{name}', getattr(self, name), 'must be > 0')
        if not 0 <= self.friction < math.inf:
            raise ParameterError('plant.friction', self.friction, 'must be >= 0')

    @property
    def inertia(self) -> float:
        """Moment of inertia about the pivot, kg m^2."""
        return self.mass * self.length**2

    def acceleration(self, angle: float, rate: float, torque: float) -> float:
        """Angular acceleration ``(m g l sin(angle) - friction rate + torque) / (m l^2)``, rad/s^2.

        Parameters
        ----------
        angle
            Angle from the upright position, rad.
        rate
            Angular velocity, rad/s.
        torque
            N m.
        """
        weight = self.mass * self.gravity * self.length * math.sin(angle)
        return (weight - self.friction * rate + torque) / self.inertia

    @property
    def state_matrix(self) -> FloatArray:
        """A of the linearisation at the top, shape (2, 2), 1/s."""
        stiffness, damping = self.gravity / self.length, self.friction / self.inertia
        return np.array([[0.0, 1.0], [stiffness, -damping]])

    @property
    def input_matrix(self) -> FloatArray:
        """B of the linearisation at the top, shape (2, 1)."""
        return np.array([[0.0], [1 / self.inertia]])


class Pendulum:
    """State (angle, angular velocity) of the pendulum, advanced by the classical Runge-Kutta rule.

    Parameters
    ----------
    constants
        Mass, length, friction, gravity.
    initial_state
        Angle from the upright position, rad, and angular velocity, rad/s; shape (2,).

    Raises
    ------
    ParameterError
        If the initial state has not two finite entries.
    """

    def __init__(self, constants: PendulumConstants, *, initial_state: FloatArray) -> None:
        self.state = finite_array('initial_state', initial_state, ndim=1)
        if self.state.size != 2:
            raise ParameterError(
                'initial_state', self.state.tolist(), 'must be [angle, angular velocity]'
            )
        self._constants = constants

    def advance(self, duration_ns: int, command: FloatArray) -> None:
        """Move on by `duration_ns` with the torque held at `command`.

        Parameters
        ----------
        duration_ns
            Length of the step, ns, >= 0.
        command
            Torque, N m, shape (1,).
        """
        steps = -(-duration_ns // _LONGEST_STEP_NS)
        angle, rate = self.state.tolist()
        torque = float(command[0])
        for _ in range(steps):
            step_s = as_seconds(duration_ns) / steps
            angle, rate = self._step(step_s, angle, rate, torque)
        self.state = np.array([angle, rate])

    def _step(self, h: float, angle: float, rate: float, torque: float) -> tuple[float, float]:
        f = self._constants.acceleration
        a1 = f(angle, rate, torque)
        v2 = rate + h / 2 * a1
        a2 = f(angle + h / 2 * rate, v2, torque)
        v3 = rate + h / 2 * a2
        a3 = f(angle + h / 2 * v2, v3, torque)
        v4 = rate + h * a3
        a4 = f(angle + h * v3, v4, torque)
        return (
            angle + h / 6 * (rate + 2 * v2 + 2 * v3 + v4),
            rate + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4),
        )
