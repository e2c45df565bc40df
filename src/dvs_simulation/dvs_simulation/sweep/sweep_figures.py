"""One figure for each study."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dvs_common.drawing import Figure
from dvs_simulation import plotting
from dvs_simulation.sweep.certificate import summarize_certificate
from dvs_simulation.sweep.own_plant import NAME, own_thresholds
from dvs_simulation.sweep.threshold import critical_thresholds

Rows = list[dict[str, str]]


def save_study_figure(name: str, rows: Rows, path: Path) -> None:
    """Draw the figure of a study.

    Parameters
    ----------
    name
        Name of the study.
    rows
        Rows of its table.
    path
        File to write.
    """
    draw = {
        'certificate': certificate_figure,
        'threshold': threshold_figure,
        'pixels': pixels_figure,
        'promise': promise_figure,
        NAME: own_plant_figure,
    }
    with plotting.in_style():
        plotting.save_figure(draw[name](rows), path, dpi=160)


def promise_figure(rows: Rows) -> Figure:
    """How much of the tolerance adversarial runs of the sampled loop used, at h = h_certified.

    Parameters
    ----------
    rows
        Rows of the study `promise`.
    """
    ratios = np.array([float(row['ratio']) for row in rows])
    figure = Figure(figsize=(6, 4), layout='constrained')
    axes = figure.subplots()
    axes.hist(ratios[np.isfinite(ratios)], bins=50, color=plotting.BLUE)
    axes.axvline(1.0, color=plotting.VERMILION, ls='--', lw=1, label='tolerance')
    axes.set(xlabel='limsup ||x - x_d|| / eps', ylabel='runs', yscale='log')
    axes.legend(frameon=False)
    return figure


def certificate_figure(rows: Rows) -> Figure:
    """How much of the tolerance is used below h_certified.

    Parameters
    ----------
    rows
        Rows of the study `certificate`.
    """
    figure, axes = plotting.new_figure(7.2, 4.0)
    completed = [row for row in rows if row['status'] == 'completed']
    share = np.array([float(row['h']) / float(row['h_certified']) for row in completed])
    ratio = np.array([float(row['ratio']) for row in completed])
    summary = summarize_certificate(rows)
    # Many small dots show where they lie densely; few are to be seen one by one.
    few = min(1.0, 2000 / max(len(share), 1))
    axes.scatter(
        share,
        ratio,
        s=3 + 12 * few,
        color=plotting.BLUE,
        alpha=0.25 + 0.5 * few,
        lw=0,
        rasterized=True,
    )
    axes.axhline(1, color=plotting.BLACK, ls='--', lw=1.1)
    axes.text(0.02, 1.02, 'guarantee', transform=axes.get_yaxis_transform(), va='bottom')
    axes.set(
        xlabel=r'event threshold $h \,/\, h_\mathrm{certified}$ [1]',
        ylabel=r'limsup $\|x - x_d\| \,/\, \epsilon$ [1]',
        ylim=(0, 1.15),
        title=f'{summary.runs:,} runs over {summary.plants} random plants: '
        f'{summary.violations} violations, tightest {summary.tightest:.3f}',
    )
    return figure


def threshold_figure(rows: Rows) -> Figure:
    """Simulated critical threshold beside the published and the certified one.

    Parameters
    ----------
    rows
        Rows of the study `threshold`.
    """
    lines = critical_thresholds(rows)
    figure, axes = plotting.new_figure(7.2, 4.2)
    place = np.arange(len(lines))
    for offset, values, colour, name in (
        (
            -0.27,
            [line.h_certified for line in lines],
            plotting.GREEN,
            r'guaranteed $h_\mathrm{certified}$',
        ),
        (0.0, [line.h_star for line in lines], plotting.BLUE, r'published $h^*$'),
        (
            0.27,
            [line.simulated for line in lines],
            plotting.VERMILION,
            r'first violation in simulation',
        ),
    ):
        bars = axes.bar(place + offset, values, 0.25, color=colour, label=name)
        axes.bar_label(bars, fmt='%.3f', fontsize=7.5, rotation=90, padding=3)
    axes.set_xticks(place, [f'r = {line.pixels}' for line in lines])
    for method in dict.fromkeys(line.method for line in lines):
        centre = float(np.mean([i for i, line in enumerate(lines) if line.method == method]))
        axes.text(centre, -0.16, method, ha='center', transform=axes.get_xaxis_transform())
    axes.grid(axis='x', visible=False)
    finite = [line.simulated for line in lines if np.isfinite(line.simulated)]
    axes.set(
        ylabel='event threshold h [1]',
        ylim=(0, 1.45 * max(finite + [line.h_star for line in lines])),
        title='Where the loop really leaves its tolerance',
    )
    axes.legend(loc='upper left', ncols=3)
    return figure


def own_plant_figure(rows: Rows) -> Figure:
    """Worst limsup of random and adversarial runs against h, beside the two bounds.

    Parameters
    ----------
    rows
        Rows of the study of a user's own plant.
    """
    lines = own_thresholds(rows)
    figure = Figure(figsize=(4 * len(lines) + 1, 4), layout='constrained')
    panels = figure.subplots(1, len(lines), squeeze=False)[0]
    for axes, line in zip(panels, lines, strict=True):
        for kind, colour, marker in (
            ('random', plotting.BLUE, 'o'),
            ('adversarial', plotting.VERMILION, 'x'),
        ):
            mine = [row for row in rows if (row['method'], row['kind']) == (line.method, kind)]
            worst = np.array([float(row['limsup']) / float(row['tolerance']) for row in mine])
            axes.plot([float(row['h']) for row in mine], worst, marker, color=colour, label=kind)
        axes.axhline(1.0, color=plotting.BLACK, ls='--', lw=1, label='tolerance')
        for h, colour, label in (
            (line.h_certified, plotting.GREEN, 'h_certified'),
            (line.h_star, plotting.GREY, 'h*'),
        ):
            if 0 < h < np.inf:
                axes.axvline(h, color=colour, lw=1.5, label=f'{label} = {h:.3g}')
        axes.set(xlabel='event threshold h [log_b units]', ylim=(0, 2), title=line.method)
        axes.legend(fontsize=8)
    panels[0].set(ylabel='worst limsup ||x - x_d|| / eps')
    return figure


def pixels_figure(rows: Rows) -> Figure:
    """Long-run error against the number of pixels.

    Parameters
    ----------
    rows
        Rows of the study `pixels`.
    """
    figure, axes = plotting.new_figure(7.2, 4.2)
    counts = sorted({int(row['pixels']) for row in rows})
    for key, colour, marker, name in (
        ('limsup', plotting.VERMILION, 's', r'largest: limsup $\|x - x_d\|$'),
        ('mean', plotting.BLUE, 'o', r'average of $\|x - x_d\|$ over time'),
    ):
        values = [
            np.array([float(r[key]) for r in rows if int(r['pixels']) == count])
            for count in counts
        ]
        low, middle, high = np.array([np.quantile(v, (0.1, 0.5, 0.9)) for v in values]).T
        axes.fill_between(counts, low, high, color=colour, alpha=0.18, lw=0)
        axes.plot(
            counts, middle, marker=marker, color=colour, label=f'{name} (median, 10 to 90 %)'
        )
    axes.axhline(0.05, color=plotting.BLACK, ls='--', lw=1.1, label=r'tolerance $\epsilon$ = 0.05')
    axes.set_xscale('log')
    axes.set_xticks(counts, [str(count) for count in counts])
    axes.minorticks_off()
    axes.set(
        xlabel='number of pixels r',
        ylabel=r'error $\|x - x_d\|$ [unit of x]',
        ylim=(0, 0.062),
        title=f'Long-run error against r (structured, h = {float(rows[0]["h"]):g}, mirror)',
    )
    axes.legend(loc='upper right', fontsize=9)
    return figure
