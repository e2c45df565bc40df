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

    def of(self, healthy: NDArray[np.bool_]) -> DesignFigures | None:
        """Figures of the mean over these pixels; None until they are known.

        Parameters
        ----------
        healthy
            Pixels over which the mean goes, shape (r,).

        Raises
        ------
        SuiteError
            If there are none for these pixels.
        """
        if np.array_equal(healthy, self._designed_for):
            return self._design.figures
        last = self._last
        if last is not None and not last.figures.done():
            return None
        if last is None or not np.array_equal(healthy, last.pixels):
            self._last = self._begin(healthy.copy())
            return None
        return last.figures.result()

    def _begin(self, pixels: NDArray[np.bool_]) -> _Measurement:
        figures: Future[DesignFigures] = Future()
        Thread(target=self._measure, args=(pixels, figures), daemon=True).start()
        return _Measurement(pixels=pixels, figures=figures)

    def _measure(self, pixels: NDArray[np.bool_], figures: Future[DesignFigures]) -> None:
        try:
            problem = self._design.problem.of_pixels(pixels)
            figures.set_result(measure(problem, self._design.controller))
        # Whatever it is, it is raised where the figures are asked for.
        except Exception as error:
            figures.set_exception(error)
