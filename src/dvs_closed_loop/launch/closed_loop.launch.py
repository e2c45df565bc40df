"""Launch file of the whole loop; it ends, with a line, when any of its nodes ends."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, Shutdown

from dvs_closed_loop.running.launch_plan import ARGUMENTS, launch_plan
from dvs_common.node.launching import node_action, value_of


def _start(context: LaunchContext) -> list:
    given = {argument.name: value_of(context, argument.name) for argument in ARGUMENTS}
    plan = launch_plan(given)
    actions = [node_action(node, on_exit=[_end(node.name)]) for node in plan.partners]
    if plan.recorder:
        actions.append(ExecuteProcess(cmd=list(plan.recorder), output='screen'))
    if plan.viewer:
        actions.append(node_action(plan.viewer))
    actions.append(node_action(plan.plant, on_exit=[_end(plan.plant.name)]))
    return actions


def _end(name: str) -> Shutdown:
    """What follows the end of a node: a loop that lacks one is none."""
    return Shutdown(reason=f'{name} ended')


def generate_launch_description() -> LaunchDescription:
    """Return the loop with its launch arguments."""
    declared = [
        DeclareLaunchArgument(
            argument.name,
            default_value=argument.default,
            description=argument.description,
            choices=list(argument.choices) or None,
        )
        for argument in ARGUMENTS
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=_start)])
