"""Reading of diagnostic_msgs/DiagnosticArray."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dvs_common.wire.cdr import CdrReader


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """What a node reports of itself.

    Parameters
    ----------
    name
        Full name of the node, without the first slash.
    level
        0 OK, 1 WARN, 2 ERROR, 3 STALE.
    message
        What is not as it should be.
    values
        Figures by name.
    """

    name: str
    level: int
    message: str
    values: Mapping[str, str]

    @property
    def node(self) -> str:
        """Name of the node without its namespace."""
        return self.name.rpartition('/')[2]


def parse_diagnostics(message: bytes) -> list[Status]:
    """Status of every node in a message.

    Parameters
    ----------
    message
        CDR bytes.

    Raises
    ------
    MessageError
        If the bytes are no such message.
    """
    reader = CdrReader(message)
    reader.stamp()
    reader.text()
    return [_status(reader) for _ in range(reader.u32())]


def _status(reader: CdrReader) -> Status:
    level = reader.u8()
    name, message, _hardware = reader.text(), reader.text(), reader.text()
    values = {}
    for _ in range(reader.u32()):
        key = reader.text()
        values[key] = reader.text()
    return Status(name=name, level=level, message=message, values=values)
