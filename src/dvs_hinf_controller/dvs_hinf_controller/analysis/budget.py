"""The budget that threshold and ignorance share: ``h ln b + max w <= atanh(delta_certified)``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dvs_common.scenario.reference_bounds import ReferenceBounds

# Rounding of logarithms.
_ROUNDING = 1e-12
# A message of health stays short.
_NAMED_PIXELS = 256


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """What a design allows the estimate's error to be, and what is used of it now.

    Parameters
    ----------
    threshold
        ``h ln b``, with the uncertainty of the thresholds.
    ignorance
        ``max w``, half the logarithmic width of the widest interval of a healthy pixel.
    delta_certified
        Relative error of the estimate up to which the tolerance is guaranteed.
    unknown_pixels
        Healthy pixels of whose reference nothing is known.
    masked_pixels
        Row-major numbers of the pixels that are not used.
    """

    threshold: float
    ignorance: float
    delta_certified: float
    unknown_pixels: int = 0
    masked_pixels: tuple[int, ...] = ()

    @property
    def used(self) -> float:
        """``h ln b + max w``."""
        return self.threshold + self.ignorance

    @property
    def allowed(self) -> float:
        """``atanh(delta_certified)``; infinite from ``delta_certified = 1`` on."""
        return math.atanh(self.delta_certified) if self.delta_certified < 1 else math.inf

    @property
    def is_certified(self) -> bool:
        """Whether the tolerance is guaranteed with what is known now."""
        return not self.unknown_pixels and self.used <= self.allowed * (1 + _ROUNDING)

    @property
    def left(self) -> float:
        """What is left of it, negative where more is used than is allowed."""
        return -math.inf if math.isinf(self.used) else self.allowed - self.used

    def is_worse_than(self, other: Budget) -> bool:
        """Whether less is left than there.

        Parameters
        ----------
        other
            Budget to compare with.
        """
        return self.unknown_pixels > 0 or self.left < other.left - _ROUNDING * other.used

    @classmethod
    def at_start(cls, bounds: ReferenceBounds, step: float, delta_certified: float) -> Budget:
        """Budget of an ideal sensor before its first event.

        Parameters
        ----------
        bounds
            What is known of the references.
        step
            ``h ln b``.
        delta_certified
            See `Budget`.
        """
        widths = 0.5 * np.log(bounds.upper / bounds.lower)
        return cls(threshold=step, ignorance=float(widths.max()), delta_certified=delta_certified)

    @classmethod
    def reported(cls, values: Mapping[str, str]) -> Budget | None:
        """Budget that a controller has reported by `figures`; None where there is none to read.

        Parameters
        ----------
        values
            What the controller publishes of its health.
        """
        try:
            return cls(
                threshold=float(values['h ln b']),
                ignorance=float(values['max w']),
                delta_certified=math.tanh(float(values['atanh(delta_certified)'])),
                unknown_pixels=int(values['pixels unknown']),
                masked_pixels=tuple(map(int, values.get('masked pixels', '').split())),
            )
        except (KeyError, ValueError):
            return None

    @property
    def figures(self) -> dict[str, object]:
        """All of it by name, for `/diagnostics`."""
        return {
            'h ln b': self.threshold,
            'max w': self.ignorance,
            'pixels unknown': self.unknown_pixels,
            'pixels masked': len(self.masked_pixels),
            'masked pixels': ' '.join(map(str, self.masked_pixels[:_NAMED_PIXELS])),
            'atanh(delta_certified)': self.allowed,
            'certificate': str(self),
        }

    def __str__(self) -> str:
        """Return the verdict in a few words."""
        if self.is_certified:
            return f'certified now: h ln b + max w = {self.used:.4g} <= {self.allowed:.4g}'
        if self.unknown_pixels:
            plural = 's' if self.unknown_pixels > 1 else ''
            return f'not certified: {self.unknown_pixels} pixel{plural} unknown'
        return f'not certified: h ln b + max w = {self.used:.4g} > {self.allowed:.4g}'
