"""One line on the terminal: what a starting loop waits for, then how far it is."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from tqdm import tqdm

from dvs_common.nanoseconds import as_seconds
from dvs_common.wire import topics
from dvs_common.wire.messages import parse_command

if TYPE_CHECKING:
    from dvs_closed_loop.running.run_recorder import RunRecorder

_STARTING = '{desc} [{elapsed}]'
_RUNNING = '{desc} {percentage:3.0f}% |{bar}| {n:.2f}/{total:.2f} s{postfix}'
_ENDLESS = '{desc} {n:.2f} s{postfix}'


class LoopProgress:
    """Progress in simulated time, with event rate and real-time factor; silent in a pipe.

    Parameters
    ----------
    duration_s
        Length of the run, s; 0 for one without an end.
    """

    def __init__(self, duration_s: float) -> None:
        self._duration_s = duration_s
        self._start_ns: int | None = None
        self._bar = tqdm(
            desc='starting the nodes',
            bar_format=_STARTING,
            file=sys.stderr,
            disable=None,
            leave=False,
        )

    def close(self) -> None:
        """Leave the last line on the screen if the loop ran."""
        self._bar.close()

    def waits_for(self, awaited: str) -> None:
        """Show what the start waits for.

        Parameters
        ----------
        awaited
            End of the sentence "waiting for ...".
        """
        self._bar.set_description_str(f'waiting for {awaited}')

    def update(self, recorder: RunRecorder) -> None:
        """Show how far the loop is.

        Parameters
        ----------
        recorder
            What has been received.
        """
        commands = recorder.messages[topics.COMMAND]
        if len(commands) < 2:
            return
        stamp_ns = parse_command(commands[-1]).stamp_ns
        if self._start_ns is None:
            self._start_ns = parse_command(commands[0]).stamp_ns
            self._begin()
        simulated_s = as_seconds(stamp_ns - self._start_ns)
        wall_s = max(recorder.wall_seconds, 1e-9)
        self._bar.set_postfix_str(
            f'{len(commands) / wall_s:.0f} cycles/s, {recorder.event_count / wall_s:.0f} '
            f'events/s, {simulated_s / wall_s:.2f} x real time',
            refresh=False,
        )
        self._bar.n = simulated_s
        if self._bar.total:
            # In realtime a run is longer by the time that its first answer takes.
            self._bar.total = max(self._bar.total, simulated_s)
        self._bar.refresh()

    def _begin(self) -> None:
        self._bar.close()
        self._bar = tqdm(
            total=self._duration_s or None,
            desc='simulated time',
            bar_format=_RUNNING if self._duration_s else _ENDLESS,
            file=sys.stderr,
            disable=None,
        )
