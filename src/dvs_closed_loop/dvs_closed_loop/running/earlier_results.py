"""Results of an earlier run, which give way when the next one has begun and not before."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

_ASIDE = '.earlier'


@contextmanager
def kept_aside(folder: Path, names: Sequence[str]) -> Iterator[Callable[[], None]]:
    """Move results aside; put them back unless the function that it gives is called meanwhile.

    Parameters
    ----------
    folder
        Where the results are, and those of the next run will be.
    names
        Files and folders in it.
    """
    aside = folder / _ASIDE
    _remove(aside)
    earlier = [name for name in names if (folder / name).exists()]
    aside.mkdir()
    for name in earlier:
        (folder / name).rename(aside / name)
    try:
        yield lambda: _remove(aside)
    finally:
        if aside.exists():
            for name in earlier:
                _remove(folder / name)
                (aside / name).rename(folder / name)
            _remove(aside)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
