"""Small state-space systems: the generalized plant, stable scalar weights, the closed loop."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.controller import LinearController

ComplexArray = np.typing.NDArray[np.complex128]


@dataclass(frozen=True, slots=True, kw_only=True)
class StateSpace:
    """``x' = a x + b w``, ``z = c x + d w``.

    Parameters
    ----------
    a
        Shape (n, n), 1/s.
    b
        Shape (n, q).
    c
        Shape (p, n).
    d
        Shape (p, q).
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray

    @classmethod
    def constant(cls, gain: float) -> StateSpace:
        """Static scalar gain.

        Parameters
        ----------
        gain
            The value at every frequency.
        """
        return cls(
            a=np.zeros((0, 0)), b=np.zeros((0, 1)), c=np.zeros((1, 0)), d=np.array([[gain]])
        )

    @property
    def order(self) -> int:
        """Number of states n."""
        return int(self.a.shape[0])

    def response(self, frequencies: FloatArray) -> ComplexArray:
        """Frequency response, shape (len(frequencies), p, q).

        Parameters
        ----------
        frequencies
            w, shape (f,), rad/s.
        """
        pencil = 1j * np.asarray(frequencies)[:, None, None] * np.eye(self.order) - self.a
        right = np.broadcast_to(self.b, (len(pencil), *self.b.shape))
        return np.asarray(self.c @ np.linalg.solve(pencil, right) + self.d)

    def poles(self) -> ComplexArray:
        """Eigenvalues of `a`, shape (n,)."""
        return np.asarray(np.linalg.eigvals(self.a), dtype=np.complex128)

    @property
    def abscissa(self) -> float:
        """Largest real part that a pole may have, to rounding; minus infinity without states."""
        poles = self.poles()
        rounding = np.finfo(float).eps * float(np.max(np.abs(poles), initial=0.0))
        return float(np.max(poles.real, initial=-math.inf)) + rounding


@dataclass(frozen=True, slots=True, kw_only=True)
class GeneralizedPlant:
    """``x' = A x + B1 w + B2 u``, ``z = C1 x + D12 u``, ``y = C2 x + D21 w``.

    D11 and D22 are zero, as in the paper's plant (eq. 23).

    Parameters
    ----------
    a
        Shape (n, n), 1/s.
    b1
        Disturbance matrix, shape (n, q).
    b2
        Input matrix, shape (n, m).
    c1
        Performance matrix, shape (p, n).
    c2
        Measurement matrix, shape (l, n).
    d12
        Shape (p, m).
    d21
        Shape (l, q).
    """

    a: FloatArray
    b1: FloatArray
    b2: FloatArray
    c1: FloatArray
    c2: FloatArray
    d12: FloatArray
    d21: FloatArray

    def close(self, controller: StateSpace) -> StateSpace:
        """Closed loop from w to z.

        Parameters
        ----------
        controller
            K from y to u.
        """
        b2k, k_c2 = self.b2 @ controller.c, controller.b @ self.c2
        b2d, d12d = self.b2 @ controller.d, self.d12 @ controller.d
        return StateSpace(
            a=np.block([[self.a + b2d @ self.c2, b2k], [k_c2, controller.a]]),
            b=np.vstack([self.b1 + b2d @ self.d21, controller.b @ self.d21]),
            c=np.hstack([self.c1 + d12d @ self.c2, self.d12 @ controller.c]),
            d=d12d @ self.d21,
        )


def balanced(system: StateSpace) -> StateSpace:
    """The same system with states scaled by powers of two, so that no entry towers over others.

    Parameters
    ----------
    system
        Any state-space system.
    """
    if not system.order:
        return system
    _, (scale, _) = scipy.linalg.matrix_balance(system.a, permute=False, separate=True)
    b, c = system.b / scale[:, None], system.c * scale
    level = 2.0 ** np.round(
        np.log2((float(np.linalg.norm(c)) + 1e-150) / (float(np.linalg.norm(b)) + 1e-150)) / 2
    )
    return StateSpace(
        a=system.a / scale[:, None] * scale, b=b * level, c=c / level, d=system.d.copy()
    )


def lyapunov_solution(a: FloatArray, q: FloatArray) -> FloatArray:
    """X of ``a X + X a' = q``, without a warning where that is nearly singular.

    Its callers check what they make of X.

    Parameters
    ----------
    a
        Shape (n, n).
    q
        Shape (n, n).
    """
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', RuntimeWarning)
        return np.asarray(scipy.linalg.solve_continuous_lyapunov(a, q))


def state_response(model: PlantModel, controller: LinearController) -> StateSpace:
    """``G``: from the mean disturbance w to the deviation x, with ``u = K (c'x + w)``.

    ``T = c'G`` is the scalar channel that the sector closes (docs/theory.md, "Reduction"); with
    several pixel groups, a column and a row each.

    Parameters
    ----------
    model
        Plant.
    controller
        K on the mean of zbar.
    """
    n = model.state_count
    b, c = model.input_matrix, model.gradients
    d, bc = controller.feedthrough_matrix, controller.input_matrix
    return StateSpace(
        a=np.block(
            [
                [model.state_matrix + b @ d @ c, b @ controller.output_matrix],
                [bc @ c, controller.state_matrix],
            ]
        ),
        b=np.vstack([b @ d, bc]),
        c=np.hstack([np.eye(n), np.zeros((n, controller.order))]),
        d=np.zeros((n, controller.group_count)),
    )


def weighted(g: StateSpace, weights: FloatArray | None) -> StateSpace:
    """``W G``; G itself without weights.

    Parameters
    ----------
    g
        G, from the mean disturbance to x.
    weights
        Diagonal of W, shape (n,); None for all 1.
    """
    return g if weights is None else replace(g, c=weights[:, None] * g.c)
