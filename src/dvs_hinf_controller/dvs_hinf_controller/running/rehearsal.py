"""A controller that takes a packet before the first real one, so that what it runs is loaded."""

from __future__ import annotations

import numpy as np

from dvs_common.wire.events import EventPacket, make_events, pack_events, parse_events
from dvs_hinf_controller.running.event_controller import EventController
from dvs_hinf_controller.running.pixel_turns import WORTH_COMPILING, kernels_for


def rehearse(controller: EventController) -> None:
    """Load the compiled code for packets of many events: the first would wait for a second.

    A controller of few pixels, which needs none, is left as it is.

    Parameters
    ----------
    controller
        Controller that is of no further use: it has taken an event of each of many pixels.
    """
    scene = controller.problem.scene
    if kernels_for(scene.pixel_count) is None:
        return
    count = WORTH_COMPILING
    ones = np.ones(count, np.int8)
    events = make_events(
        times_ns=np.zeros(count, np.int64),
        pixels=np.arange(count),
        polarities=ones,
        signs=ones,
        width=scene.width,
        stamp_ns=0,
        first_index=0,
    )
    controller.take(parse_events(pack_events(EventPacket(stamp_ns=0, events=events))))
