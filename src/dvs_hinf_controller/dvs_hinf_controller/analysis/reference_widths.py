"""How far the interval of every reference may open while the loop runs (docs/promise.md)."""

from __future__ import annotations

import math

from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.sector_means import Sectors
from dvs_hinf_controller.sensor_uncertainty import SensorUncertainty


class ReferenceWidths:
    """Bounds of ``h ln b + w_i``, of which ``tanh`` is the sector of the estimate.

    An ideal sensor's intervals move rigidly: ``w_i`` stays what it was at the start. Where
    thresholds or leakage are uncertain an interval opens with every event and with time, and an
    absolute measurement closes it to one threshold either way. In a time t there are at most
    ``1 + t |d ln y/dt| / (h (1 - e))`` events of a pixel, since an event needs the luminosity to
    move by a threshold from the event before.

    Parameters
    ----------
    problem
        Bounds of the references, and the sensor.
    from_start
        Whether the bounds hold from the start of the run on, or in the limit.
    """

    def __init__(self, problem: DesignProblem, *, from_start: bool) -> None:
        self._widest = problem.pixels.widest
        self._from_start = from_start
        operation = problem.operation
        self._sensor = operation.sensor if operation else SensorUncertainty()
        # From an absolute measurement to the packet in which the next one is used, and the events
        # that were late at its beginning.
        self._window = self._sensor.anchor_period + 2 * self._sensor.latency
        self._window += operation.sampling_period if operation else 0.0

    @property
    def follow_rates(self) -> bool:
        """Whether the bounds grow with the rate of the luminosity."""
        sensor = self._sensor
        return sensor.threshold > 0 or (sensor.anchor_period > 0 and sensor.latency > 0)

    def sectors(self, step: float, log_rate: float) -> list[Sectors]:
        """Sectors of all pixels, each of which holds.

        Parameters
        ----------
        step
            ``h ln b``; one that is not positive is taken off what is known at the start.
        log_rate
            Bound of ``|d ln y_i / dt|``, 1/s.
        """
        sensor = self._sensor
        own = Sectors(level=self._thresholds(step))
        if not sensor.drifts and (self._from_start or not sensor.anchor_period):
            return [own]
        common = Sectors(level=self.level(step, log_rate), own_widths=False)
        return [common] if sensor.drifts else [own, common]

    def level(self, step: float, log_rate: float) -> float:
        """Bound of ``h ln b + w_i`` with absolute measurements, at least 0; infinite without any.

        Parameters
        ----------
        step
            ``h ln b``.
        log_rate
            Bound of ``|d ln y_i / dt|``, 1/s.
        """
        sensor, size = self._sensor, max(step, 0.0)
        if not sensor.anchor_period:
            return math.inf
        width = self._thresholds(size) + math.atanh(sensor.anchor)
        if sensor.latency:
            unsure = self._moved(size, log_rate, 2 * sensor.latency)
            width += 0.5 * (1 + sensor.threshold) * unsure
        if self._from_start:
            width = max(self._widest + 0.5 * size * (sensor.leak > 0), width)
        width += 0.5 * sensor.leak * size * self._window
        if sensor.threshold:
            width += sensor.threshold * self._moved(size, log_rate, self._window)
        return max(self._thresholds(step) + width, 0.0)

    def _thresholds(self, step: float) -> float:
        """Mean of the largest ON and OFF thresholds."""
        mismatch = 0.5 * (self._sensor.threshold_on + self._sensor.threshold_off)
        return step + max(step, 0.0) * mismatch

    def _moved(self, step: float, log_rate: float, duration: float) -> float:
        """Bound of ``h ln b`` times the number of events of a pixel in a time."""
        path = (log_rate + self._sensor.leak * step) * duration
        return step + path / (1 - self._sensor.threshold)
