"""What a run left behind, decoded from its messages into arrays."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.nanoseconds import as_seconds
from dvs_common.wire import topics
from dvs_common.wire.events import EVENT_DTYPE, parse_events
from dvs_common.wire.messages import parse_command, parse_state
from dvs_event_camera.streams.image_source import parse_luminosity

Messages = Mapping[str, Sequence[bytes]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Trace:
    """Signals of a closed-loop run on its samples.

    Parameters
    ----------
    times_s
        Time of every complete sample from the first one on, s, shape (K,).
    states
        Plant states, shape (K, n).
    luminosities
        y, shape (K, r).
    estimates
        z as the controller published it, shape (K, r).
    commands
        u_o, shape (K, m).
    events
        All events as records of `EVENT_DTYPE`.
    event_times_s
        Time of every event from the first sample on, s, shape (E,).
    width
        Columns of the pixel array.
    """

    times_s: FloatArray
    states: FloatArray
    luminosities: FloatArray
    estimates: FloatArray
    commands: FloatArray
    events: NDArray[np.void]
    event_times_s: FloatArray
    width: int

    @property
    def event_pixels(self) -> NDArray[np.intp]:
        """Row-major pixel number of every event, shape (E,)."""
        return np.asarray(
            self.events['y'].astype(np.intp) * self.width + self.events['x'], dtype=np.intp
        )


class IncompleteTraceError(ValueError):
    """Messages of a run that do not belong together: something was lost."""


def decode_trace(messages: Messages) -> Trace:
    """Trace of the serialized messages of a run, in the order of their publication.

    A message that was sent again counts once.

    Parameters
    ----------
    messages
        CDR bytes by topic.

    Raises
    ------
    IncompleteTraceError
        If a topic is empty, its samples are not those of the commands, or a message is of another
        size than the others.
    """
    commands = {v.stamp_ns: v.values for v in map(parse_command, messages[topics.COMMAND])}
    states = {v.stamp_ns: v.values for v in map(parse_state, messages[topics.STATE])}
    frames = {f.stamp_ns: f for f in map(parse_luminosity, messages[topics.LUMINOSITY])}
    packets = {p.stamp_ns: p for p in map(parse_events, messages[topics.EVENTS])}
    estimates = {v.stamp_ns: v.values for v in map(parse_state, messages[topics.ESTIMATE])}
    stamps = list(commands)
    if not stamps:
        raise IncompleteTraceError('no command was recorded')
    sampled: dict[str, Collection[int]] = {
        'state': states,
        'luminosity': frames,
        'events': packets,
        'estimate': estimates,
    }
    for name, found in sampled.items():
        missing = [stamp for stamp in stamps if stamp not in found]
        if missing:
            raise IncompleteTraceError(
                f'{len(missing)} of {len(stamps)} samples have no {name}, the first at '
                f'{missing[0]} ns'
            )
    start_ns = stamps[0]
    kept = [packets[stamp] for stamp in stamps]
    event_times_ns = [p.stamp_ns - start_ns + p.events['t'].astype(np.int64) for p in kept]
    return Trace(
        times_s=as_seconds(np.array(stamps, dtype=np.int64) - start_ns),
        states=_stacked('state', [states[stamp] for stamp in stamps]),
        luminosities=_stacked(
            'luminosity', [frames[stamp].pixels.reshape(-1) for stamp in stamps]
        ),
        estimates=_stacked('estimate', [estimates[stamp] for stamp in stamps]),
        commands=_stacked('command', list(commands.values())),
        events=np.concatenate([p.events for p in kept] or [np.empty(0, EVENT_DTYPE)]),
        event_times_s=as_seconds(np.concatenate(event_times_ns)),
        width=frames[start_ns].pixels.shape[1],
    )


def _stacked(name: str, rows: Sequence[NDArray[Any]]) -> FloatArray:
    """Rows of one topic as an array; a message of another program may have another size."""
    sizes = {row.size for row in rows}
    if len(sizes) > 1:
        raise IncompleteTraceError(
            f'messages on {name} have {", ".join(map(str, sorted(sizes)))} entries'
        )
    return np.array(rows, dtype=np.float64)
