#!/usr/bin/env python3
"""Measures synthesis: growth with the pixels, and dkpy's D-K iteration on the same problem."""

from __future__ import annotations

import math
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import checkout  # noqa: F401
import numpy as np
from bench_rounds import figure

from dvs_common.scenario.model import PixelScene, PlantModel
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_hinf_controller.analysis.mu import mu_bounds
from dvs_hinf_controller.design.design import design_controller
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.state_space import StateSpace, state_response
from dvs_hinf_controller.synthesis.methods import METHODS
from dvs_hinf_controller.synthesis.one_pixel_plant import reduced_plant
from dvs_hinf_controller.synthesis.options import DesignOptions

REPEATS = 7
# dkpy does not limit the bandwidth of what it returns: compare mu at a small slack.
TIGHT = DesignOptions(gamma_slack=2e-5)


def paper_problem(height: int, width: int) -> DesignProblem:
    """Mirror image of the paper's example, seen by a regular pixel array."""
    model = PlantModel(
        state_matrix=np.array([[2.0, 10.0], [0.0, 5.0]]),
        input_matrix=np.ones((2, 1)),
        output_vector=np.array([2.0, 1.0]) / math.sqrt(5),
    )
    offsets = np.linspace(-0.01, 0.01, height * width) if height * width > 1 else np.zeros(1)
    scene = PixelScene(brightness_offsets=offsets, height=height, width=width)
    luminosity = scene.luminosity(model, np.array([0.4821, 0.1572]))
    return DesignProblem(
        model=model,
        equilibrium=model.equilibrium([0.2321, -0.0928], tolerance=1e-3),
        scene=scene,
        bounds=ReferenceBounds.around(luminosity, 0.002),
        tolerance=0.05,
        log_base=math.e,
    )


def cpu_seconds(work: Callable[[], Any]) -> tuple[float, Any]:
    """CPU time of one call, and what it returned."""
    start = time.process_time()
    result = work()
    return time.process_time() - start, result


def pixels_ratio(repeats: int) -> dict[str, float]:
    """CPU time of a structured design for 1280 x 720 pixels over that for one, best of some."""

    def best(problem: DesignProblem) -> float:
        def work() -> object:
            # A problem of its own: sums over the pixels are kept with it.
            return design_controller(replace(problem), method='structured')

        return min(cpu_seconds(work)[0] for _ in range(repeats))

    one, many = best(paper_problem(1, 1)), best(paper_problem(720, 1280))
    return {'design_pixels_ratio': many / one, 'design_seconds': one}


def design_times(repeats: int) -> dict[str, float]:
    """CPU seconds of a design by each of two methods: median of sizes from 1 to 1280 x 720."""
    figures: dict[str, float] = {}
    for method in ('structured', 'certified'):
        times = []
        for height, width in ((1, 1), (3, 3), (64, 64), (720, 1280)):
            problem = paper_problem(height, width)

            def work(problem: DesignProblem = problem, method: str = method) -> object:
                return design_controller(replace(problem), method=method)

            times.append(statistics.median(cpu_seconds(work)[0] for _ in range(repeats)))
        figures |= figure(f'design_{method}_s', times)
    return figures


def versus_dkpy(repeats: int, frequencies: int = 61) -> dict[str, float]:
    """CPU time of dkpy's D-K iteration on the reduced problem over ours, and both mu.

    dkpy runs with the settings of its own example (three iterations, fits of order 4, 61
    frequencies) and SLICOT's synthesis, which is the fastest that it offers. Its frequencies are
    worked on in this process: in processes of their own, as by default, their time is not seen.
    """
    import control
    import dkpy

    problem = paper_problem(1, 1)
    model, method = problem.model, METHODS['structured']

    def ours_once() -> tuple[float, Any]:
        return cpu_seconds(lambda: method.synthesize(problem, TIGHT))

    seconds, ours = min((ours_once() for _ in range(repeats)), key=lambda pair: pair[0])
    p = reduced_plant(model, input_cost=1e-2, process_noise=1e-2)
    n = model.state_count
    # Uncertainty c'x -> w, performance x -> w, with u and noise as regularising performance.
    generalized = control.ss(
        p.a,
        np.hstack([np.zeros((n, 1)), p.b1, p.b2]),
        np.vstack([model.gradient[None, :], p.c1, p.c2]),
        np.block(
            [
                [np.zeros((1, 1 + n + 1)), np.zeros((1, 1))],
                [np.zeros((n + 1, 1 + n + 1)), p.d12],
                [np.ones((1, 1)), p.d21, np.zeros((1, 1))],
            ]
        ),
    )
    iteration = dkpy.DkIterFixedOrder(
        controller_synthesis=dkpy.HinfSynSlicot(),
        structured_singular_value=dkpy.SsvLmiBisection(n_jobs=1),
        d_scale_fit=dkpy.DScaleFitSlicot(),
        n_iterations=3,
        fit_order=4,
    )
    blocks = [dkpy.ComplexFullBlock(1, 1), dkpy.ComplexFullBlock(n + 1, n + 1)]
    theirs_seconds, outcome = cpu_seconds(
        lambda: iteration.synthesize(
            generalized,
            n_y=1,
            n_u=1,
            omega=np.logspace(-2, 3, frequencies),
            block_structure=blocks,
        )
    )
    theirs = outcome[0]
    b2 = model.input_matrix
    bk, c = np.asarray(theirs.B), model.gradient[None, :]
    dk = np.asarray(theirs.D)
    loop = StateSpace(
        a=np.block(
            [
                [model.state_matrix + b2 @ dk @ c, b2 @ np.asarray(theirs.C)],
                [bk @ c, np.asarray(theirs.A)],
            ]
        ),
        b=np.vstack([b2 @ dk, bk]),
        c=np.hstack([np.eye(n), np.zeros((n, theirs.nstates))]),
        d=np.zeros((n, 1)),
    )
    return {
        'design_vs_dkpy': theirs_seconds / seconds,
        'design_mu': mu_bounds(state_response(model, ours), model.gradient, rtol=1e-4).upper,
        'dkpy_mu': mu_bounds(loop, model.gradient, rtol=1e-4).upper,
        'dkpy_seconds': theirs_seconds,
    }


def measure(quick: bool = False) -> dict[str, float]:
    """Run the benchmark; return its figures by name, those of dkpy only where it is installed.

    Parameters
    ----------
    quick
        Once instead of several times.
    """
    repeats = 1 if quick else REPEATS
    figures = pixels_ratio(repeats) | design_times(min(repeats, 3))
    try:
        figures |= versus_dkpy(repeats, 13) if quick else versus_dkpy(repeats)
    except ImportError as error:
        print(f'{error.name} is not installed: no comparison with dkpy', file=sys.stderr)
    for name, value in figures.items():
        print(f'{name:22} {value:.4g}')
    return figures
