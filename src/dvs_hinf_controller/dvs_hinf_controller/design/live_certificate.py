"""The certificate of the mean over the pixels that are used now."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from threading import Thread

import numpy as np
from numpy.typing import NDArray

from dvs_hinf_controller.design.design import Design, DesignFigures, measure
from dvs_hinf_controller.problem import unmasked

_NOT_YET = 'being worked out'
_UNSEEN = 'none: no pixel of a pixel group is left'


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveFigures:
    """Figures of the pixels that are used now, or why there are none.

    Parameters
    ----------
    figures
        None where there are none, or not yet.
    reason
        Why.
    error
        What went wrong while they were worked out.
    """

    figures: DesignFigures | None = None
    reason: str = ''
    error: Exception | None = None

    @property
    def delta_certified(self) -> float:
        """Certified uncertainty; 0 where nothing is known."""
        return self.figures.delta_certified if self.figures else 0.0

    def values(self, h: float) -> dict[str, object]:
        """What diagnostics show, by its name there.

        Parameters
        ----------
        h
            Event threshold that is in use.
        """
        figures, why = self.figures, self.reason
        return {
            'h': h,
            'h* (published)': figures.h_star if figures else why,
            'h_certified': figures.h_certified if figures else why,
            'h <= h*': h <= figures.h_star if figures else why,
            'h <= h_certified': h <= figures.h_certified if figures else why,
        }


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Measurement:
    """Figures of a set of pixels, or what is to become of them."""

    pixels: NDArray[np.bool_]
    figures: Future[DesignFigures]


class LiveCertificate:
    """Keeps the figures of a design true to the pixels that are used.

    For another set of pixels they are worked out beside the loop, which does not wait for them,
    nor does the end of the process.

    Parameters
    ----------
    design
        What runs; its figures are those of the pixels that are not masked.
    masked
        Row-major numbers of the pixels that are masked.
    """

    def __init__(self, design: Design, masked: Sequence[int] = ()) -> None:
        self._design = design
        self._designed_for = unmasked(design.problem.scene.pixel_count, masked)
        self._last: _Measurement | None = None

    def of(self, healthy: NDArray[np.bool_]) -> LiveFigures:
        """Figures of the mean over these pixels, as far as they are known.

        Parameters
        ----------
        healthy
            Pixels over which the mean goes, shape (r,).
        """
        if np.array_equal(healthy, self._designed_for):
            return LiveFigures(figures=self._design.figures)
        if not self._design.problem.sees_all_groups(healthy):
            return LiveFigures(reason=_UNSEEN)
        last = self._last
        if last is not None and not last.figures.done():
            return LiveFigures(reason=_NOT_YET)
        if last is None or not np.array_equal(healthy, last.pixels):
            self._last = self._begin(healthy.copy())
            return LiveFigures(reason=_NOT_YET)
        try:
            return LiveFigures(figures=last.figures.result())
        # A certificate that fails, whatever the reason, must not end the loop.
        except Exception as error:
            return LiveFigures(reason=f'none: {error}', error=error)

    def _begin(self, pixels: NDArray[np.bool_]) -> _Measurement:
        figures: Future[DesignFigures] = Future()
        Thread(target=self._measure, args=(pixels, figures), daemon=True).start()
        return _Measurement(pixels=pixels, figures=figures)

    def _measure(self, pixels: NDArray[np.bool_], figures: Future[DesignFigures]) -> None:
        try:
            problem = self._design.problem.of_pixels(pixels)
            figures.set_result(measure(problem, self._design.controller))
        # Whatever it is, it is reported where the figures are asked for.
        except Exception as error:
            figures.set_exception(error)
