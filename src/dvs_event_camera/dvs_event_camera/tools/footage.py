"""What was filmed: the pictures of a video file or of a folder, with their times."""

from __future__ import annotations

import csv
import importlib
import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.errors import ParameterError
from dvs_common.nanoseconds import NANOSECONDS, as_nanoseconds
from dvs_common.wire.cdr import MessageError
from dvs_event_camera.files.damage import DamagedFile
from dvs_event_camera.streams.image_source import LuminosityFrame, decode_picture

PICTURES = ('.png', '.jpg', '.jpeg', '.bmp', '.tif', '.tiff', '.pgm', '.ppm', '.webp')
VIDEOS = ('.mp4', '.avi', '.mkv', '.mov', '.webm', '.mpg', '.mpeg', '.m4v')
# Lists of stamps that come with pictures: rpg_esim (ns and file name), rpg_vid2e (seconds).
_CSV, _TIMES = 'images.csv', 'timestamps.txt'
# Some containers do not count their frames; OpenCV makes an estimate from the duration.
_WHOLE = 0.95


@dataclass(frozen=True, slots=True, kw_only=True)
class Footage:
    """Pictures, and when they were taken.

    Parameters
    ----------
    frames
        Grey pictures, shape (height, width) each; a `DamagedFile` where one can't be decoded.
    count
        Number of pictures, 0 if it is not known.
    rate
        Pictures a second that the file states, Hz; None if it states none.
    stamps_ns
        Time of each picture, ns; empty if there is no list of them.
    """

    frames: Iterator[NDArray[Any]]
    count: int = 0
    rate: float | None = None
    stamps_ns: tuple[int, ...] = ()

    def stamped(self, rate: float | None = None) -> Iterator[tuple[int, NDArray[Any]]]:
        """Pictures with the time since the first one, ns.

        Parameters
        ----------
        rate
            Pictures a second, instead of what the recording states; needed if it states nothing.
        """
        period_s = 1.0 / (rate or self.rate or 1.0)
        for number, frame in enumerate(self.frames):
            if self.stamps_ns and rate is None:
                yield self.stamps_ns[number] - self.stamps_ns[0], frame
            else:
                yield as_nanoseconds(number * period_s), frame


def open_footage(path: Path) -> Footage:
    """Pictures of a video file, a folder or one picture.

    Numbered pictures come in the order of their numbers. A folder may bring `images.csv` (lines of
    a stamp in ns and a file name) or `timestamps.txt` (seconds, one a line).

    Parameters
    ----------
    path
        File or folder.

    Raises
    ------
    ParameterError
        If there is nothing to show, its times make no sense, or no decoder is installed.
    """
    if path.is_dir():
        return _folder(path)
    if path.is_file() and path.suffix.lower() in PICTURES:
        return Footage(frames=_decoded([path]), count=1)
    if path.is_file() and path.suffix.lower() in VIDEOS:
        return _video(path)
    raise ParameterError(
        'source',
        path,
        'must be a video file (' + ', '.join(VIDEOS) + '), a picture or a folder of pictures',
    )


def recorded_frames(path: Path) -> Iterator[NDArray[Any]]:
    """Grey pictures of a video file or a folder, without their times.

    Parameters
    ----------
    path
        File or folder.

    Raises
    ------
    ParameterError
        As `open_footage`.
    """
    return open_footage(path).frames


def natural_order(path: Path) -> list[tuple[int, int, str]]:
    """Key that puts frame_9 before frame_10.

    Parameters
    ----------
    path
        File.
    """
    parts = re.split(r'(\d+)', path.name)
    return [(0, int(part), part) if part.isdecimal() else (1, 0, part) for part in parts if part]


def _folder(path: Path) -> Footage:
    listed = path / _CSV
    if listed.is_file():
        stamps, pictures = _listed(listed)
    else:
        stamps = ()
        found = (p for p in path.iterdir() if p.suffix.lower() in PICTURES)
        pictures = sorted(found, key=natural_order)
        if not pictures:
            raise ParameterError('source', path, f'has no pictures ({", ".join(PICTURES)})')
        if (path / _TIMES).is_file():
            stamps = _times(path / _TIMES)
    if stamps:
        _check(path, stamps, len(pictures))
    return Footage(frames=_decoded(pictures), count=len(pictures), stamps_ns=stamps)


def _listed(path: Path) -> tuple[tuple[int, ...], list[Path]]:
    try:
        with path.open(encoding='utf-8', newline='') as file:
            lines = [row for row in csv.reader(file) if row and not row[0].startswith('#')]
        stamps = tuple(int(row[0]) for row in lines)
        return stamps, [path.parent / row[1].strip() for row in lines]
    except (ValueError, IndexError, csv.Error):
        raise ParameterError(
            'source', path, 'must hold lines of a stamp in ns and a file name'
        ) from None


def _times(path: Path) -> tuple[int, ...]:
    try:
        words = path.read_text(encoding='utf-8').split()
        return tuple(as_nanoseconds(float(word)) for word in words)
    except (ValueError, OverflowError):
        raise ParameterError('source', path, 'must hold seconds, one a line') from None


def _check(path: Path, stamps: tuple[int, ...], pictures: int) -> None:
    if len(stamps) != pictures:
        raise ParameterError('source', path, f'has {pictures} pictures but {len(stamps)} stamps')
    if any(later <= earlier for earlier, later in pairwise(stamps)):
        raise ParameterError('source', path, 'must have stamps that increase from line to line')


def _decoded(pictures: list[Path]) -> Iterator[NDArray[Any]]:
    for picture in pictures:
        try:
            yield _grey(decode_picture(picture.read_bytes()))
        except (OSError, MessageError) as error:
            raise DamagedFile(picture, f'can not be decoded ({error})') from None


def _grey(picture: LuminosityFrame) -> NDArray[Any]:
    """Pixels that carry their floor with them: the luma of 8-bit colours is a float."""
    if picture.pixels.dtype.kind != 'f':
        return picture.pixels
    return np.asarray(np.maximum(picture.pixels, np.float32(picture.darkest)))


def _video(path: Path) -> Footage:
    try:
        cv2: Any = importlib.import_module('cv2')
    except ImportError:
        raise ParameterError(
            'source', path, 'needs OpenCV (opencv-python-headless or python3-opencv) for videos'
        ) from None
    video = cv2.VideoCapture(str(path))
    if not video.isOpened():
        raise ParameterError('source', path, 'can not be opened as a video')
    rate = float(video.get(cv2.CAP_PROP_FPS))
    count = max(0, int(video.get(cv2.CAP_PROP_FRAME_COUNT)))
    return Footage(
        frames=_read_video(cv2, video, path, count),
        count=count,
        rate=rate if 0 < rate <= NANOSECONDS else None,
    )


def _read_video(cv2: Any, video: Any, path: Path, count: int) -> Iterator[NDArray[Any]]:
    try:
        for number in itertools.count():
            found, frame = video.read()
            if not found and number < _WHOLE * count:
                raise DamagedFile(path, f'ends after {number} of {count} frames')
            if not found:
                return
            yield frame if frame.ndim == 2 else np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY))
    finally:
        video.release()
