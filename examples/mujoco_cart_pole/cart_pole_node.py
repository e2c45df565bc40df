#!/usr/bin/env python3
"""Node `plant_sim`: the MuJoCo cart-pole in place of the linear plant."""

import cart_pole

from dvs_common import Scenario
from dvs_common.arrays import FloatArray
from dvs_common.node.spin import run_nodes
from dvs_plant_sim.plant_node import PlantNode


class CartPoleNode(PlantNode):
    """The cart-pole and what its camera sees."""

    def make_plant(self, scenario: Scenario) -> cart_pole.CartPole:
        """Cart-pole at the scenario's initial state."""
        return cart_pole.CartPole(scenario.initial_state)

    def luminosity(self, state: FloatArray) -> FloatArray:
        """What the pixels see of the ceiling."""
        return cart_pole.luminosity(state)


if __name__ == '__main__':
    raise SystemExit(run_nodes([CartPoleNode]))
