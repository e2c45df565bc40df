"""What is free within a promise, chosen against it: starts, references, lateness, plants."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.state_space import state_response
from dvs_simulation.sampled.late_loop import TICKS

_KEPT = 0.7


@dataclass(frozen=True, slots=True, kw_only=True)
class Freedom:
    """Everything that a promise leaves open in one run.

    Parameters
    ----------
    start
        ``x(0) - x_d`` as a share of what the start may be, in the unit ball, shape (n,).
    references
        First reference of every pixel, from -1 to 1 times a step of the threshold, shape (r,).
    lateness
        Share of the jitter by which every command is late, in {-1, 1}, shape (K,).
    push
        Sign of the disturbance of every input at every tick, shape (K TICKS, m).
    greedy
        Rows by which the sign of the disturbance follows the state instead; zero for `push`.
    state_errors
        Signs of the errors of A, shape (n, n).
    input_errors
        Signs of the errors of B, shape (n, m).
    """

    start: FloatArray
    references: FloatArray
    lateness: NDArray[np.int64]
    push: FloatArray
    greedy: FloatArray
    state_errors: FloatArray
    input_errors: FloatArray

    def repeated(self, times: int) -> Freedom:
        """The same, and on by the same lateness and pushes again.

        Parameters
        ----------
        times
            Length of the longer run as a multiple of this one's.
        """
        return replace(
            self,
            lateness=np.tile(self.lateness, times),
            push=np.tile(self.push, (times, 1)),
        )

    def mixed(self, other: Freedom, rng: np.random.Generator) -> Freedom:
        """Most of this one, and some of the choices of another.

        Parameters
        ----------
        other
            Where the rest is from.
        rng
            Source of randomness.
        """
        names = [field.name for field in fields(self)]
        kept = rng.random(len(names)) < _KEPT
        return Freedom(
            **{
                name: getattr(self if keep else other, name)
                for name, keep in zip(names, kept.tolist(), strict=True)
            }
        )


class Adversary:
    """Draws freedoms that are bad for one loop.

    Disturbances have the sign of the loop's kernel backwards from the end of the run, which is the
    worst for one direction of the state, follow a gradient of a Lyapunov function, or are square
    waves; errors of the plant go along the gradient of the offset at rest or of the slowest pole.

    Parameters
    ----------
    problem
        Plant, set-point and pixels.
    controller
        K.
    samples
        Length of a run.
    period
        Sampling period, s.
    """

    def __init__(
        self, problem: DesignProblem, controller: LinearController, *, samples: int, period: float
    ) -> None:
        self._problem, self._samples = problem, samples
        model = problem.model
        loop = state_response(model, controller)
        n = model.state_count
        self._entry = np.eye(loop.order, n)
        self._loop, self._out = loop.a, loop.c
        self._energy = scipy.linalg.solve_continuous_lyapunov(loop.a.T, -loop.c.T @ loop.c)[:n, :n]
        self._kernel = self._backwards(samples * TICKS, period / TICKS)

    def draw(self, rng: np.random.Generator) -> Freedom:
        """A freedom.

        Parameters
        ----------
        rng
            Source of randomness.
        """
        model = self._problem.model
        pixels = self._problem.scene.pixel_count
        v = _unit(rng, model.state_count)
        state_errors, input_errors = self._errors(v, rng)
        greedy = np.zeros((model.input_count, model.state_count))
        if rng.random() < 0.25:
            greedy = rng.choice([-1, 1]) * (model.input_matrix.T @ self._energy)
        together = rng.random() < 0.5
        return Freedom(
            start=_unit(rng, model.state_count) * rng.choice([1.0, rng.uniform(0, 1)]),
            references=rng.choice([-1.0, 1.0, 0.3], 1 if together else pixels) * np.ones(pixels),
            lateness=self._lateness(rng),
            push=self._push(v, rng),
            greedy=greedy,
            state_errors=state_errors,
            input_errors=input_errors,
        )

    def _backwards(self, ticks: int, tick: float) -> FloatArray:
        """Response of x at the end to a push of every input at every tick, (ticks, n, m)."""
        modes, vectors = np.linalg.eig(self._loop)
        into = np.linalg.solve(vectors, self._entry @ self._problem.model.input_matrix + 0j)
        ages = (ticks - np.arange(ticks)) * tick
        decays = np.exp(np.multiply.outer(ages, modes))
        mixing = np.einsum('ij,jk->jik', self._out @ vectors, into)
        flat = decays @ mixing.reshape(modes.size, -1)
        return np.asarray(flat.real.reshape(ticks, *mixing.shape[1:]))

    def _push(self, v: FloatArray, rng: np.random.Generator) -> FloatArray:
        ticks, m = self._samples * TICKS, self._problem.model.input_count
        if rng.random() < 0.6:
            worst = np.einsum('tij,i->tj', self._kernel, v)
            return np.where(worst >= 0, 1.0, -1.0)
        wave = max(int(ticks * 10.0 ** rng.uniform(-3, 0)), 1)
        signs = np.where((np.arange(ticks) // wave) % 2 == 0, 1.0, -1.0)
        return np.asarray(signs[:, None] * rng.choice([-1.0, 1.0], m))

    def _lateness(self, rng: np.random.Generator) -> NDArray[np.int64]:
        if rng.random() < 0.3:
            return np.full(self._samples, rng.choice([-1, 1]), dtype=np.int64)
        return np.asarray(rng.choice([-1, 1], self._samples), dtype=np.int64)

    def _errors(self, v: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        model, held = self._problem.model, self._problem.equilibrium
        kind = rng.integers(3)
        if kind == 0:
            return (
                rng.choice([-1.0, 1.0], model.state_matrix.shape),
                rng.choice([-1.0, 1.0], model.input_matrix.shape),
            )
        if kind == 1:
            back = -np.linalg.solve(self._loop.T, self._out.T @ v) @ self._entry
            state, command = held.state, held.feedforward
        else:
            modes, vectors = np.linalg.eig(self._loop)
            slowest = int(np.argmax(modes.real))
            back = np.linalg.inv(vectors)[slowest] @ self._entry
            mode = vectors[:, slowest]
            state = self._out @ mode
            command = np.linalg.lstsq(
                model.input_matrix, modes[slowest] * state - model.state_matrix @ state
            )[0]
        return (
            _signs(np.outer(back, state) * np.sign(model.state_matrix)),
            _signs(np.outer(back, command) * np.sign(model.input_matrix)),
        )


def _unit(rng: np.random.Generator, size: int) -> FloatArray:
    v = rng.standard_normal(size)
    return np.asarray(v / np.linalg.norm(v))


def _signs(gradient: NDArray[np.complex128] | FloatArray) -> FloatArray:
    return np.where(np.real(gradient) >= 0, 1.0, -1.0)


def in_error(model: PlantModel, freedom: Freedom, size: float) -> PlantModel:
    """The plant with every entry of A and B wrong by a share.

    Parameters
    ----------
    model
        Plant.
    freedom
        Signs of the errors.
    size
        Relative error.
    """
    return PlantModel(
        state_matrix=model.state_matrix * (1 + size * freedom.state_errors),
        input_matrix=model.input_matrix * (1 + size * freedom.input_errors),
        output_vector=model.output_vector,
    )


def largest_start(problem: DesignProblem) -> float:
    """Size of the deviations from which runs begin: at most the tolerance.

    Less where a luminosity would not stay positive.

    Parameters
    ----------
    problem
        Pixels and tolerance.
    """
    room = float(np.min(problem.set_point_luminosity))
    room /= float(np.linalg.norm(problem.model.gradient))
    return min(problem.tolerance, 0.3 * room) if math.isfinite(room) else problem.tolerance
