#!/usr/bin/env python3
"""Node `plant_sim`: the MuJoCo cart-pole whose camera sees rendered frames."""

from functools import cached_property

from rendered import RenderedOptics  # isort: skip -- it chooses how mujoco renders

from cart_pole_node import CartPoleNode

from dvs_common.arrays import FloatArray
from dvs_common.node.spin import run_nodes


class RenderedNode(CartPoleNode):
    """The cart-pole and what its camera sees in a frame."""

    @cached_property
    def _optics(self) -> RenderedOptics:
        # Made where it is used: a context of OpenGL belongs to one thread.
        return RenderedOptics()

    def luminosity(self, state: FloatArray) -> FloatArray:
        """What the pixels see in a rendered frame."""
        return self._optics.luminosity(state)


if __name__ == '__main__':
    raise SystemExit(run_nodes([RenderedNode]))
