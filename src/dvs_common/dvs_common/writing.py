"""Output files that are whole or not there at all; what goes wrong names the file."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from dvs_common.errors import SuiteError


class WriteError(SuiteError):
    """A file that can't be written.

    Parameters
    ----------
    path
        The file.
    reason
        What keeps it from being written.
    """

    def __init__(self, path: str | Path, reason: str) -> None:
        super().__init__(f'{path}: cannot be written: {reason}')


@contextmanager
def naming_file(path: str | Path) -> Iterator[None]:
    """Context in which a failure of the operating system names the file that is being written.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    WriteError
        Instead of OSError.
    """
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise WriteError(path, error.strerror or str(error)) from None


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Draft of a file, beside it and with the same ending; takes its place once it is whole.

    A draft that fails leaves nothing behind, and what was there before stays. What is no regular
    file, as /dev/stdout, is written directly.

    Parameters
    ----------
    path
        File to write.

    Raises
    ------
    WriteError
        If it can't be written.
    """
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise WriteError(path, 'is a folder')
    if target.exists() and not target.is_file():
        with naming_file(path):
            yield target
        return
    draft = target.with_name(f'.{target.stem[:100]}.{os.getpid()}{target.suffix}')
    try:
        with naming_file(path):
            yield draft
            with draft.open('rb+') as file:
                os.fsync(file.fileno())
            draft.replace(target)
    finally:
        with suppress(OSError):
            draft.unlink()


def write_text(path: str | Path, text: str) -> None:
    """Write a UTF-8 text file, whole or not at all.

    Parameters
    ----------
    path
        File to write.
    text
        Its content.

    Raises
    ------
    WriteError
        If it can't be written.
    """
    with whole_file(path) as draft:
        draft.write_text(text, encoding='utf-8', newline='')
