"""Designs are found once and kept on disk: node, `closed_loop` and `report` ask for the same one.

What is kept is named by all that a design depends on: problem, method, options, the source of the
suite and the libraries that it calculates with. A change of any of them finds the design anew, and
so does a file that is not as it was written.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy

import dvs_common
import dvs_hinf_controller
from dvs_common.writing import WriteError, write_text

# The oldest go beyond that; one has some kilobytes.
_MOST_KEPT = 500


def kept(asked: Sequence[object], find: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return what was found before for the same question, or find it and keep it.

    Parameters
    ----------
    asked
        All that the answer depends on but code and libraries: dataclasses, arrays, numbers, text.
        With anything else in it nothing is kept.
    find
        Finds the answer: an object that JSON holds, with infinities.

    Returns
    -------
    dict
        The answer as JSON gives it back, whether it was found before or now.
    """
    path = _path(asked)
    text = _read(path)
    if text is None:
        text = json.dumps(find())
        _write(path, text)
    answer: dict[str, Any] = json.loads(text)
    return answer


def _path(asked: Sequence[object]) -> Path | None:
    """Where the answer is kept; None where it can't be."""
    folder, source = _folder(), _source()
    if folder is None or source is None:
        return None
    versions = f'{np.__version__} {scipy.__version__}'.encode()
    try:
        return folder / f'{_digest([source, versions, *_parts(asked)])}.json'
    except TypeError:
        return None


def _folder() -> Path | None:
    """Where designs are kept; None where the user has no home, or an empty DVS_CACHE."""
    if (named := os.environ.get('DVS_CACHE')) is not None:
        return Path(named) / 'designs' if named else None
    # The XDG Base Directory Specification has a relative path ignored.
    caches = Path(os.environ.get('XDG_CACHE_HOME', ''))
    if not caches.is_absolute():
        try:
            home = Path.home()
        except RuntimeError:
            return None
        if not home.is_absolute() or not home.is_dir():
            return None
        caches = home / '.cache'
    return caches / 'dvs' / 'designs'


def _read(path: Path | None) -> str | None:
    """Return what was kept; None where nothing was, or it is not as it was written."""
    if path is None:
        return None
    try:
        digest, _, text = path.read_text(encoding='utf-8').partition('\n')
    except (OSError, ValueError):
        return None
    return text if digest == _digest([text.encode()]) else None


def _write(path: Path | None, text: str) -> None:
    """Keep an answer; where nothing can be written, the next one finds it again."""
    if path is None:
        return
    with suppress(OSError, WriteError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, f'{_digest([text.encode()])}\n{text}')
        _drop_the_oldest(path.parent)


def _drop_the_oldest(folder: Path) -> None:
    written = sorted((file.stat().st_mtime_ns, file) for file in folder.glob('*.json'))
    for _, file in written[:-_MOST_KEPT]:
        file.unlink(missing_ok=True)


def _parts(value: object) -> Iterator[bytes]:
    """Bytes that tell a value from every other one."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield f'{type(value).__qualname__}'.encode()
        for field in dataclasses.fields(value):
            if field.compare:
                yield field.name.encode()
                yield from _parts(getattr(value, field.name))
    elif isinstance(value, np.ndarray):
        yield f'array {value.dtype.str} {value.shape}'.encode()
        yield value.tobytes()
    elif isinstance(value, (tuple, list)):
        yield f'{type(value).__name__} {len(value)}'.encode()
        for entry in value:
            yield from _parts(entry)
    elif value is None or isinstance(value, (bool, int, float, str)):
        yield f'{type(value).__name__} {value!r}'.encode()
    else:
        raise TypeError(f'a {type(value).__name__} is not named by its value')


@cache
def _source() -> bytes | None:
    """SHA-256 of the code that designs; None where it is installed without."""
    files = [
        (file.relative_to(folder.parent), file)
        for folder in (Path(dvs_common.__path__[0]), Path(dvs_hinf_controller.__path__[0]))
        for file in sorted(folder.rglob('*.py'))
    ]
    parts = (part for name, file in files for part in (str(name).encode(), file.read_bytes()))
    return _digest(parts).encode() if files else None


def _digest(parts: Iterable[bytes]) -> str:
    """SHA-256 of several parts, whose lengths count too."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(f'{len(part)}\n'.encode() + part)
    return digest.hexdigest()
