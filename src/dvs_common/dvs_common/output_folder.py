"""The folder that a command fills, and the file that it writes there."""

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


def output_file(output: Path, name: str) -> Path:
    """File of a result: `output` itself if it ends as `name` does, else `name` in that folder.

    Parameters
    ----------
    output
        What the user named, a folder or a file.
    name
        What the file is called in a folder.

    Raises
    ------
    ParameterError
        If the folder can't be made.
    """
    if output.suffix == Path(name).suffix:
        return output
    return output_folder(output) / name
