"""Launch file of the node `hinf_controller`."""

from launch import LaunchDescription

from dvs_common.node.launching import node_description


def generate_launch_description() -> LaunchDescription:
    """Return the node with its launch arguments."""
    return node_description('dvs_hinf_controller', 'hinf_controller')
