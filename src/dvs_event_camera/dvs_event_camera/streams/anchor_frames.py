"""Absolute measurements beside the events, as a sensor with frames gives them."""

from __future__ import annotations

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.nanoseconds import NANOSECONDS
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire.anchor import Anchor

_CUT_OFF = 3.0


class AnchorFrames:
    """Turns some of the samples into noisy frames.

    Parameters
    ----------
    rate
        Frames a second, > 0.
    noise
        Standard deviation of the relative error of a pixel, normal and cut off at three of them.
    seed
        Of the errors.
    """

    def __init__(self, *, rate: float, noise: float, seed: int) -> None:
        self._period_ns = round(NANOSECONDS / rate)
        self._noise = noise
        self._random = np.random.default_rng([seed, 3])
        self._due_ns: int | None = None

    @classmethod
    def of_scenario(cls, scenario: Scenario) -> AnchorFrames | None:
        """Frames with the parameters of a scenario; None if it asks for none.

        Parameters
        ----------
        scenario
            All parameters.
        """
        if not scenario.camera.frame_rate:
            return None
        return cls(
            rate=scenario.camera.frame_rate,
            noise=scenario.camera.frame_noise,
            seed=scenario.loop.seed,
        )

    def take(self, stamp_ns: int, luminosity: FloatArray) -> Anchor | None:
        """Measure a sample if a frame is due; after a step back in time at once.

        Parameters
        ----------
        stamp_ns
            Stamp of the sample, ns.
        luminosity
            y, any shape with r entries.
        """
        due_ns = self._due_ns
        if due_ns is not None and due_ns - self._period_ns <= stamp_ns < due_ns:
            return None
        self._due_ns = stamp_ns + self._period_ns
        error = self._random.standard_normal(luminosity.size).clip(-_CUT_OFF, _CUT_OFF)
        y = luminosity.reshape(-1) * (1 + self._noise * error)
        return Anchor(stamp_ns=stamp_ns, luminosity=y)
