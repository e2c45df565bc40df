"""Ground floor of the suite: the problem, scenario files, messages and the base of every node.

Only `dvs_common.node` needs ROS; what is imported from here does not.

Examples
--------
Which constant input holds the set-point, and which luminosity does a pixel see there?

>>> from dvs_common import PixelScene, PlantModel
>>> model = PlantModel(
...     state_matrix=[[2.0, 10.0], [0.0, 5.0]],
...     input_matrix=[[1.0], [1.0]],
...     output_vector=[2 / 5**0.5, 1 / 5**0.5],
... )
>>> held = model.equilibrium([0.25, -0.1], tolerance=1e-6)
>>> held.feedforward.round(3)
array([0.5])
>>> scene = PixelScene.from_offsets(model, [[0.02, 0.0]], height=1, width=1)
>>> scene.luminosity(model, held.state).round(4)
array([0.1968])

A set-point that no input holds is refused, and the nearest one that can be held is named.

>>> model.equilibrium([0.25, 0.1], tolerance=1e-6)
Traceback (most recent call last):
...
dvs_common.errors.ParameterError: set_point = [0.25, 0.1]: is not stabilizable: ...
"""

from __future__ import annotations

from dvs_common import moved
from dvs_common.lazy import lazy_exports

__getattr__, __all__ = lazy_exports(__name__, __file__)

moved.install()
