"""Estimates of former bags, without a stamp, as they are today."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from dvs_closed_loop.bags.recorded_message import RecordedMessage
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.messages import pack_estimate, parse_array
from dvs_common.wire.stamped import stamp_of
from dvs_common.wire.topics import COMMAND, ESTIMATE

FORMER_TYPE = 'std_msgs/msg/Float64MultiArray'


def of_today(messages: list[RecordedMessage]) -> list[RecordedMessage]:
    """Messages of a bag with stamped estimates in place of former ones.

    Parameters
    ----------
    messages
        In the order of their reception.
    """
    estimates = [message for message in messages if message.topic == ESTIMATE]
    commands = [message for message in messages if message.topic == COMMAND]
    today = [message for message in messages if message.topic != ESTIMATE]
    for estimate, command in zip(_partners(estimates, commands), commands, strict=True):
        if estimate is None:
            continue
        with suppress(MessageError):
            data = pack_estimate(stamp_of(command.data), parse_array(estimate.data))
            today.append(
                RecordedMessage(topic=ESTIMATE, received_ns=estimate.received_ns, data=data)
            )
    return sorted(today, key=lambda message: message.received_ns)


def _partners(
    estimates: list[RecordedMessage], commands: list[RecordedMessage]
) -> list[RecordedMessage | None]:
    """Estimate that belongs to each command.

    Estimates carry no stamp, but the controller publishes one just before each command. So they
    belong together in order, shifted by as many as the recording missed of either at its
    beginning; the shift is the one that brings their times of reception closest.
    """
    if not estimates:
        return [None] * len(commands)
    reach = abs(len(estimates) - len(commands)) + 1
    received = np.array([message.received_ns for message in estimates])
    answered = np.array([message.received_ns for message in commands])

    def distance(shift: int) -> float:
        first, last = max(0, -shift), min(len(commands), len(estimates) - shift)
        if first >= last:
            return np.inf
        apart = answered[first:last] - received[first + shift : last + shift]
        return float(np.median(np.abs(apart)))

    shift = min(sorted(range(-reach, reach + 1), key=abs), key=distance)
    if len(estimates) == len(commands):
        shift = 0
    return [
        estimates[i + shift] if 0 <= i + shift < len(estimates) else None
        for i in range(len(commands))
    ]
