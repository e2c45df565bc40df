"""All parameters of the suite: typed groups, and access by the flat names of ROS.

The defaults are the scenario ``mirror_r3``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, TypeVar

from dvs_common.errors import ParameterError
from dvs_common.scenario.camera_parameters import (
    CameraParameters,
    DisplayParameters,
    ImperfectionParameters,
)
from dvs_common.scenario.controller_parameters import ControllerParameters
from dvs_common.scenario.fields import specs_of
from dvs_common.scenario.loop_parameters import LoopParameters
from dvs_common.scenario.nodes import CAMERA, CONTROLLER, PLANT
from dvs_common.scenario.plant_parameters import (
    DisturbanceParameters,
    ObjectiveParameters,
    PixelParameters,
    PlantParameters,
)
from dvs_common.scenario.presets import with_preset
from dvs_common.scenario.profile_parameters import ProfileParameters
from dvs_common.scenario.promise_parameters import PromiseParameters
from dvs_common.scenario.schema import Schema, Value
from dvs_common.scenario.sensor_parameters import SensorParameters
from dvs_common.scenario.uncertainty_parameters import UncertaintyParameters

__all__ = ['CAMERA', 'CONTROLLER', 'GROUPS', 'PLANT', 'PLANT_GROUP', 'SCHEMA', 'Parameters']

# Parameters of a plant other than the linear one: only its own node declares and checks them.
PLANT_GROUP = 'plant.'

GROUPS = MappingProxyType(
    {
        'plant': PlantParameters,
        'pixels': PixelParameters,
        'profile': ProfileParameters,
        'objective': ObjectiveParameters,
        'sensor': SensorParameters,
        'camera': CameraParameters,
        'imperfections': ImperfectionParameters,
        'display': DisplayParameters,
        'loop': LoopParameters,
        'disturbance': DisturbanceParameters,
        'controller': ControllerParameters,
        'uncertainty': UncertaintyParameters,
        'promise': PromiseParameters,
    }
)
_GROUP_OF = {spec.name: name for name, group in GROUPS.items() for spec in specs_of(group)}

SCHEMA = Schema(
    (spec for group in GROUPS.values() for spec in specs_of(group)), open_groups=(PLANT_GROUP,)
)

_Self = TypeVar('_Self', bound='Parameters')


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """Value of every parameter, checked.

    Parameters
    ----------
    plant
        The linear plant.
    pixels
        The pixel array.
    profile
        What its pixels see, where it is not a straight line.
    objective
        What the loop shall reach.
    sensor
        What sensor and estimator must have in common.
    camera
        Input, pixels and streams of the camera.
    imperfections
        In what the pixels differ from ideal ones.
    display
        The picture `event_image`.
    loop
        Time, pace and start of the nodes.
    disturbance
        What disturbs the simulated plant.
    controller
        Method and options of the design.
    uncertainty
        How far the sensor may be from an ideal one.
    promise
        What the promise of the design covers.
    plant_extras
        Parameters of a plant node other than `plant_sim`, by their whole names (``plant.*``).

    Raises
    ------
    ParameterError
        If a name in `plant_extras` does not begin with ``plant.``.
    """

    plant: PlantParameters = field(default_factory=PlantParameters)
    pixels: PixelParameters = field(default_factory=PixelParameters)
    profile: ProfileParameters = field(default_factory=ProfileParameters)
    objective: ObjectiveParameters = field(default_factory=ObjectiveParameters)
    sensor: SensorParameters = field(default_factory=SensorParameters)
    camera: CameraParameters = field(default_factory=CameraParameters)
    imperfections: ImperfectionParameters = field(default_factory=ImperfectionParameters)
    display: DisplayParameters = field(default_factory=DisplayParameters)
    loop: LoopParameters = field(default_factory=LoopParameters)
    disturbance: DisturbanceParameters = field(default_factory=DisturbanceParameters)
    controller: ControllerParameters = field(default_factory=ControllerParameters)
    uncertainty: UncertaintyParameters = field(default_factory=UncertaintyParameters)
    promise: PromiseParameters = field(default_factory=PromiseParameters)
    plant_extras: Mapping[str, Value] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Freeze the parameters of the open group."""
        for name, value in self.plant_extras.items():
            if not name.startswith(PLANT_GROUP):
                raise ParameterError(name, value, f'must begin with {PLANT_GROUP}')
        extras = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in self.plant_extras.items()
        }
        object.__setattr__(self, 'plant_extras', MappingProxyType(extras))

    @classmethod
    def from_values(cls: type[_Self], values: Mapping[str, Any]) -> _Self:
        """Parameters with `values` and the schema's defaults for the rest.

        Parameters
        ----------
        values
            Values by parameter name; `preset` gives some that are not among them.

        Raises
        ------
        ParameterError
            If a name is unknown or a value breaks its rule.
        """
        return cls()._with(with_preset(values))

    def replace(self: _Self, **changes: Any) -> _Self:
        """Return a copy with some parameters changed and checked.

        Parameters
        ----------
        **changes
            New values by parameter name.

        Raises
        ------
        ParameterError
            If a name is unknown or a value breaks its rule.
        """
        return self._with(changes)

    def _with(self: _Self, changes: Mapping[str, Any]) -> _Self:
        SCHEMA.require_known(changes)
        of_groups: dict[str, dict[str, Any]] = {}
        extras = dict(self.plant_extras)
        for name, value in changes.items():
            if name in _GROUP_OF:
                of_groups.setdefault(_GROUP_OF[name], {})[name] = value
            else:
                extras[name] = value
        groups = {
            group: dataclasses.replace(getattr(self, group), **own)
            for group, own in of_groups.items()
        }
        return dataclasses.replace(self, plant_extras=extras, **groups)

    @property
    def values(self) -> Mapping[str, Value]:
        """Value of every parameter by its flat name, in the order of the schema."""
        known = {name: getattr(getattr(self, group), name) for name, group in _GROUP_OF.items()}
        return MappingProxyType({**known, **self.plant_extras})

    def __getitem__(self, name: str) -> Any:
        """Return the value of the parameter that ROS calls `name`."""
        if name in _GROUP_OF:
            return getattr(getattr(self, _GROUP_OF[name]), name)
        return self.plant_extras[name]

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by values: a scenario travels to the workers of a sweep."""
        return type(self).from_values, (dict(self.values),)
