"""Node plans as launch actions. Only launch files import this: it needs ROS 2's `launch`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from dvs_common.node.node_plan import NodePlan, checked_namespace


def node_action(plan: NodePlan, *, on_exit: Sequence[Any] = ()) -> Node:
    """Launch action that starts a node as planned.

    Parameters
    ----------
    plan
        What to start.
    on_exit
        Actions that follow its end.
    """
    file = [] if plan.parameter_file is None else [str(plan.parameter_file)]
    parameters = [dict(plan.parameters)] if plan.parameters else []
    return Node(
        package=plan.package or None,
        executable=plan.executable,
        namespace=plan.namespace or None,
        parameters=[*file, *parameters],
        remappings=list(plan.remappings),
        arguments=list(plan.options),
        ros_arguments=plan.log_arguments,
        output='screen',
        on_exit=list(on_exit) or None,
    )


def value_of(context: LaunchContext, argument: str) -> str:
    """What the user gave for a launch argument.

    Parameters
    ----------
    context
        Context of the launch.
    argument
        Name of the argument.
    """
    return str(LaunchConfiguration(argument).perform(context))


def node_description(package: str, executable: str) -> LaunchDescription:
    """Launch description of one node, with the arguments `params_file` and `namespace`.

    Parameters
    ----------
    package
        Package of the executable.
    executable
        Name of the executable.
    """

    def start(context: LaunchContext) -> list[Node]:
        file = value_of(context, 'params_file')
        plan = NodePlan(
            package=package,
            executable=executable,
            parameter_file=Path(file) if file else None,
            namespace=checked_namespace(value_of(context, 'namespace')),
        )
        return [node_action(plan)]

    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'params_file', default_value='', description='Scenario (YAML); empty: defaults'
            ),
            DeclareLaunchArgument('namespace', default_value='', description='Namespace'),
            OpaqueFunction(function=start),
        ]
    )
