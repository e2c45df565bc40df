"""Opens whatever holds events, by what it is."""

from __future__ import annotations

from pathlib import Path

from dvs_common.errors import ParameterError
from dvs_common.wire import topics
from dvs_event_camera.files.aedat4 import aedat4_recording
from dvs_event_camera.files.bag_file import BagFile
from dvs_event_camera.files.bag_recording import POINT_CLOUD, SENSOR_TYPES, bag_recording
from dvs_event_camera.files.hdf5_file import hdf5_recording
from dvs_event_camera.files.numpy_file import npy_recording, npz_recording
from dvs_event_camera.files.raw_file import raw_recording
from dvs_event_camera.files.recording import Recording
from dvs_event_camera.files.small_files import dat_recording, nmnist_recording
from dvs_event_camera.files.tables import text_recording

_READERS = {
    '.raw': raw_recording,
    '.dat': dat_recording,
    '.bin': nmnist_recording,
    '.aedat4': aedat4_recording,
    '.h5': hdf5_recording,
    '.hdf5': hdf5_recording,
    '.npz': npz_recording,
    '.npy': npy_recording,
    '.txt': text_recording,
    '.csv': text_recording,
}
_BAGS = ('.mcap', '.db3', '.bag', '.zstd')


def is_sensor_recording(path: Path) -> bool:
    """Whether a path is a recording of a sensor, and not of our own `events`.

    Parameters
    ----------
    path
        A file or bag.

    Raises
    ------
    ParameterError
        If it is a bag that can't be read.
    """
    if not _is_bag(path):
        return path.suffix.lower() in _READERS
    with BagFile(path) as bag:
        types = {topic.type_name for topic in bag.topics}
        own = any(
            topic.type_name == POINT_CLOUD and topic.name.rpartition('/')[2] == topics.EVENTS
            for topic in bag.topics
        )
    return not own and bool(types & SENSOR_TYPES)


def _is_bag(path: Path) -> bool:
    return path.is_dir() or path.suffix.lower() in _BAGS


def open_recording(path: Path, topic: str | None = None) -> Recording:
    """Recording of a file or a bag.

    Parameters
    ----------
    path
        RAW, DAT, AEDAT4, HDF5, N-MNIST .bin, text, CSV or NPZ file, or a bag of ROS 2 or ROS 1.
    topic
        Topic of a bag, with or without its namespace; None for the only one that has events.

    Raises
    ------
    ParameterError
        If it does not exist, is empty, or is nothing that can be read.
    """
    if not path.exists():
        raise ParameterError('file', path, 'does not exist')
    if _is_bag(path):
        return bag_recording(path, topic)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        known = ', '.join((*_READERS, *_BAGS))
        raise ParameterError('file', path, f'must be the folder of a bag or end in one of {known}')
    if not path.stat().st_size:
        raise ParameterError('file', path, 'is empty')
    return reader(path)
