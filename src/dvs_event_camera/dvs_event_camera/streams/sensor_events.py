"""Events in the time of the sensor, as columns: what every codec and every file is read into."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

# An event as it is hashed: packed, little-endian.
PACKED_DTYPE = np.dtype([('t', '<i8'), ('x', '<u2'), ('y', '<u2'), ('p', 'u1')])


@dataclass(frozen=True, slots=True, kw_only=True)
class Triggers:
    """Edges of a sensor's trigger inputs.

    Parameters
    ----------
    t
        Sensor time, ns, int64, shape (K,).
    source
        Number of the input, uint8, shape (K,).
    rising
        1 for a rising edge, 0 for a falling one, uint8, shape (K,).
    """

    t: NDArray[np.int64]
    source: NDArray[np.uint8]
    rising: NDArray[np.uint8]

    def __len__(self) -> int:
        """Number of edges."""
        return len(self.t)


NO_TRIGGERS = Triggers(
    t=np.empty(0, np.int64), source=np.empty(0, np.uint8), rising=np.empty(0, np.uint8)
)


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorEvents:
    """A stretch of events, in the order in which they were recorded.

    Parameters
    ----------
    t
        Sensor time, ns, int64, shape (E,).
    x
        Column, from the left, uint16, shape (E,).
    y
        Row, from the top, uint16, shape (E,).
    p
        1 for ON, 0 for OFF, uint8, shape (E,).
    noise
        1 for an event that no change of light caused, uint8, shape (E,); None without labels.
    triggers
        Trigger edges of the stretch.
    """

    t: NDArray[np.int64]
    x: NDArray[np.uint16]
    y: NDArray[np.uint16]
    p: NDArray[np.uint8]
    noise: NDArray[np.uint8] | None = None
    triggers: Triggers = NO_TRIGGERS

    def __len__(self) -> int:
        """Number of events."""
        return len(self.t)

    def take(self, chosen: NDArray[np.bool_] | slice) -> SensorEvents:
        """Return some of the events, with all triggers.

        Parameters
        ----------
        chosen
            Mask of shape (E,), or a slice.
        """
        return replace(
            self,
            t=self.t[chosen],
            x=self.x[chosen],
            y=self.y[chosen],
            p=self.p[chosen],
            noise=None if self.noise is None else self.noise[chosen],
        )

    def with_labels(self) -> SensorEvents:
        """Return the same events, labelled: as signal where there were no labels."""
        if self.noise is not None:
            return self
        return replace(self, noise=np.zeros(len(self), np.uint8))

    def packed(self) -> NDArray[np.void]:
        """Events as records of `PACKED_DTYPE`, shape (E,)."""
        records = np.empty(len(self), PACKED_DTYPE)
        for name in ('t', 'x', 'y', 'p'):
            records[name] = getattr(self, name)
        return records


def no_events(triggers: Triggers = NO_TRIGGERS) -> SensorEvents:
    """Return a stretch without events.

    Parameters
    ----------
    triggers
        Trigger edges of the stretch.
    """
    return SensorEvents(
        t=np.empty(0, np.int64),
        x=np.empty(0, np.uint16),
        y=np.empty(0, np.uint16),
        p=np.empty(0, np.uint8),
        triggers=triggers,
    )


def joined(parts: Sequence[SensorEvents]) -> SensorEvents:
    """One stretch of several; labelled if any of them is.

    Parameters
    ----------
    parts
        Stretches, in order.
    """
    if len(parts) == 1:
        return parts[0]
    if not parts:
        return no_events()
    noise = None
    if any(part.noise is not None for part in parts):
        noise = np.concatenate([part.with_labels().noise for part in parts])
    triggers = [part.triggers for part in parts]
    return SensorEvents(
        t=np.concatenate([part.t for part in parts]),
        x=np.concatenate([part.x for part in parts]),
        y=np.concatenate([part.y for part in parts]),
        p=np.concatenate([part.p for part in parts]),
        noise=noise,
        triggers=Triggers(
            t=np.concatenate([edges.t for edges in triggers]),
            source=np.concatenate([edges.source for edges in triggers]),
            rising=np.concatenate([edges.rising for edges in triggers]),
        ),
    )
