"""What travels on `keyframe`: all that a consumer needs of the state of the sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.points import Points, pack_points, parse_points

CONTRACT_VERSION = 2
# One record a pixel; what is the same for all pixels stands in every one.
KEYFRAME_DTYPE: np.dtype[np.void] = np.dtype(
    {
        'names': [
            *('version', 'sign', 'count', 'epoch', 'index', 'events', 'age', 'threshold'),
            *('lower', 'upper'),
        ],
        'formats': ['u1', 'i1', '<i4', '<u4', '<u4', *['<f8'] * 5],
        'offsets': [0, 1, 4, 8, 12, 16, 24, 32, 40, 48],
        'itemsize': 56,
    }
)
_COMMON = ('epoch', 'index', 'events', 'age', 'threshold')
# Of light that grows from one event to the next by more than e^100 there is none.
_LARGEST_THRESHOLD = 100.0
_LARGEST_REFERENCE = 1e100
_LONGEST_AGE_S = 1e10
_MOST_EVENTS = 2.0**53


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Keyframe:
    """State of a sensor after the events of a sample; see docs/wire_contract.md.

    Parameters
    ----------
    stamp_ns
        Sample after whose events it holds, ns.
    epoch
        Random number of the present epoch, drawn when the sensor set its references.
    age_s
        Time since then, s.
    events
        Events of all pixels since then.
    next_index
        Running number of the next event.
    event_threshold
        h of every event after this one, in logarithms to the base b.
    counts
        N, sum of the polarities since counting began at this threshold, shape (r,), int64.
    signs
        Sign of every reference, shape (r,), int8.
    lower
        m: ``|q|`` where counting began was at least this, shape (r,); 0 where unknown.
    upper
        M: it was at most this, shape (r,); infinite where unknown.
    """

    stamp_ns: int
    epoch: int
    age_s: float
    events: int
    next_index: int
    event_threshold: float
    counts: NDArray[np.int64]
    signs: NDArray[np.int8]
    lower: FloatArray
    upper: FloatArray


def pack_keyframe(keyframe: Keyframe, *, height: int, width: int) -> bytes:
    """Serialized sensor_msgs/PointCloud2 of `KEYFRAME_DTYPE`.

    Parameters
    ----------
    keyframe
        State of every pixel.
    height
        Rows of the pixel array.
    width
        Columns of the pixel array.
    """
    records = np.zeros(keyframe.counts.size, KEYFRAME_DTYPE)
    known = (keyframe.lower > 0) & np.isfinite(keyframe.upper)
    columns = {
        'version': CONTRACT_VERSION,
        'sign': keyframe.signs,
        'count': keyframe.counts,
        'epoch': keyframe.epoch,
        'index': keyframe.next_index,
        'events': keyframe.events,
        'age': keyframe.age_s,
        'threshold': keyframe.event_threshold,
        'lower': np.where(known, keyframe.lower, 0.0),
        'upper': np.where(known, keyframe.upper, 0.0),
    }
    for name, values in columns.items():
        records[name] = values
    return pack_points(Points(stamp_ns=keyframe.stamp_ns, records=records.reshape(height, width)))


def parse_keyframe(message: bytes) -> Keyframe:
    """Read a keyframe.

    Parameters
    ----------
    message
        CDR bytes of a sensor_msgs/PointCloud2.

    Raises
    ------
    MessageError
        If the message is cut short, has another layout or contract version, or a number in it is
        out of its range.
    """
    points = parse_points(message, KEYFRAME_DTYPE)
    records = points.records.reshape(-1)
    if not records.size:
        raise MessageError('keyframe of no pixel')
    if (records['version'] != CONTRACT_VERSION).any():
        raise MessageError(
            f'keyframe of contract version {records["version"][0]}, must be {CONTRACT_VERSION}'
        )
    common = records[0]
    for name in _COMMON:
        if (records[name] != common[name]).any():
            raise MessageError(f'{name} of a keyframe must be the same for every pixel')
    _require(0 < common['threshold'] < _LARGEST_THRESHOLD, 'threshold', common['threshold'])
    _require(0 <= common['age'] < _LONGEST_AGE_S, 'age', common['age'])
    events = common['events']
    _require(0 <= events < _MOST_EVENTS and events == np.rint(events), 'events', events)
    if (np.abs(records['sign'].astype(np.int64)) != 1).any():
        raise MessageError('signs of a keyframe must be +1 or -1')
    lower, upper = records['lower'], records['upper']
    unknown = (lower == 0) & (upper == 0)
    bounded = (lower >= 1 / _LARGEST_REFERENCE) & (upper <= _LARGEST_REFERENCE) & (lower <= upper)
    if not (unknown | bounded).all():
        raise MessageError('bounds of a keyframe must be 0 < lower <= upper, or 0 where unknown')
    return Keyframe(
        stamp_ns=points.stamp_ns,
        epoch=int(common['epoch']),
        age_s=float(common['age']),
        events=int(events),
        next_index=int(common['index']),
        event_threshold=float(common['threshold']),
        counts=records['count'].astype(np.int64),
        signs=records['sign'].astype(np.int8),
        lower=lower.astype(np.float64),
        upper=np.where(unknown, np.inf, upper),
    )


def _require(holds: bool, name: str, value: float) -> None:
    if not holds:
        raise MessageError(f'{name} {value} of a keyframe is out of its range')
