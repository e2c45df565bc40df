"""Loops that the tests share."""

from __future__ import annotations

import math

import numpy as np

from dvs_common.scenario.model import PixelScene, PlantModel
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_hinf_controller.controller import LinearController
from dvs_simulation.exact import ClosedLoop
from dvs_simulation.sweep.random_loops import lqg_controller

OFFSETS = 0.01 * np.array(
    [[0, 0], [1, 0], [-1, 0], [-1, 1], [0, 1], [1, 1], [1, -1], [0, -1], [-1, -1]]
)


def paper_plant() -> PlantModel:
    """Plant of the paper's section IV."""
    return PlantModel(
        state_matrix=[[2, 10], [0, 5]],
        input_matrix=[[1], [1]],
        output_vector=np.array([2, 1]) / math.sqrt(5),
    )


def mirror_loop(
    pixels: int = 3,
    *,
    threshold: float = 0.1,
    offsets: np.ndarray | None = None,
    signed: bool = False,
    controller: LinearController | None = None,
    initial_reference: np.ndarray | None = None,
) -> ClosedLoop:
    """The mirror image of the paper's example, or the example itself if `signed`."""
    model = paper_plant()
    sign = -1 if signed else 1
    held = model.equilibrium([sign * 0.2321, -sign * 0.0928], tolerance=1e-2)
    start = held.state + 0.25
    offsets = OFFSETS[:pixels] if offsets is None else offsets
    scene = PixelScene.from_offsets(model, offsets, height=1, width=len(offsets))
    return ClosedLoop(
        model=model,
        equilibrium=held,
        scene=scene,
        controller=controller or lqg_controller(model, cost=0.01, noise=0.01),
        bounds=ReferenceBounds.around(scene.luminosity(model, start), 0.002),
        initial_state=start,
        event_threshold=threshold,
        initial_reference=initial_reference,
        photoreceptor='signed_log' if signed else 'log',
        dead_band=1e-4 if signed else 0.0,
    )


def stiff_controller(model: PlantModel, pole: float = -1e6) -> LinearController:
    """LQG whose output passes a fast roll-off, as near-optimal controllers have it."""
    base = lqg_controller(model, cost=0.01, noise=0.01)
    k = base.order
    return LinearController(
        state_matrix=np.block(
            [
                [base.state_matrix, np.zeros((k, 1))],
                [-pole * base.output_matrix, np.array([[pole]])],
            ]
        ),
        input_vector=np.append(base.input_vector, 0.0),
        output_matrix=np.array([[0.0] * k + [1.0]]),
        feedthrough=np.zeros(1),
    )


def single_pixel_loop(
    a: np.ndarray, c: np.ndarray, x0: np.ndarray, *, threshold: float, bounds: tuple[float, float]
) -> ClosedLoop:
    """Uncontrolled system seen by one pixel: a static controller of gain zero."""
    model = PlantModel(state_matrix=a, input_matrix=np.ones((len(a), 1)), output_vector=c)
    held = model.equilibrium(np.zeros(len(a)), tolerance=1e-9)
    return ClosedLoop(
        model=model,
        equilibrium=held,
        scene=PixelScene(brightness_offsets=[0.0], height=1, width=1),
        controller=LinearController(
            state_matrix=np.zeros((0, 0)),
            input_vector=np.zeros(0),
            output_matrix=np.zeros((1, 0)),
            feedthrough=np.zeros(1),
        ),
        bounds=ReferenceBounds(lower=[bounds[0]], upper=[bounds[1]]),
        initial_state=x0,
        event_threshold=threshold,
    )
