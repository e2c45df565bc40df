"""Named sets of imperfections, with the source of every number."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from dvs_common.errors import ParameterError


@dataclass(frozen=True, slots=True, kw_only=True)
class Preset:
    """Parameters of a kind of sensor.

    Parameters
    ----------
    values
        Parameters of `event_camera` by name.
    source
        Where the numbers come from.
    """

    values: Mapping[str, float | str]
    source: str


_V2E = 'v2e, v2ecore/emulator.py, set_dvs_params'
PRESETS: Mapping[str, Preset] = {
    'ideal': Preset(values={}, source='paper, eq. 5'),
    'clean': Preset(
        values={'event_threshold': 0.2, 'threshold_mismatch': 0.1},
        source=f"{_V2E}('clean'): thresholds 0.2 with a standard deviation of 0.02",
    ),
    'noisy': Preset(
        values={
            'event_threshold': 0.2,
            'threshold_mismatch': 0.25,
            'cutoff_frequency': 30.0,
            'cutoff_luminosity': 255.0,
            'leak_rate': 0.1,
            'shot_noise_rate': 5.0,
            'shot_noise_luminosity': 255.0,
        },
        source=f"{_V2E}('noisy'): thresholds 0.2 with a standard deviation of 0.05, 30 Hz, 0.1 Hz "
        'of leak and 5 Hz of shot noise, both rates for grey levels up to 255',
    ),
    'dvs128': Preset(
        values={'event_threshold': 0.15, 'threshold_mismatch': 0.14, 'latency': 15e-6},
        source='Lichtsteiner, Posch, Delbruck: A 128 x 128 120 dB 15 us latency asynchronous '
        'temporal contrast vision sensor, IEEE J. Solid-State Circuits 43 (2008): 15 us in bright '
        'light, mismatch of 2.1 % contrast; the threshold is a bias, 0.15 a choice',
    ),
    'davis240': Preset(
        values={'event_threshold': 0.15, 'latency': 3e-6},
        source='Brandli, Berner, Yang, Liu, Delbruck: A 240 x 180 130 dB 3 us latency global '
        'shutter spatiotemporal vision sensor, IEEE J. Solid-State Circuits 49 (2014): 3 us in '
        'bright light; the threshold is a bias, 0.15 a choice',
    ),
}


def preset_named(name: str) -> Preset:
    """Preset by its name.

    Parameters
    ----------
    name
        One of `PRESETS`.

    Raises
    ------
    ParameterError
        If there is none of that name.
    """
    found = PRESETS.get(name) if isinstance(name, str) else None
    if found is None:
        raise ParameterError('preset', name, f'must be one of {", ".join(PRESETS)}')
    return found


def with_preset(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values of parameters, those of their `preset` for what is not given beside it.

    Parameters
    ----------
    values
        Parameters that are given.

    Raises
    ------
    ParameterError
        If the preset is none.
    """
    if 'preset' not in values:
        return dict(values)
    return {**preset_named(values['preset']).values, **values}
