"""More events in one interval than anyone can hold."""

from __future__ import annotations

from dvs_common.errors import SuiteError

# Events of one interval: about 600 MB on their way through the camera.
MOST_EVENTS = 10_000_000
# N is an int32.
MOST_STEPS = 2.0**31 - 2


class EventFlood(SuiteError):
    """A change of the light that would make more than `MOST_EVENTS` events in one interval.

    Parameters
    ----------
    events
        Events that the interval would have at least.
    """

    def __init__(self, events: float) -> None:
        super().__init__(
            f'the light has changed by {events:.3g} events or more between two frames; the limit '
            f'of one frame is {MOST_EVENTS:.0e}'
        )
        self.events = events


def require_bounded(events: float, farthest: float = 0.0) -> None:
    """Raise `EventFlood` unless an interval has at most `MOST_EVENTS` events.

    Parameters
    ----------
    events
        Events of the interval so far.
    farthest
        Largest distance of a level from its first reference, in steps.
    """
    if events > MOST_EVENTS or farthest > MOST_STEPS:
        raise EventFlood(max(events, farthest))
