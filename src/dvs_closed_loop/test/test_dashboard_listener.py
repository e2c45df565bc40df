"""The live page receives what publishers of any reliability send."""

import time

import pytest

pytest.importorskip('rclpy')

import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image, JointState

from dvs_closed_loop.dashboard.dashboard_listener import DashboardListener
from dvs_closed_loop.dashboard.live_view import LiveView

pytestmark = pytest.mark.processes


class Received(LiveView):
    """A view that notes which topics brought something."""

    def __init__(self):
        super().__init__()
        self.topics_received = set()

    def receive(self, topic, message):
        self.topics_received.add(topic)
        super().receive(topic, message)


@pytest.fixture
def nodes(domain):
    """A node that listens and one that publishes, in one domain."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain, args=[])
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    made = [rclpy.create_node(name, context=context) for name in ('page', 'others')]
    for node in made:
        executor.add_node(node)
    yield (*made, executor)
    executor.shutdown()
    for node in made:
        node.destroy_node()
    context.try_shutdown()


def test_the_page_takes_best_effort_and_reliable_publishers_alike(nodes, capfd):
    page, others, executor = nodes
    best_effort = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    images = others.create_publisher(Image, 'luminosity', best_effort)
    commands = others.create_publisher(JointState, 'command', 5)
    view = Received()
    listener = DashboardListener(page, view)
    end = time.monotonic() + 30

    while view.topics_received != {'luminosity', 'command'} and time.monotonic() < end:
        images.publish(Image(height=1, width=1, encoding='64FC1', step=8, data=bytes(8)))
        commands.publish(JointState(name=['u1'], effort=[0.0]))
        executor.spin_once(timeout_sec=0.05)
        listener.look()

    assert view.topics_received == {'luminosity', 'command'}
    said = capfd.readouterr().err
    assert said.count('luminosity has a publisher with best-effort QoS') == 1
    assert 'command has' not in said


def test_a_plant_in_place_of_the_one_before_is_another(nodes):
    page, others, executor = nodes
    listener = DashboardListener(page, LiveView())

    def found(condition):
        end = time.monotonic() + 30
        while not condition() and time.monotonic() < end:
            executor.spin_once(timeout_sec=0.05)
        return condition()

    first = others.create_publisher(Image, 'luminosity', 5)
    assert found(lambda: page.count_publishers('luminosity') == 1)
    assert not listener.finds_another_plant()
    # Another publisher of the same plant, and a pause without any.
    state = others.create_publisher(JointState, 'state', 5)
    assert found(lambda: page.count_publishers('state') == 1)
    assert not listener.finds_another_plant()
    others.destroy_publisher(first)
    others.destroy_publisher(state)
    assert found(lambda: not page.count_publishers('luminosity'))
    assert not listener.finds_another_plant()

    others.create_publisher(Image, 'luminosity', 5)
    assert found(lambda: page.count_publishers('luminosity') == 1)
    assert listener.finds_another_plant()
    assert not listener.finds_another_plant()
