"""Record the loop's topics to a bag, as `ros2 bag record` does, where there is no rosbag2.

Ends on Ctrl-C, after --duration, or on a full disk; the bag is readable in every case. The exit
code is 0 unless the disk was full.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dvs_closed_loop.bags.bag_recorder import BagRecorder
    from dvs_closed_loop.bags.recording import BagWriter

_TURN_S = 0.1
_ASK_PERIOD_S = 1.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `record`.

    Parameters
    ----------
    parser
        Parser to extend.
    """
    parser.add_argument(
        'bag', type=Path, nargs='?', help='folder of the bag (default: dvs_DATE_TIME)'
    )
    parser.add_argument('--duration', type=float, help='wall-clock seconds (default: no end)')
    parser.add_argument('--storage', choices=('mcap', 'sqlite3'), default='mcap')
    parser.add_argument(
        '--topics',
        nargs='+',
        metavar='TOPIC',
        help='topics of the wire contract (default: all '
        'but those made only while there is a subscriber)',
    )
    parser.add_argument(
        '--params-file', type=Path, help='scenario to store in the bag (default: ask the nodes)'
    )
    parser.add_argument('--namespace', default='', help='namespace of the loop')


def run(options: argparse.Namespace) -> int:
    """Record until the end; returns the exit code.

    Parameters
    ----------
    options
        Parsed arguments.

    Raises
    ------
    SuiteError
        If the bag exists or can't grow, or an argument breaks its rule.
    """
    from dvs_closed_loop.bags.bag_recorder import BagRecorder
    from dvs_closed_loop.bags.recording import BagWriter
    from dvs_closed_loop.bags.streams import chosen_streams
    from dvs_closed_loop.running.loop_parameters import LoopParameters
    from dvs_closed_loop.running.tool import tool_node
    from dvs_common.errors import ParameterError
    from dvs_common.scenario.scenario import load_scenario

    if options.duration is not None and not options.duration > 0:
        raise ParameterError('duration', options.duration, 'must be > 0')
    streams = chosen_streams(options.topics)
    path = options.bag or Path(time.strftime('dvs_%Y_%m_%d-%H_%M_%S'))
    scenario = load_scenario(options.params_file) if options.params_file else None
    name = options.params_file.stem if options.params_file else path.name
    with tool_node('bag_recorder', options.namespace, options.ros_arguments) as tool:
        names = {tool.node.resolve_topic_name(s.topic): s.type_name for s in streams}
        parameters = LoopParameters(tool.node)
        with BagWriter(path, names, storage=options.storage) as bag:
            recorder = BagRecorder(tool.node, streams, bag)
            # A loop started after this line is recorded whole, as far as DDS delivers.
            print(f'recording {len(streams)} topics to {path}/', flush=True)
            started = time.monotonic()
            next_question = started
            if scenario is not None:
                recorder.keep_scenario(scenario, name)
            with _Progress(recorder, bag) as progress:
                while not tool.stop.received and recorder.failure is None:
                    elapsed = time.monotonic() - started
                    if options.duration is not None and elapsed >= options.duration:
                        break
                    for line in recorder.adapt():
                        progress.write(line)
                    for topic in recorder.newly_received():
                        progress.write(f'receives {topic}')
                    has_scenario = scenario is not None or parameters.complete
                    if not has_scenario and time.monotonic() >= next_question:
                        parameters.ask()
                        next_question = time.monotonic() + _ASK_PERIOD_S
                        if parameters.complete and parameters.scenario is not None:
                            recorder.keep_scenario(parameters.scenario, name)
                    tool.spin(_TURN_S)
                    recorder.keep_up()
                    progress.update(elapsed)
            if scenario is None and parameters.scenario is not None:
                recorder.keep_scenario(parameters.scenario, name)
    print(_summary(recorder, path))
    if recorder.failure is not None:
        print(f'dvs_closed_loop record: {recorder.failure}', file=sys.stderr)
        return 1
    return 0


def _summary(recorder: BagRecorder, path: Path) -> str:
    counts = ', '.join(f'{topic} {count}' for topic, count in recorder.counts.items() if count)
    written = f'{path}/: {counts or "nothing received"}'
    if not recorder.watched:
        return written
    index = recorder.index
    losses = f'{index.lost} EVENTS LOST in {index.gaps} gaps' if index.lost else 'no event lost'
    if index.restarts:
        losses += f'; the camera started again ({index.restarts} times)'
    if index.first_index:
        losses += f'; the recording began at event {index.first_index}'
    return f'{written}\n  {index.events} events, {losses}'


class _Progress:
    """One line: messages, events a second, size."""

    def __init__(self, recorder: BagRecorder, bag: BagWriter) -> None:
        from tqdm import tqdm

        self._recorder = recorder
        self._bag = bag
        self._bar = tqdm(
            unit=' messages', desc='recording', file=sys.stderr, disable=None, mininterval=0
        )
        self._shown = (0.0, 0)

    def __enter__(self) -> _Progress:
        """Return itself."""
        return self

    def __exit__(self, *exception: object) -> None:
        """Leave the last line on the screen."""
        self._bar.close()

    def write(self, line: str) -> None:
        """Print a line above the progress.

        Parameters
        ----------
        line
            Text.
        """
        self._bar.write(line, file=sys.stdout)
        sys.stdout.flush()

    def update(self, elapsed_s: float) -> None:
        """Show the present figures, twice a second.

        Parameters
        ----------
        elapsed_s
            Wall-clock time since the start, s.
        """
        shown_s, shown_events = self._shown
        if self._bar.disable or elapsed_s - shown_s < 0.5:
            return
        index = self._recorder.index
        rate = (index.events - shown_events) / (elapsed_s - shown_s)
        self._shown = (elapsed_s, index.events)
        self._bar.n = sum(self._recorder.counts.values())
        lost = f', {index.lost} LOST' if index.lost else ''
        self._bar.set_postfix_str(
            f'{rate:.0f} events/s{lost}, {self._bag.size_bytes / 1e6:.1f} MB', refresh=True
        )
