"""Matplotlib without what a user has set for figures of their own: backend, matplotlibrc.

All figures are `Figure` objects written by Agg and SVG, which needs no backend. A notebook hands
its ``MPLBACKEND`` down to all that is started from it, and matplotlib refuses to be imported
where that backend is not installed. So whatever of matplotlib a module needs comes from here.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

_backend = os.environ.pop('MPLBACKEND', None) if 'matplotlib' not in sys.modules else None
try:
    import matplotlib as mpl
    from matplotlib import colormaps
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import to_rgb
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle
    from matplotlib.ticker import LogFormatter, MaxNLocator
finally:
    if _backend is not None:
        os.environ['MPLBACKEND'] = _backend
if _backend:
    # What matplotlib does itself; a missing backend is left to the module that needs one.
    with suppress(ValueError):
        mpl.rcParams['backend'] = _backend


__all__ = [
    'Axes',
    'Figure',
    'FigureCanvasAgg',
    'LogFormatter',
    'MaxNLocator',
    'Rectangle',
    'colormaps',
    'drawing',
    'to_rgb',
]


@contextmanager
def drawing(style: Mapping[str, Any] | None = None) -> Iterator[None]:
    """Context in which figures are made and written: matplotlib's defaults and a style.

    Parameters
    ----------
    style
        Settings that differ from the defaults.
    """
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(style or {})
        yield
