"""Rounds of a measurement: their median, and how far they spread."""

from __future__ import annotations

import statistics
from collections.abc import Sequence


def figure(name: str, rounds: Sequence[float]) -> dict[str, float]:
    """Median under `name`, and under `name_spread` half the range over the median.

    Parameters
    ----------
    name
        Name of the figure.
    rounds
        One value a round.
    """
    median = statistics.median(rounds)
    figures = {name: median}
    if len(rounds) > 1:
        figures[f'{name}_spread'] = (max(rounds) - min(rounds)) / (2 * median)
    return figures
