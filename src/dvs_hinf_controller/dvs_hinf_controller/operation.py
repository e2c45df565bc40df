"""How a loop runs and what it must bear: what a promise covers."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.errors import ParameterError
from dvs_common.scenario.brightness_profile import Linearisation
from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.sensor_uncertainty import SensorUncertainty


@dataclass(frozen=True, slots=True, kw_only=True)
class Operation:
    """The loop of the nodes, and everything that acts on it within known bounds.

    Parameters
    ----------
    sampling_period
        T > 0, s: a command is computed every T and held until the next one acts.
    latency
        Time from a sample to the instant at which its command acts, >= 0, s.
    latency_jitter
        Largest deviation from `latency` either way, s.
    disturbance_bound
        Largest disturbance of every input, shape (m,), in its unit; empty for none.
    constant_load
        Largest constant load on every input, shape (m,); empty for none.
    output_disturbance
        Largest constant error of every luminosity.
    further_plants
        Plants for which everything has to hold besides.
    model_uncertainty
        Largest relative error of every entry of A and B.
    linearisation
        How far the luminosity is from the straight line that the problem has in its place.
    sensor
        How far the sensor may be from an ideal one.
    interpolates
        Whether the sensor sees samples and interpolates the logarithm between them, as the
        simulated camera does; a real one sees luminosity at all times.

    Raises
    ------
    ParameterError
        If a value is out of range, or a command could act before the one of the sample before.
    """

    sampling_period: float
    latency: float = 0.0
    latency_jitter: float = 0.0
    disturbance_bound: FloatArray = field(default_factory=lambda: np.zeros(0))
    constant_load: FloatArray = field(default_factory=lambda: np.zeros(0))
    output_disturbance: float = 0.0
    further_plants: tuple[PlantModel, ...] = ()
    model_uncertainty: float = 0.0
    linearisation: Linearisation = field(default_factory=Linearisation)
    sensor: SensorUncertainty = field(default_factory=SensorUncertainty)
    interpolates: bool = True

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 0 < self.sampling_period < math.inf:
            raise ParameterError('sampling_period', self.sampling_period, 'must be > 0')
        for name in ('latency', 'latency_jitter'):
            if not 0 <= getattr(self, name) < math.inf:
                raise ParameterError(name, getattr(self, name), 'must be >= 0 and finite')
        if self.latency_jitter > min(self.latency, self.sampling_period / 2):
            raise ParameterError(
                'latency_jitter',
                self.latency_jitter,
                'must not exceed latency nor half of sampling_period',
            )
        if np.any(self.disturbance_bound < 0):
            raise ParameterError('disturbance_bound', self.disturbance_bound, 'must be >= 0')
        if not 0 <= self.model_uncertainty < 1:
            raise ParameterError('model_uncertainty', self.model_uncertainty, 'must lie in [0, 1)')
