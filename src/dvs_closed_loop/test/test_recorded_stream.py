"""A recorded stream of a sensor, cropped to the loop's pixels, runs through the controller."""

import numpy as np
import pytest
from sensor_encoders import SAMPLES, caer_cmp_words, packet_message, some_events

from dvs_common.scenario.scenario import Scenario
from dvs_event_camera.files.bag_file import BagFile
from dvs_event_camera.streams.packet_bridge import PacketBridge
from dvs_event_camera.streams.pixel_map import PixelMap
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_hinf_controller.running.event_controller import EventController

MS = 10**6
EPOCH = 1_700_000_000_000_000_000


def controller(rows, columns):
    """A controller of that many pixels, with what it needs of its scenario."""
    changes = {
        'method': 'unstructured',
        'pixel_grid': [rows, columns],
        'pixel_offsets': np.repeat(np.linspace(1.0, 1.3, rows * columns), 2).tolist(),
    }
    scenario = Scenario.from_values(changes)
    design = design_from_scenario(scenario)
    return EventController(
        design.problem,
        design.controller,
        event_threshold=0.001,
        command_limit=np.full(design.problem.model.input_matrix.shape[1], 1e3),
    )


def recorded_messages():
    with BagFile(SAMPLES / 'ecp_test_events_2') as bag:
        yield from (message.data for message in bag.messages())


def made_messages():
    """Packets of a sensor of 346 x 260 pixels whose header stamps jitter by 4 ms."""
    rng = np.random.default_rng(1)
    for k in range(100):
        events = some_events(2000, seed=k, start_us=10_000 * k, span_us=9_900)
        base = int(events.t[0])
        yield packet_message(
            caer_cmp_words(events, base),
            'libcaer_cmp',
            stamp_ns=EPOCH + base + round(rng.exponential(4 * MS)),
            sequence=k,
            time_base=base,
        )


RECORDED = pytest.param(
    recorded_messages,
    marks=pytest.mark.skipif(not SAMPLES.exists(), reason='no recordings here'),
)


@pytest.mark.parametrize('messages', [made_messages, RECORDED])
@pytest.mark.parametrize(
    ('pixel_map', 'shape'),
    [
        (PixelMap(region=(160, 120, 3, 1)), (1, 3)),
        (PixelMap(region=(93, 50, 160, 160), binning=10), (16, 16)),
    ],
)
def test_a_cropped_stream_runs_without_a_false_restart_or_loss(messages, pixel_map, shape):
    bridge, loop = PacketBridge(pixel_map), controller(*shape)
    taken, stamps = 0, []
    for message in messages():
        for packet in bridge.take(message):
            report = loop.take(packet)
            assert not report.restarted
            assert report.lost_events == 0
            assert np.all(np.isfinite(loop.command))
            taken += len(packet.events)
            stamps.append(packet.stamp_ns)

    assert taken > 0
    assert len(stamps) >= 100
    # The whole of it: one second of events, as the sensor counted it.
    assert stamps[-1] - stamps[0] == pytest.approx(990 * MS, rel=0.02)
