"""What verdicts call the outcome of a run and its threshold."""

from __future__ import annotations

import math


def outcome_word(*, regulated: bool, slowest_pole: float | None, duration_s: float) -> str:
    """What became of a run: regulated, not settled yet, or outside its tolerance.

    Parameters
    ----------
    regulated
        Whether it stayed within its tolerances.
    slowest_pole
        Largest real part of a closed-loop pole if that may be why it did not, 1/s; else None.
    duration_s
        Length of the run, s.
    """
    if regulated:
        return 'regulated'
    if slowest_pole is None:
        return 'NOT regulated: left eps'
    return f'did not settle yet: slowest pole {slowest_pole:.3g} 1/s, duration {duration_s:g} s'


def threshold_or_null(h_certified: float) -> float | None:
    """None for any threshold, 0 where the tolerance fails at every one.

    Parameters
    ----------
    h_certified
        As designed.
    """
    if h_certified == math.inf:
        return None
    return 0.0 if h_certified == -math.inf else h_certified


def threshold_text(h_certified: float | None) -> str:
    """A bound of `threshold_or_null` in words.

    Parameters
    ----------
    h_certified
        None for any threshold, zero or negative for none.
    """
    if h_certified is None:
        return 'any'
    return f'{h_certified:.5f}' if h_certified > 0 else 'none'
