"""All stabilizing controllers around an observer, affine in a few real coefficients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.state_space import ComplexArray
from dvs_hinf_controller.synthesis.synthesis_error import Assumption, SynthesisError

_NODES_PER_OCTAVE = 10
_FIRST_STEP = 0.25
_HORIZON = 9.0
# A mode swings by at most this angle from node to node while it counts.
_WIDEST_ANGLE, _ALIVE = 0.6, 5.0
_MOST_NODES = 1000
_MARGINS = (0.3, 0.1, 0.03, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Jump:
    """``slope theta + offset`` is the jump of u when w jumps by one, and must be zero.

    Parameters
    ----------
    slope
        Shape (m, k), or (0, k) where u may jump.
    offset
        Shape (m,) or (0,).
    """

    slope: FloatArray
    offset: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Filters:
    """``phi' = matrix phi + drive e``: filters of one signal, each with its static gain.

    Parameters
    ----------
    matrix
        M, stable, shape (f, f), rad/s.
    drive
        d, shape (f,), rad/s.
    """

    matrix: FloatArray
    drive: FloatArray

    @classmethod
    def of(cls, poles: FloatArray, pairs: ComplexArray | None = None) -> Filters:
        """``p_j / (s + p_j)``, and two of second order for every pair of complex poles.

        Parameters
        ----------
        poles
            p_j > 0, shape (f,), rad/s.
        pairs
            One pole of each pair, shape (g,), rad/s; none by default.
        """
        pairs = np.zeros(0, dtype=complex) if pairs is None else pairs
        blocks = [np.array([[p.real, abs(p.imag)], [-abs(p.imag), p.real]]) for p in pairs]
        drive = np.column_stack([np.zeros(len(pairs)), np.abs(pairs)]).ravel()
        return cls(
            matrix=scipy.linalg.block_diag(-np.diag(poles), *blocks),
            drive=np.concatenate([poles, drive]),
        )

    @property
    def fastest(self) -> float:
        """Largest magnitude of a pole, rad/s."""
        return float(np.max(np.abs(np.linalg.eigvals(self.matrix)), initial=0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class YoulaFamily:
    """``u = F xhat + sum_j theta_j phi_j``, ``phi' = M phi + d e``, e the innovation.

    The innovation does not depend on theta, so that the response to w is affine in theta (Youla,
    Jabr and Bongiorno 1976; Boyd and Barratt 1991, chapter 7). Before these filters there is one
    that is 1, unless the family is strictly proper.

    Parameters
    ----------
    model
        Plant.
    feedback
        F, shape (m, n), with A + B F stable.
    injection
        L, shape (n,), with A - L c' stable.
    filters
        M and d.
    strictly_proper
        Whether no controller of the family has a feedthrough.
    """

    model: PlantModel
    feedback: FloatArray
    injection: FloatArray
    filters: Filters
    strictly_proper: bool = False

    @classmethod
    def around_observer(
        cls,
        model: PlantModel,
        filters: Filters,
        *,
        rate: float,
        strictly_proper: bool = False,
    ) -> YoulaFamily:
        """Family around a linear-quadratic regulator and observer of bandwidth about `rate`.

        Parameters
        ----------
        model
            Plant, stabilizable and detectable.
        filters
            M and d.
        rate
            rad/s.
        strictly_proper
            Whether no controller of the family has a feedthrough.

        Raises
        ------
        SynthesisError
            If the plant is not stabilizable or not detectable.
        """
        a, b, c = model.state_matrix, model.input_matrix, model.gradient[:, None]
        feedback = _regulator(a, b, rate, Assumption.STABILIZABILITY)
        injection = -_regulator(a.T, c, rate, Assumption.DETECTABILITY)[0]
        return cls(
            model=model,
            feedback=feedback,
            injection=injection,
            filters=filters,
            strictly_proper=strictly_proper,
        )

    @property
    def coefficient_count(self) -> int:
        """Number of entries of theta: m for every filter."""
        return self.model.input_count * (self.filters.drive.size + (not self.strictly_proper))

    def time_grid(self) -> FloatArray:
        """Times that resolve the fastest filter and reach the end of the slowest mode, s.

        Raises
        ------
        SynthesisError
            If rounding hides whether the loop around the observer is stable.
        """
        loop = [
            self.model.state_matrix + self.model.input_matrix @ self.feedback,
            self.model.state_matrix - np.outer(self.injection, self.model.gradient),
            self.filters.matrix,
        ]
        modes = np.concatenate([np.linalg.eigvals(matrix) for matrix in loop])
        fastest, slowest = float(np.max(np.abs(modes))), float(np.min(-modes.real))
        if not slowest > 0:
            detail = 'rounding hides whether the loop around the observer is stable'
            raise SynthesisError(Assumption.CONFIRMATION, detail)
        times, step = [0.0], _FIRST_STEP / fastest
        while times[-1] < _HORIZON / slowest and len(times) < _MOST_NODES:
            times += (times[-1] + step * np.arange(1, _NODES_PER_OCTAVE + 1)).tolist()
            swinging = np.abs(modes[-modes.real * times[-1] < _ALIVE])
            if 2 * step * float(swinging.max(initial=0.0)) <= _WIDEST_ANGLE:
                step *= 2
        return np.array(times)

    def responses(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Impulse responses from w to x: without Q, and of every coefficient of theta.

        Parameters
        ----------
        times
            Shape (N,), s; see `time_grid`.

        Returns
        -------
        tuple
            Shapes (N, n) and (N, n, k) with k = `coefficient_count`; theta is ordered filter by
            filter.
        """
        a, b, c = self.model.state_matrix, self.model.input_matrix, self.model.gradient
        n, m = b.shape
        f = self.filters.drive.size
        observer = np.zeros((n + f, n + f))
        observer[:n, :n] = a - np.outer(self.injection, c)
        observer[n:, :n] = np.outer(self.filters.drive, c)
        observer[n:, n:] = self.filters.matrix
        signals = np.vstack([np.append(c, np.zeros(f)), np.eye(n + f)[n:]])
        if self.strictly_proper:
            signals = signals[1:]
        drives = np.concatenate(
            [
                np.hstack([-b @ self.feedback, np.zeros((n, f))])[None],
                np.einsum('ij,kl->kjil', b, signals).reshape(-1, n, n + f),
            ]
        )
        start = np.zeros((self.coefficient_count + 1, n))
        if not self.strictly_proper:
            start[1 : m + 1] = b.T
        path = _propagate(
            _Cascade(loop=a + b @ self.feedback, observer=observer, drives=drives),
            np.concatenate([-self.injection, self.filters.drive]),
            start,
            times,
        )
        return path[:, 0], np.moveaxis(path[:, 1:], 1, 2)

    def jump(self, sizes: FloatArray) -> Jump:
        """Constraint that u does not jump when w does; none unless the family is strictly proper.

        A held command that may jump acts up to a period late, at random; one that does not acts
        half a period late, but for a remainder of second order.

        Parameters
        ----------
        sizes
            Units of the coefficients, shape (`coefficient_count`,).
        """
        m = self.model.input_count
        if not self.strictly_proper:
            return Jump(slope=np.zeros((0, self.coefficient_count)), offset=np.zeros(0))
        slope = np.kron(self.filters.drive, np.eye(m)) / sizes
        return Jump(slope=slope, offset=self.feedback @ self.injection)

    def controller(self, theta: FloatArray) -> LinearController:
        """Controller of the coefficients theta, of order n + f.

        Parameters
        ----------
        theta
            Shape (`coefficient_count`,).
        """
        a, b, c = self.model.state_matrix, self.model.input_matrix, self.model.gradient
        n, m = b.shape
        f = self.filters.drive.size
        if self.strictly_proper:
            theta = np.concatenate([np.zeros(m), theta])
        gains = theta.reshape(f + 1, m).T
        direct = gains[:, 0]
        output = np.hstack([self.feedback - np.outer(direct, c), gains[:, 1:]])
        state = np.zeros((n + f, n + f))
        state[:n, :n] = a - np.outer(self.injection, c)
        state[n:, :n] = -np.outer(self.filters.drive, c)
        state[n:, n:] = self.filters.matrix
        state[:n] += b @ output
        return LinearController(
            state_matrix=state,
            input_vector=np.concatenate([self.injection + b @ direct, self.filters.drive]),
            output_matrix=output,
            feedthrough=direct,
        )


