"""Node `plant_sim`: the linear plant of the scenario, propagated exactly."""

from __future__ import annotations

from dvs_common.node.spin import run_nodes
from dvs_common.scenario.scenario import Scenario
from dvs_plant_sim.plant import Plant
from dvs_plant_sim.plant_node import PlantNode


class PlantSimNode(PlantNode):
    """The plant ``xdot = A x + B u``."""

    def make_plant(self, scenario: Scenario) -> Plant:
        """Plant of the scenario; see `PlantNode.make_plant`."""
        return Plant(
            scenario.model,
            initial_state=scenario.initial_state,
            period_ns=scenario.sampling_period_ns,
        )


def main() -> int:
    """Run the node until a signal or the end of its run."""
    return run_nodes([PlantSimNode])
