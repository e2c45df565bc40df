"""Launch file of the node `event_camera`."""

from launch import LaunchDescription

from dvs_common.node.launching import node_description


def generate_launch_description() -> LaunchDescription:
    """Return the node with its launch arguments."""
    return node_description('dvs_event_camera', 'event_camera')
