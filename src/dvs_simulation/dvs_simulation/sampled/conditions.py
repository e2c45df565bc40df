"""What acts on one sampled run beside its scenario: a start, a plant in error, pushes, delays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.errors import ParameterError
from dvs_common.scenario.model import PlantModel


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Conditions:
    """Conditions of a run of N periods; what is None is as the scenario has it.

    Parameters
    ----------
    plant
        The true plant, of the same sizes.
    initial_state
        x(0), shape (n,).
    first_reference
        ``|q(0)|``, shape (r,), within the bounds of the references.
    disturbance
        Added to the input in every period, shape (N, m).
    latencies_ns
        Time from a sample to the moment its command acts, ns, >= 0, shape (N + 1,). A command
        never acts before one of an earlier sample. Until the first one acts the plant has the
        input that holds the set-point.
    lost
        Samples whose packet the controller never gets, shape (N + 1,): it makes no command then,
        and the plant holds the last one. Not the first.
    """

    plant: PlantModel | None = None
    initial_state: FloatArray | None = None
    first_reference: FloatArray | None = None
    disturbance: FloatArray | None = None
    latencies_ns: NDArray[np.int64] | None = None
    lost: NDArray[np.bool_] | None = None

    def check(self, *, samples: int, states: int, inputs: int) -> None:
        """Check the shapes.

        Parameters
        ----------
        samples
            N + 1.
        states
            n.
        inputs
            m.

        Raises
        ------
        ParameterError
            If an array has another shape, a latency is negative or the first packet is lost.
        """
        shapes = {
            'initial_state': (states,),
            'disturbance': (samples - 1, inputs),
            'latencies_ns': (samples,),
            'lost': (samples,),
        }
        for name, shape in shapes.items():
            array = getattr(self, name)
            if array is not None and np.shape(array) != shape:
                raise ParameterError(name, np.shape(array), f'must have the shape {shape}')
        if self.latencies_ns is not None and np.min(self.latencies_ns) < 0:
            raise ParameterError('latencies_ns', int(np.min(self.latencies_ns)), 'must be >= 0')
        if self.lost is not None and self.lost[0]:
            raise ParameterError('lost', True, 'must be false for the first sample')


AS_IN_SCENARIO = Conditions()
