"""What sensor and estimator must have in common."""

from __future__ import annotations

from dataclasses import dataclass

from dvs_common.scenario.fields import ParameterGroup, parameter
from dvs_common.scenario.nodes import CAMERA, CONTROLLER, NODES
from dvs_common.scenario.schema import NON_NEGATIVE, POSITIVE, Interval


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorParameters(ParameterGroup):
    """Pixel law, threshold and what is known of the first references (paper, eq. 5, 6, A1)."""

    event_threshold: float = parameter(
        0.15,
        'Event threshold h (paper, eq. 5)',
        nodes=(CAMERA, CONTROLLER),
        unit='log_b units',
        interval=POSITIVE,
        dynamic=True,
    )
    log_base: float = parameter(
        2.718281828459045,
        'Base b of the logarithm (paper, eq. 6)',
        nodes=(CAMERA, CONTROLLER),
        interval=Interval(low=1, low_open=True),
    )
    reference_lower: tuple[float, ...] = parameter(
        (),
        'Lower bounds m_i of the initial references, 1 or r entries (paper, A1); empty: from '
        'reference_uncertainty',
        nodes=(CAMERA, CONTROLLER),
        unit='luminosity',
        interval=POSITIVE,
    )
    reference_upper: tuple[float, ...] = parameter(
        (),
        'Upper bounds M_i of the initial references, 1 or r entries (paper, A1); empty: from '
        'reference_uncertainty',
        nodes=(CAMERA, CONTROLLER),
        unit='luminosity',
        interval=POSITIVE,
    )
    reference_uncertainty: float = parameter(
        0.002,
        'dy: m_i, M_i = |y_i(0)| -+ dy where reference_lower and reference_upper are empty '
        '(paper, section IV)',
        nodes=(CAMERA, CONTROLLER),
        unit='luminosity',
        interval=NON_NEGATIVE,
    )
    initial_reference: str = parameter(
        'luminosity',
        'Initial reference q_i(0): the first luminosity, m_i, M_i, or drawn log-uniformly '
        'between them with seed',
        nodes=(CAMERA,),
        choices=('luminosity', 'lower', 'upper', 'random'),
    )
    photoreceptor: str = parameter(
        'log',
        'Pixel law: log of a positive luminosity, linear below a knee and log above it, or '
        "the signed log of the paper's example (no real sensor)",
        nodes=NODES,
        choices=('log', 'lin_log', 'signed_log'),
    )
    dead_band: float = parameter(
        0.0001,
        'With signed_log, |y| below which a pixel fires no event (paper, Remark 5)',
        nodes=NODES,
        unit='luminosity',
        interval=POSITIVE,
    )
