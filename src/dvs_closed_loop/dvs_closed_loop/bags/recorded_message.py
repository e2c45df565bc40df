"""One message of a bag."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedMessage:
    """One message of a bag.

    Parameters
    ----------
    topic
        Topic of the wire contract.
    received_ns
        Time of reception, ns.
    data
        CDR bytes.
    """

    topic: str
    received_ns: int
    data: bytes
