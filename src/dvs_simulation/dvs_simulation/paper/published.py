"""What the paper prints: its example, its thresholds, and the physical mirror image of it.

Source: Singh, Yong, Frazzoli, "Set-Point Regulation of Linear Continuous-Time Systems using
Neuromorphic Vision Sensors", section IV and appendix.
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.scenario.scenario import Scenario

Example = Literal['paper', 'mirror']

TOLERANCE = 0.05
REFERENCE_UNCERTAINTY = 0.002
DEAD_BAND = 1e-4
# dx_1 .. dx_9, in the unit of x.
PIXEL_OFFSETS = 0.01 * np.array(
    [[0, 0], [1, 0], [-1, 0], [-1, 1], [0, 1], [1, 1], [1, -1], [0, -1], [-1, -1]], dtype=float
)
# h* by (method, r).
THRESHOLDS = MappingProxyType(
    {
        ('unstructured', 3): 0.1562,
        ('structured', 1): 0.1511,
        ('structured', 3): 0.1510,
        ('structured', 9): 0.1508,
    }
)
# The optima of the reduced problem for the same rows, by Nevanlinna-Pick interpolation.
OPTIMAL_THRESHOLDS = MappingProxyType(
    {
        ('unstructured', 3): 0.15622,
        ('structured', 1): 0.15101,
        ('structured', 3): 0.15023,
        ('structured', 9): 0.14984,
    }
)
# Figure "best_HM": deltabar, m, M and the optimum that it shows.
OPTIMIZATION = MappingProxyType(
    {'error_bound': 0.35, 'lower': 1.0, 'upper': 1.4, 'spacing': 0.8210, 'estimate': 1.1083}
)
_SET_POINT = (-0.2321, 0.0928)
_START = (0.0179, 0.3428)


def scenario(
    example: Example,
    pixels: int,
    *,
    event_threshold: float = 0.149,
    offsets: FloatArray | None = None,
) -> Scenario:
    """Scenario of the paper's example, or of its physical mirror image.

    The mirror image ``x_d -> -x_d`` has the same error dynamics and thresholds of the same size,
    but y > 0 all along; the example itself needs a pixel that sees negative luminosity.

    Parameters
    ----------
    example
        `paper` or `mirror`.
    pixels
        r; the first r offsets of the paper.
    event_threshold
        h.
    offsets
        dx of other pixels, shape (r, 2), in place of the paper's.
    """
    sign = 1.0 if example == 'paper' else -1.0
    moved = np.array(_START) - np.array(_SET_POINT)
    set_point = sign * np.array(_SET_POINT)
    chosen = PIXEL_OFFSETS[:pixels] if offsets is None else offsets
    values: dict[str, Any] = {
        'state_matrix': [2.0, 10.0, 0.0, 5.0],
        'input_matrix': [1.0, 1.0],
        'output_vector': (np.array([2.0, 1.0]) / math.sqrt(5)).tolist(),
        'pixel_offsets': chosen.ravel().tolist(),
        'pixel_grid': [1, len(chosen)],
        'initial_state': (set_point + moved).tolist(),
        'set_point': set_point.tolist(),
        'set_point_tolerance': 1e-3,
        'tolerance': TOLERANCE,
        'event_threshold': float(event_threshold),
        'log_base': math.e,
        'reference_uncertainty': REFERENCE_UNCERTAINTY,
        'initial_reference': 'luminosity',
        'photoreceptor': 'signed_log' if example == 'paper' else 'log',
        'dead_band': DEAD_BAND,
        'duration': 6.0,
    }
    return Scenario.from_values(values)


def platform_scenario() -> Scenario:
    """The appendix: a camera of 8 x 6 pixels on a platform over a linear brightness profile.

    An offset of 0.5 along c keeps every luminosity positive.
    """
    c = np.array([2.0, 1.0]) / math.sqrt(5)
    plain = scenario('paper', 1, event_threshold=0.083)
    return Scenario.from_values(
        {
            **plain.values,
            'pixel_offsets': [],
            'pixel_grid': [6, 8],
            'pixel_pitch': [0.002, 0.0, 0.0, 0.002],
            'pixel_origin': (0.5 * c).tolist(),
            'photoreceptor': 'log',
        }
    )