def _regulator(a: FloatArray, b: FloatArray, rate: float, assumption: Assumption) -> FloatArray:
    """Linear-quadratic gain F; decays by a share of `rate` where the plant's modes allow it."""
    n, m = b.shape
    cost = (float(np.linalg.norm(b, 2)) / rate) ** 2
    for margin in _MARGINS:
        shifted = a + margin * rate * np.eye(n)
        try:
            x = scipy.linalg.solve_continuous_are(shifted, b, np.eye(n), cost * np.eye(m))
        except (np.linalg.LinAlgError, ValueError):
            continue
        gain = -b.T @ x / cost
        if float(np.max(np.linalg.eigvals(a + b @ gain).real)) < 0:
            return np.asarray(gain, dtype=np.float64)
    raise SynthesisError(assumption, 'no observer-based controller stabilizes the plant')


@dataclass(frozen=True, slots=True, kw_only=True)
class _Cascade:
    """``o' = observer o``, ``x_k' = loop x_k + drives_k o`` for every k; or one step of it."""

    loop: FloatArray
    observer: FloatArray
    drives: FloatArray

    def step(self, length: float) -> _Cascade:
        count, n, q = self.drives.shape
        flow = np.zeros((count, n + q, n + q))
        flow[:, :n, :n], flow[:, n:, n:] = self.loop, self.observer
        flow[:, :n, n:] = self.drives
        steps = scipy.linalg.expm(flow * length)
        return _Cascade(loop=steps[0, :n, :n], observer=steps[0, n:, n:], drives=steps[:, :n, n:])

    def twice(self) -> _Cascade:
        return _Cascade(
            loop=self.loop @ self.loop,
            observer=self.observer @ self.observer,
            drives=self.loop @ self.drives + self.drives @ self.observer,
        )


def _propagate(
    flow: _Cascade, observed: FloatArray, start: FloatArray, times: FloatArray
) -> FloatArray:
    """All x_k at the times of a `time_grid`, whose steps double; shape (N, k, n)."""
    path = np.empty((times.size, *start.shape))
    path[0] = start
    lengths = np.diff(times)
    length, step = lengths[0], flow.step(lengths[0])
    for index, wanted in enumerate(lengths):
        if wanted > 1.5 * length:
            length, step = 2 * length, step.twice()
        path[index + 1] = path[index] @ step.loop.T + step.drives @ observed
        observed = step.observer @ observed
    return path
