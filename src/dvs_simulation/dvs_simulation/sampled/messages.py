"""The messages of a compiled run: those that the nodes would have sent, all at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.nanoseconds import NANOSECONDS
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire.events import NO_EVENTS, EventPacket, make_events, pack_events
from dvs_common.wire.messages import Vector, pack_command, pack_estimate, pack_image, pack_state
from dvs_common.wire.topics import COMMAND, ESTIMATE, EVENTS, LUMINOSITY, STATE
from dvs_simulation.sampled.compiled_loop import CompiledRun

# Where the stamp of a message stands: seconds and nanoseconds after the encapsulation.
_STAMP = slice(4, 12)


def messages_of(run: CompiledRun, scenario: Scenario) -> dict[str, list[bytes]]:
    """CDR bytes by topic, as `run_by_messages` has them.

    Parameters
    ----------
    run
        A whole run.
    scenario
        Its scenario.
    """
    record, scene = run.record, scenario.scene
    stamps = np.arange(len(record.states)) * scenario.sampling_period_ns
    zero = {name: np.zeros(getattr(record, name).shape[1]) for name in ('states', 'commands')}
    state = pack_state(_named('x', zero['states']))
    command = pack_command(_named('u', zero['commands']))
    dark = np.zeros((scene.height, scene.width))
    image = pack_image(0, dark, '64FC1')
    received = ~run.lost
    return {
        LUMINOSITY: _filled(image, stamps, record.luminosities, len(image)),
        STATE: _filled(state, stamps, record.states, len(state) - 8),
        EVENTS: _event_messages(run, stamps, scene.width),
        COMMAND: _filled(command, stamps[received], record.commands[received], len(command)),
        ESTIMATE: _estimates(record.estimates[received], stamps[received]),
    }


def _named(letter: str, values: FloatArray) -> Vector:
    names = tuple(f'{letter}{i + 1}' for i in range(values.size))
    return Vector(stamp_ns=0, names=names, values=values)


def _estimates(estimates: FloatArray, stamps: NDArray[np.int64]) -> list[bytes]:
    message = pack_estimate(0, np.zeros(estimates.shape[1]))
    return _filled(message, stamps, estimates, len(message) - 8)


def _filled(
    message: bytes, stamps: NDArray[np.int64], values: FloatArray, end: int
) -> list[bytes]:
    """One message a stamp: a message with its stamp and the doubles that end at `end` replaced."""
    rows = np.tile(np.frombuffer(message, np.uint8), (len(stamps), 1))
    parts = np.stack(np.divmod(stamps, NANOSECONDS), axis=1).astype('<u4')
    rows[:, _STAMP] = parts.view(np.uint8)
    octets = np.ascontiguousarray(values).view(np.uint8).reshape(len(stamps), -1)
    rows[:, end - octets.shape[1] : end] = octets
    whole, size = rows.tobytes(), rows.shape[1]
    return [whole[start : start + size] for start in range(0, len(whole), size)]


def _event_messages(run: CompiledRun, stamps: NDArray[np.int64], width: int) -> list[bytes]:
    edges = run.record.first_event
    sizes = np.diff(edges)
    empty = pack_events(EventPacket(stamp_ns=0, events=NO_EVENTS))
    messages = _filled(empty, stamps, np.empty((len(stamps), 0)), 0)
    if not run.times_ns.size:
        return messages
    records = make_events(
        times_ns=run.times_ns - np.repeat(stamps, sizes),
        pixels=run.pixels,
        polarities=run.polarities,
        signs=np.ones(run.pixels.size, np.int8),
        width=width,
        stamp_ns=0,
        first_index=0,
    )
    for sample in np.flatnonzero(sizes).tolist():
        events = records[edges[sample] : edges[sample + 1]]
        messages[sample] = pack_events(EventPacket(stamp_ns=int(stamps[sample]), events=events))
    return messages
