"""The certificate of the mean over the pixels that are used now."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from dvs_hinf_controller.design.design import Design, measure
from dvs_hinf_controller.problem import unmasked


class LiveCertificate:
    """Keeps delta_certified true to the pixels that are used.

    For another set of pixels it is worked out beside the loop, which does not wait for it; until
    then nothing is certified.

    Parameters
    ----------
    design
        What runs; its figures are those of the pixels that are not masked.
    masked
        Row-major numbers of the pixels that are masked.
    """

    def __init__(self, design: Design, masked: Sequence[int] = ()) -> None:
        self._design = design
        self._pixels = unmasked(design.problem.scene.pixel_count, masked)
        self._delta = design.figures.delta_certified
        self._beside = ThreadPoolExecutor(max_workers=1)
        self._running: Future[float] | None = None

    def of(self, healthy: NDArray[np.bool_]) -> float:
        """Error up to which the tolerance is guaranteed; 0 until it is known.

        Parameters
        ----------
        healthy
            Pixels over which the mean goes, shape (r,).
        """
        if not np.array_equal(healthy, self._pixels):
            self._pixels = healthy.copy()
            self._running = self._beside.submit(self._measured, self._pixels)
        if self._running is not None and self._running.done():
            self._delta, self._running = self._running.result(), None
        return 0.0 if self._running is not None else self._delta

    def _measured(self, pixels: NDArray[np.bool_]) -> float:
        problem = self._design.problem.of_pixels(pixels)
        return measure(problem, self._design.controller).delta_certified
