"""What h costs, as table and figure; it needs matplotlib, which takes long to load."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path

from dvs_common.drawing import Figure, drawing
from dvs_common.writing import whole_file, write_text
from dvs_hinf_controller.design.pareto import UNITS, ParetoPoint

COLUMNS = ('parameter', 'value', 'h_certified', 'h_star', 'fastest_pole', 'slowest_pole')


def save_pareto(points: Sequence[ParetoPoint], path: Path) -> Path:
    """Write table and figure; return the file of the figure.

    Parameters
    ----------
    points
        Of `pareto`.
    path
        CSV file; the figure lies beside it, as PNG.

    Raises
    ------
    WriteError
        If a file cannot be written.
    """
    text = io.StringIO()
    table = csv.writer(text, lineterminator='\n')
    table.writerow(COLUMNS)
    table.writerows([getattr(point, name) for name in COLUMNS] for point in points)
    write_text(path, text.getvalue())
    picture = path.with_suffix('.png')
    with drawing(), whole_file(picture) as draft:
        _figure(points).savefig(draft, format='png', dpi=120)
    return picture


def _figure(points: Sequence[ParetoPoint]) -> Figure:
    figure = Figure(figsize=(11, 4), layout='constrained')
    panels = figure.subplots(1, len(UNITS), sharey=True)
    for axes, (name, unit) in zip(panels, UNITS.items(), strict=True):
        mine = [point for point in points if point.parameter == name]
        values = [point.value for point in mine]
        for attribute, style, text in (
            ('h_certified', 'o-', 'h_certified (guaranteed)'),
            ('h_star', 's--', 'h* (published)'),
        ):
            heights = [_shown(getattr(point, attribute)) for point in mine]
            axes.plot(values, heights, style, label=text)
        axes.set_xscale('log' if name != 'loop_latency' else 'linear')
        axes.set(xlabel=f'{name} [{unit}]')
        axes.grid(alpha=0.3, which='both')
    panels[0].set(ylabel='event threshold h [log_b units]')
    panels[0].set_ylim(bottom=0)
    panels[-1].legend(frameon=False)
    return figure


def _shown(h: float) -> float:
    """None is drawn as 0, any is not drawn."""
    return math.nan if h == math.inf else max(h, 0.0)
