"""The pixels that a scenario describes."""

from __future__ import annotations

from dvs_common.arrays import FloatArray
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_common.scenario.scenario import Scenario
from dvs_common.scenario.sensor_parameters import SensorParameters
from dvs_event_camera.pixels.imperfections import Imperfections
from dvs_event_camera.pixels.photoreceptor import (
    LinLogPhotoreceptor,
    LogPhotoreceptor,
    Photoreceptor,
    SignedLogPhotoreceptor,
)
from dvs_event_camera.pixels.pixel_array import PixelArray

# An uncertainty left at its default states nothing about (A1), and no pixel may violate it.
_UNSTATED_UNCERTAINTY = SensorParameters().reference_uncertainty


def photoreceptor_of_scenario(scenario: Scenario, darkest: float = 0.0) -> Photoreceptor:
    """Photoreceptor with the parameters of a scenario.

    Parameters
    ----------
    scenario
        All parameters.
    darkest
        Darkest luminosity that the images can resolve: a floor of the logarithm.
    """
    if scenario.sensor.photoreceptor == 'signed_log':
        return SignedLogPhotoreceptor(dead_band=scenario.sensor.dead_band)
    if scenario.sensor.photoreceptor == 'lin_log':
        return LinLogPhotoreceptor(knee=scenario.camera.lin_log_knee)
    return LogPhotoreceptor(log_floor=max(scenario.camera.log_floor, darkest))


def imperfections_of_scenario(scenario: Scenario) -> Imperfections:
    """Non-idealities with the parameters of a scenario.

    Parameters
    ----------
    scenario
        All parameters.
    """
    return Imperfections(
        **{
            name: getattr(scenario.imperfections, name)
            for name in Imperfections.__dataclass_fields__
        }
    )


def _stated_bounds(scenario: Scenario, luminosity: FloatArray) -> ReferenceBounds | None:
    """Bounds that the parameters state; None where they follow from the first sample."""
    stated = scenario.sensor.reference_lower or scenario.sensor.reference_upper
    return scenario.reference_bounds(luminosity) if stated else None


def pixels_of_scenario(
    scenario: Scenario,
    luminosity: FloatArray,
    darkest: float,
    backend: str = 'auto',
    *,
    bounds: bool = True,
    first_reference: FloatArray | None = None,
) -> PixelArray:
    """Pixel array with the parameters of a scenario.

    Parameters
    ----------
    scenario
        All parameters.
    luminosity
        First sample, shape (r,).
    darkest
        Darkest luminosity that the images can resolve.
    backend
        `auto`, `numba` or `numpy`.
    bounds
        Whether to work out the bounds of the references from the first sample.
    first_reference
        ``|q(0)|``, shape (r,); None for what `initial_reference` sets.

    Raises
    ------
    ParameterError
        If parameters do not fit together or to the first sample.
    """
    receptor = photoreceptor_of_scenario(scenario, darkest)
    return PixelArray(
        event_threshold=scenario.sensor.event_threshold,
        log_base=scenario.sensor.log_base,
        photoreceptor=receptor,
        bounds=_stated_bounds(scenario, luminosity) if bounds else None,
        reference_uncertainty=scenario.sensor.reference_uncertainty,
        strict_start=scenario.sensor.reference_uncertainty != _UNSTATED_UNCERTAINTY,
        initial_reference=(
            scenario.sensor.initial_reference if first_reference is None else first_reference
        ),
        seed=scenario.loop.seed,
        interpolation=scenario.camera.interpolation,
        imperfections=imperfections_of_scenario(scenario),
        label_noise=scenario.camera.label_noise,
        threads=scenario.camera.threads,
        backend=backend,
    )
