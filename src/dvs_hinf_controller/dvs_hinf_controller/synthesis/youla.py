"""All stabilizing controllers around an observer, affine in a few real coefficients."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.synthesis.synthesis_error import Assumption, SynthesisError

_NODES_PER_OCTAVE = 16
_FIRST_STEP = 0.25
_HORIZON = 9.0
_MARGINS = (0.3, 0.1, 0.03, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class YoulaFamily:
    """``u = F xhat + sum_j theta_j phi_j``, phi_j the innovation filtered by ``p_j / (s + p_j)``.

    The innovation does not depend on theta, so that the response to w is affine in theta (Youla,
    Jabr and Bongiorno 1976; Boyd and Barratt 1991, chapter 7). The first filter is 1.

    Parameters
    ----------
    model
        Plant.
    feedback
        F, shape (m, n), with A + B F stable.
    injection
        L, shape (n,), with A - L c' stable.
    filter_poles
        p_j > 0, shape (f,), rad/s.
    """

    model: PlantModel
    feedback: FloatArray
    injection: FloatArray
    filter_poles: FloatArray

    @classmethod
    def around_observer(
        cls, model: PlantModel, filter_poles: FloatArray, *, rate: float
    ) -> YoulaFamily:
        """Family around a linear-quadratic regulator and observer of bandwidth about `rate`.

        Parameters
        ----------
        model
            Plant, stabilizable and detectable.
        filter_poles
            p_j > 0, shape (f,), rad/s.
        rate
            rad/s.

        Raises
        ------
        SynthesisError
            If the plant is not stabilizable or not detectable.
        """
        a, b, c = model.state_matrix, model.input_matrix, model.output_vector[:, None]
        feedback = _regulator(a, b, rate, Assumption.STABILIZABILITY)
        injection = -_regulator(a.T, c, rate, Assumption.DETECTABILITY)[0]
        return cls(model=model, feedback=feedback, injection=injection, filter_poles=filter_poles)

    @property
    def coefficient_count(self) -> int:
        """Number of entries of theta: m for every filter."""
        return self.model.input_count * (self.filter_poles.size + 1)

    def time_grid(self) -> FloatArray:
        """Times that resolve the fastest filter and reach the end of the slowest mode, s."""
        loop = [
            self.model.state_matrix + self.model.input_matrix @ self.feedback,
            self.model.state_matrix - np.outer(self.injection, self.model.output_vector),
        ]
        modes = np.concatenate([np.linalg.eigvals(matrix) for matrix in loop])
        fastest = max(float(np.max(np.abs(modes))), float(np.max(self.filter_poles, initial=0)))
        slowest = min(float(np.min(-modes.real)), float(np.min(self.filter_poles, initial=np.inf)))
        times, step = [0.0], _FIRST_STEP / fastest
        while times[-1] < _HORIZON / slowest:
            times += (times[-1] + step * np.arange(1, _NODES_PER_OCTAVE + 1)).tolist()
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
        a, b, c = self.model.state_matrix, self.model.input_matrix, self.model.output_vector
        n, m = b.shape
        f, k = self.filter_poles.size, self.coefficient_count
        observer = n + f
        size = observer + n * (k + 1)
        flow = np.zeros((size, size))
        start = np.zeros(size)
        flow[:n, :n], start[:n] = a - np.outer(self.injection, c), -self.injection
        flow[n:observer, :n] = np.outer(self.filter_poles, c)
        flow[n:observer, n:observer] = -np.diag(self.filter_poles)
        start[n:observer] = self.filter_poles
        loop = a + b @ self.feedback
        for copy in range(k + 1):
            rows = slice(observer + n * copy, observer + n * (copy + 1))
            flow[rows, rows] = loop
            if copy == 0:
                flow[rows, :n] = -b @ self.feedback
                continue
            filter_index, column = divmod(copy - 1, m)
            if filter_index == 0:
                flow[rows, :n], start[rows] = np.outer(b[:, column], c), b[:, column]
            else:
                flow[rows, n + filter_index - 1] = b[:, column]
        path = _propagate(flow, start, times)[:, observer:].reshape(times.size, k + 1, n)
        return path[:, 0], np.moveaxis(path[:, 1:], 1, 2)

    def controller(self, theta: FloatArray) -> LinearController:
        """Controller of the coefficients theta, of order n + f.

        Parameters
        ----------
        theta
            Shape (`coefficient_count`,).
        """
        a, b, c = self.model.state_matrix, self.model.input_matrix, self.model.output_vector
        n, m = b.shape
        f = self.filter_poles.size
        gains = theta.reshape(f + 1, m).T
        direct = gains[:, 0]
        output = np.hstack([self.feedback - np.outer(direct, c), gains[:, 1:]])
        state = np.zeros((n + f, n + f))
        state[:n, :n] = a - np.outer(self.injection, c)
        state[n:, :n] = -np.outer(self.filter_poles, c)
        state[n:, n:] = -np.diag(self.filter_poles)
        state[:n] += b @ output
        return LinearController(
            state_matrix=state,
            input_vector=np.concatenate([self.injection + b @ direct, self.filter_poles]),
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


def _propagate(flow: FloatArray, start: FloatArray, times: FloatArray) -> FloatArray:
    path = np.empty((times.size, start.size))
    path[0] = start
    step, transition = math.nan, np.eye(start.size)
    for index, length in enumerate(np.diff(times)):
        if not math.isclose(length, step, rel_tol=1e-6):
            step = float(length)
            transition = scipy.linalg.expm(flow * step)
        path[index + 1] = transition @ path[index]
    return path
