"""Signals of a run that follow from its events: references, estimates, sector ratio."""

from __future__ import annotations

import math

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.scenario.reference_bounds import threshold_step
from dvs_simulation.exact.loop import ClosedLoop
from dvs_simulation.exact.trajectory import Trajectory
from dvs_simulation.judging.measures import Judgement, largest, output_error, sector_ratio


def counts_at(
    loop: ClosedLoop, run: Trajectory, times: FloatArray
) -> tuple[np.ndarray, np.ndarray]:
    """N_i and the sign of the reference of every pixel, after the events of each instant.

    Parameters
    ----------
    loop
        The loop that ran.
    run
        Its events.
    times
        Instants, ascending, shape (k,), s.

    Returns
    -------
    tuple of ndarray
        Counts and signs, each of shape (k, r).
    """
    shape = (len(times), loop.pixel_count)
    counts = np.zeros(shape, dtype=np.int64)
    signs = np.ones(shape, dtype=np.int8)
    if loop.photoreceptor == 'signed_log':
        signs[:] = np.where(loop.initial_luminosity() < 0, -1, 1)
    for pixel in np.unique(run.event_pixel):
        mine = run.event_pixel == pixel
        passed = np.searchsorted(run.event_time[mine], times, side='right')
        total = np.concatenate([[0], np.cumsum(run.event_polarity[mine], dtype=np.int64)])
        counts[:, pixel] = total[passed]
        seen = passed > 0
        signs[seen, pixel] = run.event_sign[mine][passed[seen] - 1]
    return counts, signs


def estimates_at(loop: ClosedLoop, run: Trajectory, times: FloatArray) -> FloatArray:
    """Estimates ``z_i = s_i lambdabar_i rho^(-N_i)``, shape (k, r) (paper, eqs. 12 and 13).

    Parameters
    ----------
    loop
        The loop that ran.
    run
        Its events.
    times
        Instants, ascending, shape (k,), s.
    """
    counts, signs = counts_at(loop, run, times)
    growth = np.exp(counts * threshold_step(loop.event_threshold, loop.log_base))
    return np.asarray(signs * loop.sector().initial_estimate * growth)


def luminosities(loop: ClosedLoop, states: FloatArray) -> FloatArray:
    """y_i for every state, shape (k, r).

    Parameters
    ----------
    loop
        The loop that ran.
    states
        x in original coordinates, shape (k, n).
    """
    return (states @ loop.model.gradient)[:, None] + loop.scene.brightness_offsets


def sector_ratios(loop: ClosedLoop, run: Trajectory) -> FloatArray:
    """``|z - y| / (delta_z |y|)`` at the samples of a run, shape (k, r); at most 1 (Lemma 4).

    Not a number inside the dead band of a `signed_log` pixel, which Lemma 4 does not cover.

    Parameters
    ----------
    loop
        The loop that ran.
    run
        Run with samples.
    """
    return sector_ratio(
        luminosities(loop, run.states),
        estimates_at(loop, run, run.sample_time),
        error_bound=loop.sector().error_bound,
        dead_band=loop.dead_band if loop.photoreceptor == 'signed_log' else 0.0,
    )


def judged(
    loop: ClosedLoop, run: Trajectory, *, tolerance: float, output_tolerance: float = math.inf
) -> Judgement:
    """What decides on a run with samples and a tail; its error is bounded at every instant.

    Parameters
    ----------
    loop
        The loop that ran.
    run
        What came out.
    tolerance
        eps.
    output_tolerance
        Tolerance of ``|c'(x - x_d)|``, which is looked at in the samples of the tail.
    """
    settled = run.states[run.sample_time >= (run.tail.start if run.tail else 0.0)]
    outputs = output_error(settled, loop.equilibrium, loop.model.output_vector)
    return Judgement(
        tolerance=tolerance,
        limsup_error=run.limsup_bound,
        output_tolerance=output_tolerance,
        limsup_output=float(outputs.max(initial=0.0)),
        sector_ratio_max=largest(sector_ratios(loop, run)),
    )
