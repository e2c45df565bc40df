"""Console script `dvs_event_camera`: the tools of the camera that need no ROS."""

from __future__ import annotations

from collections.abc import Sequence

from dvs_common.subcommands import Command, run_subcommand

COMMANDS = {
    'simulate_video': Command(
        module='dvs_event_camera.tools.simulate_video',
        summary='events of a video or a folder of pictures',
    ),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line of `dvs_event_camera`; returns the exit code.

    Parameters
    ----------
    arguments
        Command line without the program name; `sys.argv` by default.
    """
    return run_subcommand('dvs_event_camera', 'Event camera without ROS', COMMANDS, arguments)
