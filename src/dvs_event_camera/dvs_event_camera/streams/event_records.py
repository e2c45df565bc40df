"""Events as the records of the wire contract."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dvs_common.wire.events import EVENT_DTYPE, LABELLED_EVENT_DTYPE, EventPacket, make_events
from dvs_event_camera.pixels.compiled import kernels_for
from dvs_event_camera.pixels.pixel_events import PixelEvents
from dvs_event_camera.streams.sensor_events import SensorEvents

_NOISE_OFFSET = 14


def records_of(
    events: PixelEvents, *, width: int, stamp_ns: int, first_index: int, backend: str
) -> NDArray[np.void]:
    """Records of `EVENT_DTYPE`, or of `LABELLED_EVENT_DTYPE` if the events are labelled.

    Parameters
    ----------
    events
        Events of one packet, shape (E,).
    width
        Columns of the pixel array.
    stamp_ns
        Stamp of the packet, ns.
    first_index
        Running number of the first event.
    backend
        `auto`, `numba` or `numpy`: the same records.
    """
    kernels = kernels_for(backend, len(events))
    if kernels is not None:
        words = np.empty((len(events), 2), np.uint64)
        kernels.pack_records(
            events.t,
            events.pixel,
            events.polarity,
            events.sign,
            width,
            stamp_ns,
            first_index,
            words,
        )
        records = words.reshape(-1).view(EVENT_DTYPE)
    else:
        records = make_events(
            times_ns=events.t,
            pixels=events.pixel,
            polarities=events.polarity,
            signs=events.sign,
            width=width,
            stamp_ns=stamp_ns,
            first_index=first_index,
        )
    return records if events.noise is None else _labelled(records, events.noise)


def events_of(packet: EventPacket) -> SensorEvents:
    """Events of a packet as columns, in absolute time.

    Parameters
    ----------
    packet
        Events, labelled or not. The sign of their references is left out.
    """
    events = packet.events
    labelled = 'noise' in (events.dtype.names or ())
    return SensorEvents(
        t=packet.stamp_ns + events['t'].astype(np.int64),
        x=np.array(events['x']),
        y=np.array(events['y']),
        p=(events['polarity'] > 0).astype(np.uint8),
        noise=np.array(events['noise']) if labelled else None,
    )


def without_labels(packet: EventPacket) -> EventPacket:
    """The same packet with records of `EVENT_DTYPE`; itself if it has no labels.

    Parameters
    ----------
    packet
        Events, labelled or not.
    """
    if packet.events.dtype == EVENT_DTYPE:
        return packet
    records = _with_noise(packet.events, np.int8(0)).view(EVENT_DTYPE)
    return EventPacket(stamp_ns=packet.stamp_ns, events=records)


def _labelled(records: NDArray[np.void], noise: NDArray[np.int8]) -> NDArray[np.void]:
    return _with_noise(records, noise).view(LABELLED_EVENT_DTYPE)


def _with_noise(records: NDArray[np.void], noise: NDArray[np.int8] | np.int8) -> NDArray[np.uint8]:
    octets = np.array(records.view(np.uint8)).reshape(-1, EVENT_DTYPE.itemsize)
    octets[:, _NOISE_OFFSET] = noise
    return octets.reshape(-1)
