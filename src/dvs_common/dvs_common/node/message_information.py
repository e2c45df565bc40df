"""What the middleware reports of a message, beside the message itself."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

_TWO = inspect.Signature(
    [
        inspect.Parameter(name, inspect.Parameter.POSITIONAL_ONLY)
        for name in ('message', 'information')
    ]
)


class WithInformation:
    """Callback of a raw subscription that passes on a message and the information about it.

    rclpy gives its information about a message to a callback whose signature has two parameters.
    The `EventsExecutor` of rclpy 7.1 hands over both as one tuple.

    Parameters
    ----------
    take
        Called with the CDR bytes, and rclpy's information by name.
    """

    __signature__ = _TWO

    def __init__(self, take: Callable[[bytes, Mapping[str, Any]], None]) -> None:
        self._take = take

    def __call__(self, *received: Any) -> None:
        """Take a message and the information about it, as two arguments or as a tuple."""
        if len(received) == 2:
            self._take(*received)
        else:
            self._take(*received[0])


def publication_ns(information: Mapping[str, Any]) -> int | None:
    """Time of publication by the publisher's clock, ns; None where it is not known.

    Parameters
    ----------
    information
        See `WithInformation`.
    """
    return information['source_timestamp'] or None


class Arrivals:
    """Counts the messages of a publisher that never came, by the numbers that it gives them.

    Whatever dropped a message on its way, and where: history of the publisher, network, or queue
    of the subscriber.
    """

    def __init__(self) -> None:
        self._last: int | None = None

    def missed_before(self, information: Mapping[str, Any]) -> int:
        """Number of messages missing between the last one and this; 0 for another publisher's.

        Parameters
        ----------
        information
            See `WithInformation`.
        """
        number, last = information['publication_sequence_number'], self._last
        self._last = number
        return 0 if number is None or last is None else max(0, number - last - 1)
