"""Why no controller exists: a named assumption, never a garbage controller."""

from __future__ import annotations

from enum import Enum

from dvs_common.errors import SuiteError


class Assumption(str, Enum):
    """What H-infinity synthesis needs (Doyle, Glover, Khargonekar and Francis 1989)."""

    STABILIZABILITY = 'stabilizability'
    DETECTABILITY = 'detectability'
    RANK = 'rank'
    AXIS_ZERO = 'jw-axis zero'
    X_ABSENT = 'X absent'
    X_INDEFINITE = 'X indefinite'
    Y_ABSENT = 'Y absent'
    Y_INDEFINITE = 'Y indefinite'
    SPECTRAL_RADIUS = 'spectral radius'
    CONFIRMATION = 'confirmation'


class SynthesisError(SuiteError, RuntimeError):
    """No controller, because an assumption fails.

    Parameters
    ----------
    assumption
        The assumption that fails.
    detail
        What was found, with numbers.
    """

    def __init__(self, assumption: Assumption, detail: str) -> None:
        self.assumption = assumption
        self.detail = detail
        super().__init__(f'no controller: {assumption.value}: {detail}')
