"""The folder that a command fills."""

from __future__ import annotations

from pathlib import Path

from dvs_common.errors import ParameterError


def output_folder(path: Path) -> Path:
    """Make the folder if it is not there; return it.

    Parameters
    ----------
    path
        The folder.

    Raises
    ------
    ParameterError
        If it is no folder or can't be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise ParameterError('output', path, 'is not a folder') from None
    except OSError as error:
        raise ParameterError('output', path, f"can't be made: {error.strerror}") from None
    return path
