"""What a design answers: plant, set-point, pixels, what is known of q(0), tolerance and base."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.errors import ParameterError
from dvs_common.scenario.model import Equilibrium, PixelScene, PlantModel
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_common.scenario.scenario import Scenario
from dvs_hinf_controller.operation import Operation
from dvs_hinf_controller.pixel_sums import PixelSums, pixel_sums
from dvs_hinf_controller.sector_means import SeenPixels
from dvs_hinf_controller.sensor_uncertainty import SensorUncertainty


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignProblem:
    """Regulate ``x`` to within `tolerance` of the set-point by events (paper, Problem 1).

    Parameters
    ----------
    model
        Plant and brightness gradient.
    equilibrium
        Stabilizable set-point x_d and the input that holds it.
    scene
        Brightness offsets ``c'dx_i`` of the r pixels.
    bounds
        m and M of every pixel; m = M where q(0) is known.
    tolerance
        eps > 0: wanted bound on ``||x - x_d||`` as time goes to infinity, in the unit of x.
    log_base
        b > 1.
    error_weights
        W >= 0, shape (n,): the error is ``||W (x - x_d)||``; 0 for a free state, None for all 1.
    output_tolerance
        Wanted bound on ``|c'(x - x_d)|`` besides; infinite for none.
    settling_time
        Time within which every closed-loop pole decays to 2 %, s; infinite for no constraint.
    operation
        How the loop runs and what acts on it; None for the continuous loop with nothing but the
        error of the estimate.
    initial_state
        Start of the run, shape (n,), whose transient is bounded; None for none.

    Raises
    ------
    ParameterError
        If a size or range does not fit.
    """

    model: PlantModel
    equilibrium: Equilibrium
    scene: PixelScene
    bounds: ReferenceBounds
    tolerance: float
    log_base: float
    error_weights: FloatArray | None = None
    output_tolerance: float = math.inf
    settling_time: float = math.inf
    operation: Operation | None = None
    initial_state: FloatArray | None = None
    _pixels: PixelSums | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check sizes and ranges."""
        if self.equilibrium.state.size != self.model.state_count:
            raise ParameterError(
                'set_point',
                self.equilibrium.state.tolist(),
                f'must have {self.model.state_count} entries',
            )
        if self.bounds.lower.size != self.scene.pixel_count:
            raise ParameterError(
                'reference_lower',
                self.bounds.lower.shape,
                f'must have one entry for each of the {self.scene.pixel_count} pixels',
            )
        groups = np.unique(self.scene.groups) if self.scene.groups is not None else [0]
        if not np.array_equal(groups, np.arange(self.model.group_count)):
            raise ParameterError(
                'pixel_groups',
                [int(group) for group in groups],
                f'must be the {self.model.group_count} rows of output_vector, each seen by a '
                'pixel',
            )
        if not 0 < self.tolerance < math.inf:
            raise ParameterError('tolerance', self.tolerance, 'must be > 0 and finite')
        if not 1 < self.log_base < math.inf:
            raise ParameterError('log_base', self.log_base, 'must be > 1 and finite')

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> DesignProblem:
        """Problem that a scenario poses to a controller, which sees no luminosity.

        A brightness profile is replaced by a line through the luminosity at the set-point; what
        lies between them is part of the operation.

        Parameters
        ----------
        scenario
            Checked parameters.

        Raises
        ------
        ParameterError
            If parameters do not fit together or the set-point is not stabilizable.
        """
        model, scene = scenario.model, scenario.scene
        model.require_stabilizable()
        model.require_detectable()
        held, line = scenario.equilibrium, scenario.linearisation
        plants = [model, *scenario.further_plants]
        if scene.profile is not None:
            scene = scene.straightened(model, held.state, line.slope)
            plants = [replace(one, output_vector=line.slope * one.output_vector) for one in plants]
        return cls(
            model=plants[0],
            equilibrium=held,
            scene=scene,
            bounds=scenario.model_reference_bounds,
            tolerance=scenario.objective.tolerance,
            log_base=scenario.sensor.log_base,
            error_weights=scenario.error_weights if scenario.objective.error_weights else None,
            output_tolerance=scenario.output_tolerance * abs(line.slope),
            settling_time=scenario.objective.settling_time or math.inf,
            operation=Operation(
                sampling_period=scenario.loop.sampling_period,
                latency=scenario.promise.loop_latency,
                latency_jitter=scenario.promise.loop_latency_jitter,
                disturbance_bound=scenario.disturbance_bound,
                constant_load=scenario.constant_load_bound,
                output_disturbance=scenario.promise.output_disturbance_bound,
                further_plants=tuple(plants[1:]),
                model_uncertainty=scenario.promise.model_uncertainty,
                linearisation=line,
                sensor=SensorUncertainty.of_scenario(scenario),
            ),
            initial_state=scenario.initial_state,
        )

    def sees_all_groups(self, chosen: NDArray[np.bool_]) -> bool:
        """Whether some of the pixels leave one of every pixel group.

        Parameters
        ----------
        chosen
            Pixels that stay, shape (r,).
        """
        groups = range(self.model.group_count)
        return all(chosen[self.scene.pixels_of(one)].any() for one in groups)

    def of_pixels(self, chosen: NDArray[np.bool_]) -> DesignProblem:
        """The same problem with the mean over some of the pixels only, as if no other were there.

        Parameters
        ----------
        chosen
            Pixels that stay, shape (r,); at least one.

        Raises
        ------
        ParameterError
            If a pixel group has none left.
        """
        if chosen.all():
            return self
        groups = self.scene.groups
        for group in range(self.model.group_count):
            if not chosen[self.scene.pixels_of(group)].any():
                rule = f'must leave a pixel of pixel group {group}'
                raise ParameterError('pixel_mask', np.flatnonzero(~chosen).tolist(), rule)
        scene = PixelScene(
            brightness_offsets=self.scene.brightness_offsets[chosen],
            height=1,
            width=int(np.count_nonzero(chosen)),
            groups=None if groups is None else groups[chosen],
        )
        bounds = ReferenceBounds(lower=self.bounds.lower[chosen], upper=self.bounds.upper[chosen])
        return replace(self, scene=scene, bounds=bounds)

    @property
    def continuous(self) -> DesignProblem:
        """The same problem for the continuous loop of the paper, nothing else acting on it."""
        return self.operated(None)

    def operated(self, operation: Operation | None) -> DesignProblem:
        """The same problem for another operation, with the sums over its pixels.

        Parameters
        ----------
        operation
            How the loop runs and what acts on it; None for the continuous loop.
        """
        other = replace(self, operation=operation)
        object.__setattr__(other, '_pixels', self.pixels)
        return other

    def in_error_norm(self, states: FloatArray) -> FloatArray:
        """``W x``, whose norm is the error.

        Parameters
        ----------
        states
            x, shape (n, ...).
        """
        if self.error_weights is None:
            return states
        return np.asarray((self.error_weights * states.T).T)

    @property
    def least_decay(self) -> float:
        """Least decay rate of a closed-loop pole that settles in time, 1/s."""
        return math.log(50) / self.settling_time

    @property
    def set_point_luminosity(self) -> FloatArray:
        """``D_i = c'(x_d + dx_i)``, shape (r,): luminosity at the set-point (paper, eq. 22)."""
        return self.scene.luminosity(self.model, self.equilibrium.state)

    @property
    def group_scales(self) -> FloatArray:
        """``sqrt(r / r_j)`` of every pixel group with r_j of the r pixels, shape (k,)."""
        r, groups = self.scene.pixel_count, range(self.model.group_count)
        return np.sqrt([r / self.scene.pixels_of(one).size for one in groups])

    @property
    def pixels(self) -> PixelSums:
        """Sums over the pixels, taken once."""
        if self._pixels is None:
            sums = pixel_sums(
                SeenPixels(
                    scene=self.scene,
                    model=self.model,
                    state=self.equilibrium.state,
                    bounds=self.bounds,
                )
            )
            object.__setattr__(self, '_pixels', sums)
            return sums
        return self._pixels

    @property
    def rms_luminosity(self) -> float:
        """``||D|| / sqrt(r)`` (paper, Theorem 1)."""
        return self.pixels.rms

    @property
    def mean_luminosity(self) -> float:
        """``Dbar = mean |D_i|``: what reaches a controller that acts on the mean."""
        return self.pixels.mean

    @property
    def worst_reference_ratio(self) -> float:
        """``min_i m_i / M_i`` (paper, Theorem 2)."""
        return self.pixels.worst_ratio


def unmasked(pixel_count: int, masked: Sequence[int]) -> NDArray[np.bool_]:
    """Pixels that are not masked, shape (r,).

    Parameters
    ----------
    pixel_count
        r.
    masked
        Row-major numbers of the others.

    Raises
    ------
    ParameterError
        If a number is not that of a pixel, or no pixel is left.
    """
    for pixel in masked:
        if not 0 <= pixel < pixel_count:
            raise ParameterError(
                'pixel_mask', pixel, f'must be a pixel of the array, 0 to {pixel_count - 1}'
            )
    left = np.ones(pixel_count, bool)
    left[list(masked)] = False
    if not left.any():
        raise ParameterError('pixel_mask', list(masked), 'must leave a pixel of the array')
    return left
