"""Controllers for event cameras: design, certified thresholds, and the controller that runs.

Examples
--------
Which event threshold is fine enough to hold the set-point, and which controller holds it?

>>> from dvs_common import Scenario
>>> from dvs_hinf_controller import DesignProblem, design_controller
>>> problem = DesignProblem.from_scenario(Scenario.from_values({}))  # config/mirror_r3.yaml
>>> design = design_controller(problem, method='structured')
>>> print(f'{design.figures.h_star:.3f} published, {design.figures.h_certified:.3f} certified')
0.159 published, 0.120 certified
"""

from __future__ import annotations

from dvs_common.lazy import lazy_exports

__getattr__, __all__ = lazy_exports(__name__, __file__)
