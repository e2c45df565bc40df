"""Tool `convert_events`: a recording of events as a file that another program reads."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from dvs_common.errors import ParameterError, SuiteError
from dvs_event_camera.files.damage import DamagedFile
from dvs_event_camera.files.open_recording import open_recording
from dvs_event_camera.files.recording import Recording, measured_size
from dvs_event_camera.files.writers import FORMATS, LazyWriter, format_of

_FAILED = 1


def parse_arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Command line of `convert_events`.

    Parameters
    ----------
    arguments
        Without the program's name; those of the process by default.
    """
    parser = argparse.ArgumentParser(
        prog='convert_events',
        description='Write the events of a file or bag in another format. Noise labels and '
        'triggers are kept.',
    )
    parser.add_argument('input', type=Path, help='file of events, or bag of ROS 2 or ROS 1')
    parser.add_argument('output', type=Path, help='file to write; its suffix chooses the format')
    parser.add_argument('--format', choices=FORMATS, help='format, if not that of the suffix')
    parser.add_argument('--topic', help='topic of the bag (default: the only one with events)')
    parser.add_argument(
        '--size', metavar='WIDTHxHEIGHT', help='size of the sensor, where the input lacks it'
    )
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Convert a recording; returns the exit code.

    Parameters
    ----------
    arguments
        Command line without the program's name; that of the process by default.
    """
    options = parse_arguments(arguments)
    try:
        return _convert(options)
    except SuiteError as error:
        print(f'convert_events: {error}', file=sys.stderr)
        return error.exit_code
    except OSError as error:
        name = error.filename or options.output
        print(f'convert_events: {name}: {error.strerror or error}', file=sys.stderr)
        return _FAILED


def _convert(options: argparse.Namespace) -> int:
    recording = open_recording(options.input, options.topic)
    if options.output.exists() and options.output.samefile(options.input):
        raise ParameterError('output', options.output, 'must be another file than the input')
    name = format_of(options.output, options.format)
    width, height = _size_of(options.size, recording)
    writer = LazyWriter(
        options.output,
        name,
        width=width,
        height=height,
        whole_microseconds=recording.whole_microseconds,
    )
    events = triggers = 0
    damage = None
    try:
        for stretch in recording.read():
            writer.add(stretch.events)
            events += len(stretch.events)
            triggers += len(stretch.events.triggers)
    except DamagedFile as error:
        damage = error
    writer.close()
    print(f'{options.output}: {events} events, {triggers} triggers')
    if damage:
        raise damage
    return 0


def _size_of(text: str | None, recording: Recording) -> tuple[int, int]:
    """Columns and rows of the sensor: as given, as in the recording, or as its events show."""
    if text:
        found = re.fullmatch(r'(\d+)x(\d+)', text)
        if not found:
            raise ParameterError('size', text, 'must be WIDTHxHEIGHT, such as 640x480')
        return int(found.group(1)), int(found.group(2))
    return measured_size(recording)


if __name__ == '__main__':
    sys.exit(main())
