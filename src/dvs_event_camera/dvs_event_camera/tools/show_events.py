"""Tool `show_events`: x y t p of events as a table, live or from a recording, and statistics."""

from __future__ import annotations

import argparse
import importlib
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path

from dvs_common.errors import ParameterError, SuiteError
from dvs_event_camera.files.damage import DamagedFile
from dvs_event_camera.files.open_recording import open_recording
from dvs_event_camera.files.recording import Recording
from dvs_event_camera.files.writer_form import EventWriter
from dvs_event_camera.files.writers import LazyWriter
from dvs_event_camera.tools.event_show import EventShow
from dvs_event_camera.tools.event_summary import EventSummary
from dvs_event_camera.tools.event_table import EventTable

_USAGE_ERROR = 2


def parse_arguments(arguments: Sequence[str]) -> argparse.Namespace:
    """Command line of `show_events`.

    Parameters
    ----------
    arguments
        Without ROS arguments and the program's name.
    """
    parser = argparse.ArgumentParser(
        prog='show_events',
        description='Print events as a table x y t p: column, row, time in ns, polarity. '
        'Statistics go to stderr.',
    )
    parser.add_argument(
        'file', nargs='?', type=Path, help='file of events or bag of ROS 2 or 1; without it: live'
    )
    parser.add_argument(
        '--topic', help='topic (default: events live, the only one with events in a bag)'
    )
    parser.add_argument(
        '--json', action='store_true', help='print one object that describes the file instead'
    )
    parser.add_argument('--csv', type=Path, metavar='FILE', help='write a CSV file instead')
    parser.add_argument('--npz', type=Path, metavar='FILE', help='write a NumPy archive instead')
    parser.add_argument('--limit', type=int, metavar='N', help='stop after N events')
    parser.add_argument(
        '--seconds', type=float, metavar='S', help='stop after S seconds of events'
    )
    parser.add_argument('--quiet', action='store_true', help='statistics only')
    return parser.parse_args(arguments)


def writers_of(options: argparse.Namespace, recording: Recording | None) -> list[EventWriter]:
    """Writers that the command line asks for.

    Parameters
    ----------
    options
        From `parse_arguments`.
    recording
        What is shown; None for live events.
    """
    writers: list[EventWriter] = [
        LazyWriter(
            path,
            name,
            width=recording.width if recording else 0,
            height=recording.height if recording else 0,
            whole_microseconds=recording is not None and recording.whole_microseconds,
        )
        for name, path in (('csv', options.csv), ('npz', options.npz))
        if path
    ]
    if not writers and not options.quiet and not options.json:
        writers.append(EventTable(sys.stdout))
    return writers


def main(arguments: Sequence[str] | None = None) -> int:
    """Show events; returns the exit code.

    Parameters
    ----------
    arguments
        Command line with ROS arguments; `sys.argv` by default.
    """
    command_line = list(sys.argv if arguments is None else arguments)
    own = command_line[1:]
    if '--ros-args' in own:
        own = own[: own.index('--ros-args')]
    options = parse_arguments(own)
    try:
        return _show(options, command_line)
    except BrokenPipeError:  # `show_events BAG | head`: `run_program` ends it
        raise
    except SuiteError as error:
        print(f'show_events: {error}', file=sys.stderr)
        return error.exit_code
    except OSError as error:
        print(f'show_events: {error}', file=sys.stderr)
    return _USAGE_ERROR


def _show(options: argparse.Namespace, command_line: Sequence[str]) -> int:
    for name, value in (('limit', options.limit), ('seconds', options.seconds)):
        if value is not None and not 0 <= value < math.inf:
            raise ParameterError(name, value, 'must be a finite number >= 0')
    if options.json and not options.file:
        raise ParameterError('json', True, 'needs a file')
    recording = open_recording(options.file, options.topic) if options.file else None
    writers = writers_of(options, recording)
    summary = EventSummary()
    show = EventShow(
        [*writers, *([summary] if options.json else [])], options.limit, options.seconds
    )
    damage = None
    try:
        if recording:
            damage = _show_recording(recording, show)
        else:
            # Only here ROS is needed.
            live = importlib.import_module('dvs_event_camera.tools.show_events_node')
            live.show_live(options.topic or 'events', show, command_line)
    finally:
        for writer in writers:
            writer.close()
    if options.json and recording:
        found = summary.as_dict(
            encoding=recording.encoding, width=recording.width, height=recording.height
        )
        print(json.dumps(found))
    else:
        print(show.statistics.report(), file=sys.stderr)
    if damage:
        raise damage
    return 0


def _show_recording(recording: Recording, show: EventShow) -> DamagedFile | None:
    """Show a recording as far as it can be read; return what is wrong with it."""
    try:
        for stretch in recording.read():
            show.add(stretch)
            if show.done:
                break
    except DamagedFile as damage:
        return damage
    return None
