"""Events as points that any viewer of point clouds draws."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2, PointField

from dvs_event_camera.pixels.pixel_events import PixelEvents
from dvs_event_camera.streams.event_cloud import EventCloud, pack_cloud


def events(times_ns, pixels):
    ones = np.ones(len(times_ns), np.int8)
    return PixelEvents(
        t=np.array(times_ns, np.int64),
        pixel=np.array(pixels, np.int32),
        polarity=ones,
        sign=ones,
    )


@given(st.lists(st.tuples(st.integers(0, 10**9), st.integers(0, 11)), max_size=50))
def test_a_cloud_holds_the_events_of_its_window(found):
    found = sorted(found)
    cloud = EventCloud(width=4, window_s=0.5)
    for chunk in (found[: len(found) // 2], found[len(found) // 2 :]):
        cloud.add(events([t for t, _ in chunk], [p for _, p in chunk]), 10**9)
    points = cloud.points(10**9)

    recent = [(p % 4, p // 4, 1 - t * 1e-9) for t, p in found if t > 5 * 10**8]
    np.testing.assert_allclose(points.reshape(-1, 3), np.array(recent).reshape(-1, 3), atol=1e-6)


def test_ros_reads_the_points():
    points = np.array([[1, 2, 0.25], [3, 4, 0.5]], '<f4')
    cloud = deserialize_message(pack_cloud(1_500_000_000, points), PointCloud2)

    assert (cloud.header.stamp.sec, cloud.header.frame_id) == (1, 'pixels')
    assert [(f.name, f.offset, f.datatype) for f in cloud.fields] == [
        ('x', 0, PointField.FLOAT32),
        ('y', 4, PointField.FLOAT32),
        ('z', 8, PointField.FLOAT32),
    ]
    assert (cloud.width, cloud.height, cloud.point_step, cloud.row_step) == (2, 1, 12, 24)
    np.testing.assert_array_equal(np.frombuffer(cloud.data, '<f4').reshape(-1, 3), points)
