"""Closed-loop magnitude and phase over frequency, one curve a design."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dvs_common.drawing import Figure, drawing
from dvs_common.errors import ParameterError
from dvs_common.writing import whole_file
from dvs_hinf_controller.analysis.mu import log_grid
from dvs_hinf_controller.design.design import Design
from dvs_hinf_controller.state_space import state_response

# Okabe and Ito's palette: told apart by every kind of colour vision.
_COLOURS = ('#0072B2', '#D55E00', '#009E73', '#CC79A7')


def save_bode_figure(designs: Sequence[Design], path: str | Path) -> None:
    """Draw ``||G||`` and the phase of ``T = c'G`` (paper, figure 7).

    Parameters
    ----------
    designs
        At least one, all for the same plant.
    path
        File to write; the ending decides the format.

    Raises
    ------
    ParameterError
        If the ending of the file is no format.
    WriteError
        If the file cannot be written.
    """
    for design in designs:
        design.problem.model.require_one_group('the Bode figure')
    try:
        with drawing(), whole_file(path) as draft:
            _bode_figure(designs).savefig(draft, dpi=120)
    except ValueError as error:
        raise ParameterError('figure', path, f'cannot be written: {error}') from None


def _bode_figure(designs: Sequence[Design]) -> Figure:
    figure = Figure(figsize=(8, 6.5), layout='constrained')
    magnitude, phase = figure.subplots(2, 1, sharex=True)
    loops = [state_response(design.problem.model, design.controller) for design in designs]
    frequencies = log_grid(np.concatenate([loop.poles() for loop in loops]))[1:]
    for design, loop, colour in zip(designs, loops, _COLOURS, strict=False):
        response = loop.response(frequencies)[:, :, 0]
        output = response @ design.problem.model.gradient
        gain = np.linalg.norm(response, axis=1)
        label = f'{design.method}: ||G||, mu = {design.figures.mu_upper:.4g}'
        magnitude.semilogx(frequencies, 20 * np.log10(gain), color=colour, label=label)
        magnitude.semilogx(
            frequencies, 20 * np.log10(np.abs(output) + 1e-300), color=colour, ls=':', label='_'
        )
        phase.semilogx(frequencies, np.degrees(np.unwrap(np.angle(output))), color=colour)
    top = magnitude.get_ylim()[1]
    magnitude.set(
        ylabel='gain [dB, state per luminosity]',
        title="Closed loop from the estimation error w: to x (||G||, solid), to c'x (|T|, dotted)",
        ylim=(max(magnitude.get_ylim()[0], top - 60), top + 1),
    )
    magnitude.legend(frameon=False, fontsize=9)
    phase.set(xlabel='frequency [rad/s]', ylabel='phase of T [degrees]')
    for axes in (magnitude, phase):
        axes.grid(alpha=0.3, which='both')
    return figure
