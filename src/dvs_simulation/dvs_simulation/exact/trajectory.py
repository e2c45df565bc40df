"""What a run of the automaton returns."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dvs_common.arrays import FloatArray

Status = Literal['completed', 'zeno', 'diverged', 'max_events']


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """How a run ended.

    Parameters
    ----------
    status
        ``completed``; ``zeno`` if a pixel fired faster than `max_event_rate`; ``diverged`` if the
        state left all bounds; ``max_events`` if there were too many events to keep.
    time
        Time reached, s.
    pixel
        Pixel that tripped the Zeno guard, else -1.
    message
        The same in a sentence.
    """

    status: Status
    time: float
    pixel: int
    message: str

    @property
    def completed(self) -> bool:
        """Whether the run reached its end."""
        return self.status == 'completed'


@dataclass(frozen=True, slots=True, kw_only=True)
class Tail:
    """The error ``||x - x_d||`` from `start` to the end of a run.

    Parameters
    ----------
    start
        Beginning of the tail, s.
    peak
        Largest error that was attained at an event or a step.
    peak_bound
        Rigorous bound of the error at *every* instant of the tail, up to rounding.
    mean
        Average over time.
    """

    start: float
    peak: float
    peak_bound: float
    mean: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Trajectory:
    """Events and samples of one run.

    Events are totally ordered by (time, pixel). Events of one pixel at one instant keep their
    order: with ``signed_log`` the pair (-1, old sign), (+1, new sign).

    Parameters
    ----------
    event_time
        Instants in (0, end], s, shape (k,).
    event_pixel
        Pixel indices, row-major, shape (k,), int32.
    event_polarity
        +1 or -1, shape (k,), int8.
    event_sign
        Sign of the reference that the event belongs to, shape (k,), int8.
    event_count
        Number of events, also when they were not recorded.
    counts
        N_i at the end, shape (r,).
    signs
        Signs of the references at the end, shape (r,).
    sample_time
        Instants asked for, s, shape (j,).
    states
        x in original coordinates there, shape (j, n).
    controller_states
        State of K there, shape (j, k).
    drive
        ``e = mean(zbar_i)`` there, after the events of the instant, shape (j,).
    inputs
        u_o there, shape (j, m).
    tail
        The error near the end; None if it was not asked for.
    outcome
        How the run ended.
    evaluations
        Evaluations of the closed form: a measure of work that does not depend on the machine.
    """

    event_time: FloatArray
    event_pixel: np.ndarray
    event_polarity: np.ndarray
    event_sign: np.ndarray
    event_count: int
    counts: np.ndarray
    signs: np.ndarray
    sample_time: FloatArray
    states: FloatArray
    controller_states: FloatArray
    drive: FloatArray
    inputs: FloatArray
    tail: Tail | None
    outcome: Outcome
    evaluations: int

    @property
    def limsup(self) -> float:
        """Largest error of the tail that was attained; infinite if the run broke off."""
        return self.tail.peak if self.tail and self.outcome.completed else math.inf

    @property
    def limsup_bound(self) -> float:
        """Bound on the error at every instant of the tail; infinite if the run broke off."""
        return self.tail.peak_bound if self.tail and self.outcome.completed else math.inf

    @property
    def mean_error(self) -> float:
        """Mean error of the tail; infinite if the run broke off."""
        return self.tail.mean if self.tail and self.outcome.completed else math.inf
