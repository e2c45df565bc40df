"""One look for all figures: colours that every eye can tell apart, quiet axes, units in labels."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.drawing import Axes, Figure, drawing
from dvs_common.writing import whole_file

# Okabe and Ito (2008), in the order of use; tested for all common colour vision deficiencies.
BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY = (
    '#0072B2',
    '#D55E00',
    '#009E73',
    '#E69F00',
    '#CC79A7',
    '#56B4E9',
)
BLACK, GREY, PALE = '#222222', '#7f7f7f', '#e6e6e6'
ON, OFF = VERMILION, BLUE

STYLE: dict[str, Any] = {
    'font.size': 10.5,
    'axes.titlesize': 11,
    'axes.titleweight': 'bold',
    'axes.titlelocation': 'left',
    'axes.labelsize': 10.5,
    'axes.spines.top': False,
    'axes.spines.right': False,
    'axes.edgecolor': '#444444',
    'axes.grid': True,
    'grid.color': '#dddddd',
    'grid.linewidth': 0.7,
    'axes.axisbelow': True,
    'legend.frameon': False,
    'legend.fontsize': 9.5,
    'lines.linewidth': 1.6,
    'savefig.facecolor': 'white',
    'mathtext.fontset': 'dejavusans',
}


def in_style() -> AbstractContextManager[None]:
    """Context in which figures are drawn and written in the common look."""
    return drawing(STYLE)


def new_figure(
    width: float = 7.2, height: float = 4.2, *, rows: int = 1, columns: int = 1, **options: Any
) -> tuple[Figure, Any]:
    """Figure and its axes (one, or an array of them).

    Parameters
    ----------
    width
        Inches.
    height
        Inches.
    rows
        Rows of axes.
    columns
        Columns of axes.
    **options
        Passed to `Figure.subplots`.
    """
    figure = Figure(figsize=(width, height), layout='constrained')
    return figure, figure.subplots(rows, columns, **options)


def save_figure(figure: Figure, path: Path, dpi: int) -> None:
    """Write a figure, whole or not at all; to be called `in_style`.

    Parameters
    ----------
    figure
        The figure.
    path
        File to write; the ending decides the format.
    dpi
        Dots an inch.
    """
    with whole_file(path) as draft:
        figure.savefig(draft, dpi=dpi)


def draw_tolerance(axes: Axes, tolerance: float) -> None:
    """Horizontal line at eps with its name beside it.

    Parameters
    ----------
    axes
        Axes of an error.
    tolerance
        eps.
    """
    axes.axhline(
        tolerance, color=BLACK, ls='--', lw=1.1, label=rf'tolerance $\epsilon$ = {tolerance:g}'
    )


def draw_ball(axes: Axes, centre: FloatArray, tolerance: float) -> None:
    """Set-point and the circle of the tolerance around it.

    Parameters
    ----------
    axes
        Axes of a phase portrait.
    centre
        x_d, its first two entries are used.
    tolerance
        eps.
    """
    angle = np.linspace(0, 2 * np.pi, 181)
    axes.plot(
        centre[0] + tolerance * np.cos(angle),
        centre[1] + tolerance * np.sin(angle),
        color=BLACK,
        ls='--',
        lw=1.1,
        label=rf'ball of radius $\epsilon$ = {tolerance:g}',
    )
    axes.plot(*centre[:2], '+', color=BLACK, ms=9, mew=1.5, label=r'set-point $x_d$')


def draw_events(axes: Axes, times: FloatArray, pixels: np.ndarray, polarities: np.ndarray) -> None:
    """Raster of events, ON above OFF in colour and shape.

    Parameters
    ----------
    axes
        Axes of time and pixel number.
    times
        Instants, s, shape (k,).
    pixels
        Pixel numbers, shape (k,).
    polarities
        +1 or -1, shape (k,).
    """
    for polarity, colour, marker, name in (
        (1, ON, '^', 'ON, polarity +1'),
        (-1, OFF, 'v', 'OFF, polarity −1'),
    ):
        chosen = polarities == polarity
        axes.plot(times[chosen], pixels[chosen], marker, color=colour, ms=3, mew=0, label=name)
