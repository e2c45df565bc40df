"""Triggers beside a file that has no place for them: `NAME.triggers.csv`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dvs_event_camera.files.damage import DamagedFile
from dvs_event_camera.streams.sensor_events import NO_TRIGGERS, Triggers

_HEAD = 't,source,rising'


def _path_beside(path: Path) -> Path:
    return path.with_name(path.name + '.triggers.csv')


def read_triggers(path: Path) -> Triggers:
    """Triggers that belong to a file of events; none where no file is beside it.

    Parameters
    ----------
    path
        File with the events.

    Raises
    ------
    DamagedFile
        If the file beside it is no table of triggers.
    """
    beside = _path_beside(path)
    if not beside.exists():
        return NO_TRIGGERS
    try:
        rows = np.loadtxt(beside, np.int64, delimiter=',', skiprows=1, ndmin=2)
        t, source, rising = rows.T
    except ValueError as error:
        raise DamagedFile(beside, f'is no table of triggers: {error}') from None
    return Triggers(t=t, source=source.astype(np.uint8), rising=rising.astype(np.uint8))


class TriggerWriter:
    """Writes triggers beside a file of events, if there are any.

    Parameters
    ----------
    path
        File with the events; triggers of an earlier one of that name are removed.
    """

    def __init__(self, path: Path) -> None:
        self._path = _path_beside(path)
        self._path.unlink(missing_ok=True)

    def add(self, triggers: Triggers) -> None:
        """Write some triggers.

        Parameters
        ----------
        triggers
            Edges: time in ns, input, 1 for rising.
        """
        if not len(triggers):
            return
        rows = zip(
            triggers.t.tolist(), triggers.source.tolist(), triggers.rising.tolist(), strict=True
        )
        new = not self._path.exists()
        with self._path.open('a', encoding='ascii') as file:
            if new:
                file.write(_HEAD + '\n')
            file.writelines(f'{t},{source},{rising}\n' for t, source, rising in rows)
