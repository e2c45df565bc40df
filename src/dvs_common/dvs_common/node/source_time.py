"""When a message was published, beside the message itself."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

_TWO = inspect.Signature(
    [
        inspect.Parameter(name, inspect.Parameter.POSITIONAL_ONLY)
        for name in ('message', 'information')
    ]
)


class WithSourceTime:
    """Callback of a raw subscription that passes on a message and when it was published.

    rclpy gives its information about a message to a callback whose signature has two parameters.
    The `EventsExecutor` of rclpy 7.1 hands over both as one tuple.

    Parameters
    ----------
    take
        Called with the CDR bytes, and the time of publication by the publisher's clock, ns; None
        where the middleware does not know it.
    """

    __signature__ = _TWO

    def __init__(self, take: Callable[[bytes, int | None], None]) -> None:
        self._take = take

    def __call__(self, *received: Any) -> None:
        """Take a message and the information about it, as two arguments or as a tuple."""
        message, information = received if len(received) == 2 else received[0]
        self._take(message, information['source_timestamp'] or None)
