"""Stable, minimum-phase, rational scalar weights with a given magnitude."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.state_space import StateSpace

_GOOD_ENOUGH = 3e-4
_MAX_ORDER = 8
_WORTH_A_SECTION = 0.6
_PATIENCE = 2
_NEARLY_AS_WELL = 1.5
# Coefficients of a section: zero and pole, or (corner, damping) of zeros and of poles; logarithms.
_FIRST, _SECOND = 2, 4


@dataclass(frozen=True, slots=True, kw_only=True)
class WeightFit:
    """A rational weight and how well its magnitude fits.

    Parameters
    ----------
    weight
        V, stable with stable inverse, biproper.
    error
        ``max |log |V(jw)| - log magnitude|`` over the grid.
    """

    weight: StateSpace
    error: float


def fit_magnitude(frequencies: FloatArray, magnitude: FloatArray) -> WeightFit:
    """Fit ``|V(jw)|`` to a positive magnitude by sections of first and second order.

    Every section has poles and zeros in the open left half plane, so that V is stable and
    minimum-phase by construction. Sections are added where the error is largest until it is
    negligible or stops falling.

    Parameters
    ----------
    frequencies
        w > 0, shape (f,), rad/s, ascending.
    magnitude
        Wanted ``|V(jw)|`` > 0, shape (f,).
    """
    target = np.log(magnitude)
    best = current = _Sections(gain=float((target.max() + target.min()) / 2), sections=())
    error = best.error(frequencies, target)
    stalled = 0
    while error > _GOOD_ENOUGH and current.order < _MAX_ORDER and stalled < _PATIENCE:
        current, trial_error = _better_extension(current, frequencies, target)
        stalled = 0 if trial_error <= _WORTH_A_SECTION * error else stalled + 1
        if stalled == 0:
            best, error = current, trial_error
    return WeightFit(weight=best.realisation(), error=error)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sections:
    gain: float
    sections: tuple[FloatArray, ...]

    @property
    def order(self) -> int:
        return sum(section.size // 2 for section in self.sections)

    @property
    def vector(self) -> FloatArray:
        return np.concatenate([[self.gain], *self.sections])

    def with_vector(self, vector: FloatArray) -> _Sections:
        ends = np.cumsum([section.size for section in self.sections])
        return _Sections(gain=float(vector[0]), sections=tuple(np.split(vector[1:], ends)[:-1]))

    def log_magnitude(self, frequencies: FloatArray) -> FloatArray:
        total = np.full(frequencies.size, self.gain)
        for section in self.sections:
            half = section.size // 2
            total += _factor(frequencies, section[:half]) - _factor(frequencies, section[half:])
        return total

    def slopes(self, frequencies: FloatArray) -> FloatArray:
        """Derivatives of `log_magnitude` by the entries of `vector`."""
        columns = [np.ones((frequencies.size, 1))]
        for section in self.sections:
            half = section.size // 2
            columns.append(_factor_slopes(frequencies, section[:half]))
            columns.append(-_factor_slopes(frequencies, section[half:]))
        return np.hstack(columns)

    def error(self, frequencies: FloatArray, target: FloatArray) -> float:
        return float(np.max(np.abs(self.log_magnitude(frequencies) - target)))

    def realisation(self) -> StateSpace:
        system = StateSpace.constant(float(np.exp(self.gain)))
        for section in self.sections:
            system = _series(system, _section(np.exp(section)))
        return system


def _better_extension(
    old: _Sections, frequencies: FloatArray, target: FloatArray
) -> tuple[_Sections, float]:
    """One section more: of first order if it does nearly as well as one of second order."""
    first = _extended(old, _FIRST, frequencies, target)
    first_error = first.error(frequencies, target)
    if first_error <= _GOOD_ENOUGH:
        return first, first_error
    second = _extended(old, _SECOND, frequencies, target)
    second_error = second.error(frequencies, target)
    if first_error <= _NEARLY_AS_WELL * second_error:
        return first, first_error
    return second, second_error


def _extended(old: _Sections, kind: int, frequencies: FloatArray, target: FloatArray) -> _Sections:
    # Half as long to load as all else that a controller needs.
    import scipy.optimize

    residual = target - old.log_magnitude(frequencies)
    centre = np.log(frequencies[int(np.argmax(np.abs(residual - np.median(residual))))])
    start = {
        _FIRST: np.array([centre - 0.1, centre + 0.1]),
        _SECOND: np.array([centre, -0.5, centre, -0.4]),
    }[kind]
    new = _Sections(gain=old.gain, sections=(*old.sections, start))
    corners = np.log(frequencies[[0, -1]])
    low, high = [-np.inf], [np.inf]
    for section in new.sections:
        damped = section.size == _SECOND
        low += [corners[0], -6.0] * 2 if damped else [corners[0]] * 2
        high += [corners[1], 0.0] * 2 if damped else [corners[1]] * 2
    result = scipy.optimize.least_squares(
        lambda x: new.with_vector(x).log_magnitude(frequencies) - target,
        np.clip(new.vector, np.array(low) + 1e-6, np.array(high) - 1e-6),
        jac=lambda x: new.with_vector(x).slopes(frequencies),
        bounds=(low, high),
        max_nfev=50,
    )
    return new.with_vector(result.x)


def _factor(frequencies: FloatArray, parameters: FloatArray) -> FloatArray:
    """``log |1 + corner / s|`` or ``log |1 + 2 damping corner / s + corner^2 / s^2|``."""
    values = np.exp(parameters)
    ratio = (values[0] / frequencies) ** 2
    if values.size == 1:
        return np.asarray(0.5 * np.log1p(ratio))
    return np.asarray(0.5 * np.log((ratio - 1) ** 2 + 4 * values[1] ** 2 * ratio))


def _factor_slopes(frequencies: FloatArray, parameters: FloatArray) -> FloatArray:
    """Derivatives of `_factor` by its parameters, a column each."""
    values = np.exp(parameters)
    ratio = (values[0] / frequencies) ** 2
    if values.size == 1:
        return np.asarray((ratio / (1 + ratio))[:, None])
    damped = 4 * values[1] ** 2 * ratio
    square = (ratio - 1) ** 2 + damped
    return np.column_stack([(2 * ratio * (ratio - 1) + damped) / square, damped / square])


def _section(values: FloatArray) -> StateSpace:
    if values.size == _FIRST:
        zero, pole = values
        return StateSpace(
            a=np.array([[-pole]]),
            b=np.array([[1.0]]),
            c=np.array([[zero - pole]]),
            d=np.eye(1),
        )
    zero, zero_damping, pole, pole_damping = values
    return StateSpace(
        a=np.array([[0.0, pole], [-pole, -2 * pole_damping * pole]]),
        b=np.array([[0.0], [1.0]]),
        c=np.array(
            [[(zero**2 - pole**2) / pole, 2 * (zero_damping * zero - pole_damping * pole)]]
        ),
        d=np.eye(1),
    )


def _series(first: StateSpace, second: StateSpace) -> StateSpace:
    a = scipy.linalg.block_diag(first.a, second.a)
    a[first.order :, : first.order] = second.b @ first.c
    return StateSpace(
        a=a,
        b=np.vstack([first.b, second.b @ first.d]),
        c=np.hstack([second.d @ first.c, second.c]),
        d=second.d @ first.d,
    )
