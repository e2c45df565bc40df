"""Every number of the paper, and of our corrections, beside what this package finds."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

from dvs_common.writing import whole_file
from dvs_simulation.paper.experiments import Counterexample, Experiment
from dvs_simulation.paper.published import (
    OPTIMAL_THRESHOLDS,
    OPTIMIZATION,
    THRESHOLDS,
)

PAPER = 'paper'
# Found once by another way than the package's own, and kept as numbers.
CHECK = 'check'
COLUMNS = ('quantity', 'method', 'pixels', 'source', 'reference', 'ours', 'deviation_percent')

Experiments = dict[tuple[str, int, str], Experiment]


@dataclass(frozen=True, slots=True, kw_only=True)
class TableRow:
    """A number beside its reference.

    Parameters
    ----------
    quantity
        What it is.
    method
        Controller that it belongs to, or empty.
    pixels
        r, or 0 where it does not matter.
    source
        Where the reference stands.
    reference
        The reference.
    ours
        What was found.
    """

    quantity: str
    method: str
    pixels: int
    source: str
    reference: float
    ours: float

    @property
    def deviation_percent(self) -> float:
        """Relative deviation from the reference, per cent."""
        return 100 * (self.ours / self.reference - 1)


def optimal_spacing(error_bound: float, lower: float, upper: float) -> tuple[float, float]:
    """``(rho*, lambdabar*)`` of Theorem 3: the least rho whose sector meets `error_bound`.

    Parameters
    ----------
    error_bound
        deltabar in (0, 1).
    lower
        m.
    upper
        M.
    """
    spacing = math.sqrt(upper * (1 - error_bound) / (lower * (1 + error_bound)))
    return spacing, 2 * lower * upper * spacing / (upper + lower * spacing**2)


def paper_table(experiments: Experiments, counterexample: Counterexample) -> list[TableRow]:
    """All rows.

    Parameters
    ----------
    experiments
        Runs by (example, r, method).
    counterexample
        The counterexample.
    """
    rows = _threshold_rows(experiments)
    spacing, estimate = optimal_spacing(
        OPTIMIZATION['error_bound'], OPTIMIZATION['lower'], OPTIMIZATION['upper']
    )
    rows += [
        _row('rho*', PAPER, OPTIMIZATION['spacing'], spacing),
        _row('lambdabar*', PAPER, OPTIMIZATION['estimate'], estimate),
    ]
    rows += _norm_rows(experiments)
    rows += _counterexample_rows(counterexample)
    return rows


def write_table(rows: list[TableRow], path: Path) -> None:
    """Write `table.csv`.

    Parameters
    ----------
    rows
        Rows.
    path
        File to write.
    """
    with whole_file(path) as draft, draft.open('w', encoding='utf-8', newline='') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(COLUMNS)
        for row in rows:
            writer.writerow(
                [
                    f'{v:.6g}' if isinstance(v := getattr(row, name), float) else v
                    for name in COLUMNS
                ]
            )


def _row(
    quantity: str, source: str, reference: float, ours: float, *, method: str = '', pixels: int = 0
) -> TableRow:
    return TableRow(
        quantity=quantity,
        method=method,
        pixels=pixels,
        source=source,
        reference=float(reference),
        ours=float(ours),
    )


def _threshold_rows(experiments: Experiments) -> list[TableRow]:
    rows = []
    for source, references in ((PAPER, THRESHOLDS), (CHECK, OPTIMAL_THRESHOLDS)):
        for (method, pixels), value in references.items():
            found = experiments['paper', pixels, method].design.figures.h_star
            rows.append(_row('h*', source, value, found, method=method, pixels=pixels))
    mirror = {1: 0.15884, 3: 0.15864, 9: 0.15857}
    for pixels, value in mirror.items():
        found = experiments['mirror', pixels, 'structured'].design.figures.h_star
        rows.append(
            _row('h*, mirror image', CHECK, value, found, method='structured', pixels=pixels)
        )
    return rows


def _norm_rows(experiments: Experiments) -> list[TableRow]:
    unstructured = experiments['paper', 3, 'unstructured'].design.figures
    structured = experiments['paper', 3, 'structured'].design.figures
    return [
        _row('gamma', CHECK, 1.9567, unstructured.gamma, method='unstructured', pixels=3),
        _row('mu', CHECK, 2.3860, structured.mu_upper, method='structured', pixels=3),
        _row('||G(0)||', CHECK, 1.38359, unstructured.dc_gain_w2, method='unstructured', pixels=3),
        _row('||G(0)||', CHECK, 1.43356, structured.dc_gain_w2, method='structured', pixels=3),
    ]


def _counterexample_rows(counterexample: Counterexample) -> list[TableRow]:
    rows = [_row('counterexample: h allowed', CHECK, 0.49, counterexample.h_allowed, pixels=1)]
    for experiment, value in zip(counterexample.experiments, (0.032, 0.060), strict=True):
        tail = experiment.run.tail
        assert tail is not None
        rows.append(
            _row(
                f'counterexample: limsup ||x|| at h = {experiment.loop.event_threshold:.2f}',
                CHECK,
                value,
                tail.peak,
                pixels=1,
            )
        )
    return rows
