"""The closed loop as one value: plant, scene, sensor, estimator and controller."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from dvs_common.arrays import FloatArray, finite_array
from dvs_common.errors import ParameterError
from dvs_common.scenario.model import Equilibrium, PixelScene, PlantModel
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_common.scenario.scenario import Scenario
from dvs_event_camera.pixels.references import initial_references
from dvs_hinf_controller.analysis.sector import Sector, sector
from dvs_hinf_controller.controller import LinearController


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosedLoop:
    """The hybrid automaton of the paper (figure "hybridAutomaton2") with everything that it needs.

    Parameters
    ----------
    model
        Plant.
    equilibrium
        Set-point x_d and the constant input that holds it.
    scene
        What the pixels see.
    controller
        K, driven by the mean of the zbar_i; it starts at rest.
    bounds
        m_i and M_i, what the estimator knows of the references.
    initial_state
        x(0) in original coordinates, shape (n,).
    initial_reference
        ``|q_i(0)|``, shape (r,), between the bounds; default the first luminosity.
    event_threshold
        h > 0, in logarithms to the base b.
    log_base
        b > 1.
    photoreceptor
        ``log`` for a real sensor, which needs y > 0; ``signed_log`` for the paper's example,
        where y changes its sign and the sign of the reference travels with the events.
    load
        Constant disturbance of every input, shape (m,); None for none.
    output_disturbance
        What `scene` adds to every luminosity without the controller's knowledge.
    error_weights
        Diagonal of W in the error ``||W (x - x_d)||``, shape (n,); None for all 1.
    dead_band
        ``signed_log`` only: the pixel is silent inside ``|y| < dead_band``.

    Raises
    ------
    ParameterError
        If sizes do not fit, the scene has a brightness profile, a reference breaks assumption
        (A1), or a luminosity is not positive with a ``log`` photoreceptor; the message names the
        pixel.
    """

    model: PlantModel
    equilibrium: Equilibrium
    scene: PixelScene
    controller: LinearController
    bounds: ReferenceBounds
    initial_state: FloatArray
    event_threshold: float
    log_base: float = math.e
    initial_reference: FloatArray | None = None
    photoreceptor: str = 'log'
    dead_band: float = 0.0
    error_weights: FloatArray | None = None
    load: FloatArray | None = None
    output_disturbance: float = 0.0

    def __post_init__(self) -> None:
        """Check sizes and assumption (A1); freeze the arrays."""
        self.model.require_one_group('the exact simulation')
        state = finite_array('initial_state', self.initial_state, ndim=1)
        object.__setattr__(self, 'initial_state', state)
        self._check_sizes()
        self._check_photoreceptor()
        if self.scene.profile is not None:
            raise ParameterError(
                'brightness_profile',
                f'{self.scene.profile.positions.size} knots',
                'is not simulated exactly, where luminosity is a straight line: use --sampled',
            )
        self.sector()
        y = self.initial_luminosity()
        reference = np.abs(y) if self.initial_reference is None else self.initial_reference
        reference = finite_array('initial_reference', reference, ndim=1)
        object.__setattr__(self, 'initial_reference', reference)
        self._check_reference(y)

    @classmethod
    def from_scenario(cls, scenario: Scenario, controller: LinearController) -> ClosedLoop:
        """Loop that a scenario describes, closed by `controller`.

        Parameters
        ----------
        scenario
            Checked parameters; limits of commands, noise and sampling have no part in the
            automaton.
        controller
            K.

        Raises
        ------
        ParameterError
            If the parameters do not fit together.
        """
        model, scene = scenario.model, scenario.scene
        unknown = scenario.disturbance.output_disturbance
        if unknown:
            offsets = scene.brightness_offsets + unknown
            scene = replace(scene, brightness_offsets=offsets)
        luminosity = scene.luminosity(model, scenario.initial_state)
        bounds = scenario.reference_bounds(luminosity)
        return cls(
            model=model,
            equilibrium=scenario.equilibrium,
            scene=scene,
            controller=controller,
            bounds=bounds,
            initial_state=scenario.initial_state,
            event_threshold=scenario.sensor.event_threshold,
            log_base=scenario.sensor.log_base,
            initial_reference=initial_references(
                scenario.sensor.initial_reference, bounds, luminosity, scenario.loop.seed
            ),
            photoreceptor=scenario.sensor.photoreceptor,
            dead_band=scenario.sensor.dead_band,
            error_weights=scenario.error_weights if scenario.objective.error_weights else None,
            load=scenario.constant_load,
            output_disturbance=unknown,
        )

    @property
    def pixel_count(self) -> int:
        """Number of pixels r."""
        return self.scene.pixel_count

    @property
    def reference(self) -> FloatArray:
        """``|q_i(0)|``, shape (r,)."""
        assert self.initial_reference is not None
        return self.initial_reference

    def initial_luminosity(self) -> FloatArray:
        """y_i(0), shape (r,)."""
        return self.scene.luminosity(self.model, self.initial_state)

    def set_point_luminosity(self) -> FloatArray:
        """``D_i = c'(x_d + dx_i)``, shape (r,): what the pixels should see at the set-point."""
        seen = self.scene.luminosity(self.model, self.equilibrium.state)
        return seen - self.output_disturbance

    def sector(self) -> Sector:
        """Constants of the estimator (Lemmas 1 and 4)."""
        return sector(self.bounds, event_threshold=self.event_threshold, log_base=self.log_base)

    def with_threshold(self, event_threshold: float) -> ClosedLoop:
        """Same loop with another h.

        Parameters
        ----------
        event_threshold
            h > 0.
        """
        return replace(self, event_threshold=event_threshold)

    def _check_sizes(self) -> None:
        n, m, r = self.model.state_count, self.model.input_count, self.pixel_count
        if self.initial_state.size != n:
            raise ParameterError(
                'initial_state', self.initial_state.tolist(), f'must have {n} entries'
            )
        if self.equilibrium.state.size != n:
            raise ParameterError(
                'equilibrium', self.equilibrium.state.tolist(), f'must have {n} entries'
            )
        if self.controller.input_count != m:
            raise ParameterError(
                'controller',
                self.controller.input_count,
                f'must drive the {m} inputs of the plant',
            )
        if self.bounds.lower.size != r:
            raise ParameterError(
                'reference_lower', self.bounds.lower.size, f'must have {r} entries, one a pixel'
            )

    def _check_photoreceptor(self) -> None:
        if self.photoreceptor not in ('log', 'signed_log'):
            raise ParameterError(
                'photoreceptor', self.photoreceptor, "must be 'log' or 'signed_log'"
            )
        if self.photoreceptor == 'signed_log' and not 0 < self.dead_band < math.inf:
            raise ParameterError(
                'dead_band', self.dead_band, 'must be > 0 with a signed_log photoreceptor'
            )

    def _check_reference(self, y: FloatArray) -> None:
        q = self.reference
        if q.size != self.pixel_count:
            raise ParameterError(
                'initial_reference', q.size, f'must have {self.pixel_count} entries, one a pixel'
            )
        if self.photoreceptor == 'log' and (bad := np.flatnonzero(y <= 0)).size:
            i = int(bad[0])
            raise ParameterError(
                'initial_state',
                self.initial_state.tolist(),
                f'gives pixel {i} the luminosity {y[i]:.6g}; a log photoreceptor needs y > 0',
            )
        outside = (q < self.bounds.lower) | (q > self.bounds.upper)
        if outside.any():
            i = int(np.flatnonzero(outside)[0])
            raise ParameterError(
                'initial_reference',
                float(q[i]),
                f'must lie in [{self.bounds.lower[i]:.6g}, {self.bounds.upper[i]:.6g}] '
                f'(pixel {i}; paper, A1)',
            )
        seen = np.maximum(np.abs(y), self._band())
        distance = np.abs(np.log(seen) - np.log(q)) / math.log(self.log_base)
        if (bad := np.flatnonzero(distance >= self.event_threshold)).size:
            i = int(bad[0])
            raise ParameterError(
                'initial_reference',
                float(q[i]),
                f'lies {distance[i]:.6g} >= event_threshold from the first luminosity '
                f'{y[i]:.6g}: pixel {i} would fire at t = 0 (paper, A1)',
            )

    def _band(self) -> float:
        return self.dead_band if self.photoreceptor == 'signed_log' else 0.0
