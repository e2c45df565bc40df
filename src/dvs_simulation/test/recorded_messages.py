"""Messages of a small made-up run, as a recorder would have them."""

import numpy as np

from dvs_common.wire import topics
from dvs_common.wire.events import EVENT_DTYPE, EventPacket, pack_events
from dvs_common.wire.messages import (
    Vector,
    pack_command,
    pack_estimate,
    pack_image,
    pack_state,
)

MS = 1_000_000


def vector(stamp_ns, values, letter):
    names = tuple(f'{letter}{i + 1}' for i in range(len(values)))
    return Vector(stamp_ns=stamp_ns, names=names, values=np.array(values, dtype=float))


def recorded(samples, *, start_ns=0, pixels=(1, 3), events_per_sample=0):
    """Messages by topic; `samples` are rows of (state, luminosity, estimate)."""
    height, width = pixels
    messages = {topic: [] for topic in ('state', 'luminosity', 'events', 'command', 'estimate')}
    assert set(messages) == {
        topics.STATE,
        topics.LUMINOSITY,
        topics.EVENTS,
        topics.COMMAND,
        topics.ESTIMATE,
    }
    for k, (state, luminosity, estimate) in enumerate(samples):
        stamp_ns = start_ns + k * MS
        events = np.zeros(events_per_sample if k else 0, EVENT_DTYPE)
        events['t'] = -np.arange(len(events))[::-1] * 1000
        events['x'] = np.arange(len(events)) % width
        events['polarity'] = events['sign'] = 1
        image = np.array(luminosity, dtype=float).reshape(height, width)
        messages[topics.STATE].append(pack_state(vector(stamp_ns, state, 'x')))
        messages[topics.LUMINOSITY].append(pack_image(stamp_ns, image, '64FC1'))
        messages[topics.EVENTS].append(pack_events(EventPacket(stamp_ns=stamp_ns, events=events)))
        messages[topics.COMMAND].append(pack_command(vector(stamp_ns, [float(k)], 'u')))
        messages[topics.ESTIMATE].append(pack_estimate(stamp_ns, np.array(estimate, dtype=float)))
    return messages
