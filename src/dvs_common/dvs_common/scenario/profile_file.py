"""Where a brightness profile comes from: a table, a picture or a function; and it as text."""

from __future__ import annotations

import importlib
import re
import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.errors import ParameterError
from dvs_common.scenario.brightness_profile import BrightnessProfile

TABLES = ('.csv', '.txt', '.tsv')
PICTURES = ('.png', '.jpg', '.jpeg', '.bmp', '.tif', '.tiff', '.pgm', '.ppm', '.webp')
# Averages of a picture's columns: a pixel sees an area, and one grey value is no slope.
_STRETCHES = 32
_FUNCTION_KNOTS = 257
# What a profile begins with that is no file but the knots themselves.
_KNOTS = 'knots '
_DEEP_MODES = ('I', 'I;16', 'I;16B', 'I;16L')


def read_profile(source: str, between: tuple[float, ...] = ()) -> BrightnessProfile:
    """Profile that a parameter names.

    Parameters
    ----------
    source
        Table with two columns, position and luminosity; or picture, its columns spread evenly
        over the range; or ``FILE.py:FUNCTION`` or ``module:function``, from an array of positions
        to one of luminosities; or what `as_text` returns.
    between
        Range of ``c'(x + dx)`` that a picture or function covers, two numbers.

    Raises
    ------
    ParameterError
        If it can't be read or is no profile.
    """
    if source.startswith(_KNOTS):
        return _of_lines(source[:32], source.removeprefix(_KNOTS).split(';'))
    suffix = Path(source).suffix.lower()
    if suffix in TABLES:
        if between:
            raise ParameterError('profile_range', list(between), 'is not for a table')
        return _of_table(Path(source))
    if suffix not in PICTURES and ':' not in source:
        raise ParameterError(
            'brightness_profile',
            source,
            f'must be a table ({", ".join(TABLES)}), a picture ({", ".join(PICTURES)}), '
            'FILE.py:FUNCTION or module:function',
        )
    if len(between) != 2 or not between[0] < between[1]:
        raise ParameterError(
            'profile_range',
            list(between),
            "must be two increasing numbers: the c'(x + dx) that brightness_profile covers",
        )
    return (_of_picture if suffix in PICTURES else _of_function)(source, *between)


def as_text(profile: BrightnessProfile) -> str:
    """Value of `brightness_profile` that needs no file: the knots with every digit.

    Parameters
    ----------
    profile
        What to write.
    """
    pairs = zip(profile.positions.tolist(), profile.luminosities.tolist(), strict=True)
    return _KNOTS + '; '.join(f'{position!r} {luminosity!r}' for position, luminosity in pairs)


def _refusal(source: object, rule: str) -> ParameterError:
    return ParameterError('brightness_profile', source, rule)


def _of_table(path: Path) -> BrightnessProfile:
    try:
        return _of_lines(path, path.read_text(encoding='utf-8').splitlines())
    except OSError as error:
        raise _refusal(path, f'cannot be read: {error.strerror}') from None
    except UnicodeDecodeError:
        raise _refusal(path, 'is not text') from None


def _of_lines(source: object, lines: list[str]) -> BrightnessProfile:
    rows: list[list[float]] = []
    may_be_heading = True
    for number, line in enumerate(lines, start=1):
        words = re.split(r'[,;\s]+', line.partition('#')[0].strip())
        if words == ['']:
            continue
        try:
            row = [float(word) for word in words]
        except ValueError:
            if may_be_heading and len(words) == 2:
                may_be_heading = False
                continue
            row = []
        may_be_heading = False
        if len(row) != 2:
            raise _refusal(source, f'must have a position and a luminosity in line {number}')
        rows.append(row)
    table = np.array(rows, np.float64).reshape(-1, 2)
    return BrightnessProfile(positions=table[:, 0], luminosities=table[:, 1])


def _of_picture(source: str, low: float, high: float) -> BrightnessProfile:
    """Means of equal stretches of the columns, at their middles and, carried on, at the ends."""
    try:
        image: Any = importlib.import_module('PIL.Image')
    except ImportError:
        raise _refusal(source, 'needs Pillow (python3-pil) to be read') from None
    try:
        with image.open(source) as opened:
            deep = opened.mode in _DEEP_MODES
            grey = np.asarray(opened if deep else opened.convert('L'), np.float64)
    except (OSError, ValueError, SyntaxError, image.DecompressionBombError) as error:
        raise _refusal(source, f'can not be read as a picture: {error}') from None
    columns = grey.mean(axis=0) / (65535 if deep else 255)
    count = min(_STRETCHES, columns.size)
    if count < 2:
        raise _refusal(source, 'must have two columns at least')
    edges = np.round(np.linspace(0, columns.size, count + 1)).astype(np.intp)
    means = np.add.reduceat(columns, edges[:-1]) / np.diff(edges)
    scale = (high - low) / columns.size
    middles = low + scale * (edges[:-1] + edges[1:]) / 2
    first = means[0] - (means[1] - means[0]) / (middles[1] - middles[0]) * (middles[0] - low)
    last = means[-1] + (means[-1] - means[-2]) / (middles[-1] - middles[-2]) * (high - middles[-1])
    return BrightnessProfile(
        positions=np.concatenate([[low], middles, [high]]),
        luminosities=np.concatenate([[first], means, [last]]),
    )


def _of_function(source: str, low: float, high: float) -> BrightnessProfile:
    """Values at evenly spaced positions; between them the profile is straight."""
    function = _function(source)
    positions = np.linspace(low, high, _FUNCTION_KNOTS)
    try:
        values = np.asarray(function(positions), np.float64)
    except Exception as error:
        raise _refusal(source, f'fails: {type(error).__name__}: {error}') from None
    if values.shape != positions.shape:
        rule = f'must give a luminosity for each position: {positions.shape} to {values.shape}'
        raise _refusal(source, rule)
    return BrightnessProfile(positions=positions, luminosities=values)


def _function(source: str) -> Callable[[FloatArray], Any]:
    where, _, name = source.rpartition(':')
    try:
        if where.endswith('.py'):
            found = runpy.run_path(where).get(name)
        else:
            found = getattr(importlib.import_module(where), name, None)
    except Exception as error:
        raise _refusal(source, f'can not be loaded: {type(error).__name__}: {error}') from None
    if not callable(found):
        raise _refusal(source, f'has no function {name}')
    return found  # type: ignore[no-any-return]
