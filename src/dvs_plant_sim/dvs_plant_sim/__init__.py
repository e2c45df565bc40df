"""Plants that are simulated exactly; `PlantNode` (needs ROS) samples any of them.

Examples
--------
One second of a linear plant with its input held, without a discretisation error:

>>> import numpy as np
>>> from dvs_common import PlantModel
>>> from dvs_plant_sim import Plant
>>> model = PlantModel(state_matrix=[[-1.0]], input_matrix=[[1.0]], output_vector=[1.0])
>>> plant = Plant(model, initial_state=np.array([1.0]), period_ns=1_000_000)
>>> plant.advance(10**9, np.array([0.0]))
>>> plant.state.round(6)
array([0.367879])
"""

from __future__ import annotations

from dvs_common.lazy import lazy_exports

__getattr__, __all__ = lazy_exports(__name__, __file__)
