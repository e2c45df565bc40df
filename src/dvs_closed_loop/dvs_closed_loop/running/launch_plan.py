"""What `closed_loop.launch.py` starts for given arguments; needs no `launch` to be tested."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import yaml
from ament_index_python.packages import get_package_share_directory

from dvs_closed_loop.running.loop_plan import given, loop_plan, scenario_file
from dvs_common.errors import ParameterError
from dvs_common.node.node_plan import LOG_LEVELS, NodePlan, checked_namespace
from dvs_common.scenario.parameters import SCHEMA
from dvs_common.scenario.scenario import load_scenario
from dvs_common.wire import topics
from dvs_common.writing import write_text

_RECORDED = (
    topics.LUMINOSITY,
    topics.EVENTS,
    topics.KEYFRAME,
    topics.ANCHOR,
    topics.COMMAND,
    topics.STATE,
    topics.ESTIMATE,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class LaunchArgument:
    """An argument of the launch file.

    Parameters
    ----------
    name
        Name, as in ``name:=value``.
    description
        What it means.
    default
        Value where the user gives none.
    choices
        Allowed values; empty for free text.
    """

    name: str
    description: str
    default: str = ''
    choices: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Viewer:
    """A program to look at the loop with.

    Parameters
    ----------
    package
        Its package.
    executable
        Its executable.
    layout
        Name of its layout file in share/dvs_closed_loop/layouts, or empty.
    layout_option
        Option that takes the layout.
    """

    package: str
    executable: str
    layout: str = ''
    layout_option: str = ''

    @property
    def plan(self) -> NodePlan:
        """How to start it, with its layout if that is installed."""
        options: tuple[str, ...] = ()
        if self.layout:
            share = Path(get_package_share_directory('dvs_closed_loop'))
            file = share / 'layouts' / self.layout
            options = (self.layout_option, str(file)) if file.is_file() else ()
        return NodePlan(package=self.package, executable=self.executable, options=options)


VIEWERS = {
    'rqt': Viewer(
        package='rqt_gui',
        executable='rqt_gui',
        layout='rqt.perspective',
        layout_option='--perspective-file',
    ),
    'plotjuggler': Viewer(
        package='plotjuggler',
        executable='plotjuggler',
        layout='plotjuggler.xml',
        layout_option='--layout',
    ),
    'rviz': Viewer(package='rviz2', executable='rviz2', layout='rviz.rviz', layout_option='-d'),
    'foxglove': Viewer(package='foxglove_bridge', executable='foxglove_bridge'),
}

ARGUMENTS = (
    LaunchArgument(
        name='scenario',
        default='paper_r3',
        description='Parameter file (YAML), or the name of a scenario of the suite',
    ),
    LaunchArgument(
        name='params_file',
        description='Parameter file (YAML) of the scenario, instead of `scenario`',
    ),
    LaunchArgument(name='namespace', description='Namespace of the whole loop'),
    LaunchArgument(
        name='use_sim_time',
        choices=('', 'true', 'false'),
        description='Whether the clocks of the nodes follow /clock',
    ),
    LaunchArgument(
        name='log_level',
        choices=('', *LOG_LEVELS),
        description='Least severity that the nodes log; empty: info',
    ),
    LaunchArgument(
        name='mode',
        choices=('', *SCHEMA['mode'].choices),
        description="Instead of the scenario's mode",
    ),
    LaunchArgument(
        name='method',
        description="Instead of the scenario's synthesis method",
    ),
    LaunchArgument(
        name='elsewhere',
        description='Nodes that are started elsewhere: event_camera, hinf_controller or both, '
        'with a blank between',
    ),
    LaunchArgument(name='record', description='Folder of a bag to record; empty: none'),
    LaunchArgument(
        name='viewer',
        default='none',
        choices=('none', *VIEWERS),
        description='Program to look at the loop with; must be installed',
    ),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class LaunchPlan:
    """Everything that the launch file starts.

    Parameters
    ----------
    partners
        Camera and controller, as far as they are not elsewhere.
    plant
        The plant; the launch ends with it.
    recorder
        Command line that records a bag, or empty.
    viewer
        Program to look with, or None.
    """

    partners: tuple[NodePlan, ...]
    plant: NodePlan
    recorder: tuple[str, ...]
    viewer: NodePlan | None


def launch_plan(arguments: Mapping[str, str]) -> LaunchPlan:
    """Plan of a launch.

    Parameters
    ----------
    arguments
        Values of `ARGUMENTS` by name; defaults where one is missing.

    Raises
    ------
    ParameterError
        If an argument is unknown or its value is not allowed, or the scenario is not sound.
    """
    values = {argument.name: argument.default for argument in ARGUMENTS}
    for name, value in arguments.items():
        if name not in values:
            raise ParameterError(name, value, 'is not an argument of closed_loop.launch.py')
        values[name] = value
    for argument in ARGUMENTS:
        if argument.choices and values[argument.name] not in argument.choices:
            raise ParameterError(
                argument.name,
                values[argument.name],
                f'must be one of {", ".join(argument.choices)}'.replace(' ,', ''),
            )
    file = scenario_file(values['params_file'] or values['scenario'])
    parameters = given(mode=values['mode'], method=values['method'])
    scenario = load_scenario(file, namespace=checked_namespace(values['namespace']))
    *partners, plant = loop_plan(
        scenario.replace(**parameters),
        file,
        namespace=values['namespace'],
        parameters=parameters,
        elsewhere=values['elsewhere'].split(),
    )
    viewer = VIEWERS.get(values['viewer'])
    chosen = partial(_as_chosen, values=values)
    return LaunchPlan(
        partners=tuple(map(chosen, partners)),
        plant=chosen(plant),
        recorder=record_command(values['record'], values['namespace']),
        viewer=viewer.plan if viewer else None,
    )


def _as_chosen(plan: NodePlan, values: Mapping[str, str]) -> NodePlan:
    """Plan with what belongs to ROS: the source of time and the level of the log."""
    parameters = dict(plan.parameters)
    if values['use_sim_time']:
        parameters['use_sim_time'] = values['use_sim_time'] == 'true'
    return replace(plan, parameters=parameters, log_level=values['log_level'])


def record_command(folder: str, namespace: str) -> tuple[str, ...]:
    """Command line of `ros2 bag record` for the topics of a loop, or nothing.

    Parameters
    ----------
    folder
        Folder of the bag; empty for no recording.
    namespace
        Namespace of the loop.
    """
    if not folder:
        return ()
    prefix = checked_namespace(namespace)
    names = [f'{prefix}/{topic}' for topic in _RECORDED]
    clock = prefix + topics.CLOCK
    return (
        *('ros2', 'bag', 'record', '--storage', 'mcap', '--output', folder),
        *('--qos-profile-overrides-path', str(_record_qos(Path(folder), prefix))),
        *(*names, clock, topics.DIAGNOSTICS),
    )


def _record_qos(folder: Path, prefix: str) -> Path:
    """File of QoS for the recorder: the installed one, or beside the bag one with a namespace."""
    installed = Path(get_package_share_directory('dvs_closed_loop')) / 'config/qos/record.yaml'
    if not prefix:
        return installed
    profiles = yaml.safe_load(installed.read_text(encoding='utf-8'))
    named = {
        name if name == topics.DIAGNOSTICS else prefix + name: qos
        for name, qos in profiles.items()
    }
    own = folder.with_name(f'{folder.name}_qos.yaml')
    write_text(own, yaml.safe_dump(named))
    return own
