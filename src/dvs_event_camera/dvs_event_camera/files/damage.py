"""A recording that can be read in part only."""

from __future__ import annotations

from pathlib import Path

from dvs_common.errors import SuiteError


class DamagedFile(SuiteError):
    """A file that ends early or is broken in places; the rest was read.

    Parameters
    ----------
    path
        The file.
    reason
        What is wrong, as the end of the sentence "path: ".
    """

    def __init__(self, path: Path, reason: str) -> None:
        self.path = path
        self.reason = ' '.join(reason.split())
        super().__init__(f'{path}: {self.reason}; the rest was read')
