"""Which command acts when: the pieces of time in which the input of the plant is constant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvs_simulation.sampled.conditions import Conditions


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Schedule:
    """Pieces of a run of N periods, P in all.

    Parameters
    ----------
    first_piece
        Pieces of period s are ``first_piece[s]`` to ``first_piece[s + 1]``, shape (N + 1,).
    lengths_ns
        Length of every piece, ns, shape (P,).
    commands
        Sample whose command acts in it, -1 for none, shape (P,).
    lost
        Samples whose packet the controller never gets, shape (N + 1,).
    """

    first_piece: NDArray[np.int64]
    lengths_ns: NDArray[np.int64]
    commands: NDArray[np.int64]
    lost: NDArray[np.bool_]

    @classmethod
    def of(cls, conditions: Conditions, *, periods: int, period_ns: int) -> Schedule:
        """Schedule of a run.

        Parameters
        ----------
        conditions
            With latencies and losses.
        periods
            N.
        period_ns
            Sampling period, ns.
        """
        samples = np.arange(periods + 1)
        lost = np.zeros(periods + 1, bool) if conditions.lost is None else conditions.lost
        if conditions.lost is None and conditions.latencies_ns is None:
            return cls(
                first_piece=samples,
                lengths_ns=np.full(periods, period_ns),
                commands=samples[:-1],
                lost=lost,
            )
        late = 0 if conditions.latencies_ns is None else conditions.latencies_ns
        received = np.flatnonzero(~lost)
        arrivals = np.maximum.accumulate((samples * period_ns + late)[received])
        end_ns = periods * period_ns
        edges = np.unique(np.concatenate([samples * period_ns, arrivals[arrivals < end_ns]]))
        begins = edges[:-1]
        newest = np.searchsorted(arrivals, begins, side='right') - 1
        return cls(
            first_piece=np.searchsorted(begins, samples * period_ns),
            lengths_ns=np.diff(edges),
            commands=np.where(newest >= 0, received[newest], -1),
            lost=lost,
        )

    def samples_of_pieces(self) -> NDArray[np.int64]:
        """Period of every piece, shape (P,)."""
        return np.repeat(np.arange(self.first_piece.size - 1), np.diff(self.first_piece))
