"""A publisher whose messages are made only while it has subscribers."""

from __future__ import annotations

from typing import Any

from dvs_common.node.direct_calls import AnyPublisher


class DemandedPublisher:
    """Publisher whose messages are made only while it has a subscriber.

    Asking the middleware for the number of subscribers takes longer than many a message: `wanted`
    is looked up ten times a second.

    Parameters
    ----------
    publisher
        Publisher of the topic.
    """

    def __init__(self, publisher: AnyPublisher) -> None:
        self._publisher = publisher
        self.wanted = False

    def look(self) -> None:
        """Find out whether there is a subscriber."""
        self.wanted = self._publisher.get_subscription_count() > 0

    def publish(self, message: Any) -> None:
        """Publish a message object or a serialized one.

        Parameters
        ----------
        message
            What to publish.
        """
        self._publisher.publish(message)
