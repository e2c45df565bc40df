"""A rehearsed controller has loaded all that its first packets run."""

import numpy as np
import pytest

from dvs_common.scenario.scenario import Scenario
from dvs_common.wire.events import EventPacket, make_events
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_hinf_controller.running.make_controller import event_controller
from dvs_hinf_controller.running.pixel_turns import kernels_for
from dvs_hinf_controller.running.rehearsal import rehearse

MS = 1_000_000


def packet(count, stamp_ns, first_index):
    ones = np.ones(count, np.int8)
    events = make_events(
        times_ns=np.full(count, stamp_ns),
        pixels=np.arange(count),
        polarities=-ones,
        signs=ones,
        width=64,
        stamp_ns=stamp_ns,
        first_index=first_index,
    )
    events.flags.writeable = False
    return EventPacket(stamp_ns=stamp_ns, events=events)


def test_nothing_is_left_to_load_for_the_packets_after_it():
    kernels = kernels_for(4096)
    if kernels is None:
        pytest.skip('no numba')
    values = {
        'pixel_offsets': [],
        'pixel_grid': [64, 64],
        'pixel_pitch': [0.0003, 0.0, 0.0, 0.0003],
    }
    scenario = Scenario.from_values({**values, 'method': 'unstructured'})
    design = design_from_scenario(scenario)
    compiled = [entry for entry in vars(kernels).values() if hasattr(entry, 'py_func')]
    rehearse(event_controller(design, scenario))
    before = [len(entry.signatures) for entry in compiled]
    controller = event_controller(design, scenario)
    for k in range(5):
        controller.take(packet(4096, (k + 1) * MS, k * 4096))

    assert any(before)
    assert [len(entry.signatures) for entry in compiled] == before
    assert np.all(controller.counts == -5)


def test_a_controller_of_few_pixels_is_left_as_it_is():
    scenario = Scenario.from_values({})
    controller = event_controller(design_from_scenario(scenario), scenario)
    rehearse(controller)

    assert not controller.counts.any()
