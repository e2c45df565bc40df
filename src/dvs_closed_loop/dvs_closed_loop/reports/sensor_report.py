"""What the recording of a sensor holds: its rate over time, and where its events are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dvs_common.drawing import Figure, drawing
from dvs_common.nanoseconds import as_seconds
from dvs_common.writing import whole_file
from dvs_event_camera.files.damage import DamagedFile
from dvs_event_camera.files.recording import Recording, measured_size
from dvs_event_camera.streams.sensor_events import SensorEvents
from dvs_event_camera.tools.stream_statistics import StreamStatistics

_BIN_NS = 10_000_000
# Twenty-eight hours; what comes later counts there, so that no broken time fills the memory.
_MOST_BINS = 10**7


class SensorCounts:
    """Counts events by time and by pixel.

    Parameters
    ----------
    width
        Columns of the sensor.
    height
        Rows of the sensor.
    """

    def __init__(self, width: int, height: int) -> None:
        self._first_ns: int | None = None
        # OFF and ON events of each interval.
        self.rates: NDArray[np.int64] = np.zeros((2, 0), np.int64)
        self.pixels: NDArray[np.int64] = np.zeros((height, width), np.int64)
        self.triggers = 0

    def add(self, events: SensorEvents) -> None:
        """Count a stretch; see `EventWriter.add`."""
        self.triggers += len(events.triggers)
        if not len(events):
            return
        if self._first_ns is None:
            self._first_ns = int(events.t[0])
        interval = np.clip((events.t - self._first_ns) // _BIN_NS, 0, _MOST_BINS)
        size = max(self.rates.shape[1], int(interval.max()) + 1)
        self.rates = np.pad(self.rates, ((0, 0), (0, size - self.rates.shape[1])))
        for polarity in (0, 1):
            chosen = interval[events.p == polarity]
            self.rates[polarity] += np.bincount(chosen, minlength=size)
        height, width = self.pixels.shape
        inside = (events.x < width) & (events.y < height)
        place = events.y[inside].astype(np.int64) * width + events.x[inside]
        self.pixels += np.bincount(place, minlength=width * height).reshape(height, width)


def report_sensor(recording: Recording, output: Path) -> DamagedFile | None:
    """Print what a recording holds and draw `report.png`; return what could not be read.

    Parameters
    ----------
    recording
        The recording.
    output
        Folder to write to.
    """
    counts, statistics = SensorCounts(*measured_size(recording)), StreamStatistics()
    damage = None
    try:
        for stretch in recording.read():
            statistics.add(stretch)
            counts.add(stretch.events)
    except DamagedFile as error:
        damage = error
    path = output / 'report.png'
    with drawing(), whole_file(path) as draft:
        _figure(counts, recording).savefig(draft, dpi=110)
    height, width = counts.pixels.shape
    print(f'{recording.path}: {recording.encoding}, {width} x {height} pixels')
    print(f'  {statistics.report()}, {counts.triggers} triggers')
    print(f'  report               {path}')
    return damage


def _figure(counts: SensorCounts, recording: Recording) -> Figure:
    figure = Figure(figsize=(11, 4), layout='constrained')
    time, place = figure.subplots(1, 2)
    seconds = as_seconds(_BIN_NS * np.arange(counts.rates.shape[1]))
    for label, rate in zip(('OFF', 'ON'), counts.rates, strict=True):
        time.plot(seconds, rate / as_seconds(_BIN_NS), label=label)
    time.set(xlabel='time of the sensor since the first event [s]', ylabel='events a second')
    time.legend()
    shown = place.imshow(counts.pixels, origin='upper', interpolation='nearest')
    place.set(xlabel='column', ylabel='row', title='events of each pixel')
    figure.colorbar(shown, ax=place)
    figure.suptitle(f'{recording.path.name} ({recording.encoding})')
    return figure
