"""A node whose parameters are those of the suite's schema, checked before anything changes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.lifecycle import LifecycleNode
from rclpy.parameter import Parameter

from dvs_common.errors import SuiteError
from dvs_common.node.ros_parameters import ROS_TYPE, descriptor, plain
from dvs_common.scenario.parameters import SCHEMA
from dvs_common.scenario.presets import with_preset
from dvs_common.scenario.scenario import Scenario
from dvs_common.scenario.schema import ParameterSpec, Value, is_ros_parameter


class ParameterNode(LifecycleNode):
    """Lifecycle node that declares the parameters of its executable and guards their changes.

    Parameters
    ----------
    executable
        Name of the executable, and of the node unless it is remapped.
    own_parameters
        Parameters of an open group of the schema that this node alone has; None if it does not
        own the group.
    **node_arguments
        Further arguments of `rclpy.node.Node`.

    Raises
    ------
    ParameterError
        If a parameter's name is unknown or its value breaks its rule.
    """

    def __init__(
        self,
        executable: str,
        *,
        own_parameters: Sequence[ParameterSpec] | None = None,
        **node_arguments: Any,
    ) -> None:
        super().__init__(
            executable, automatically_declare_parameters_from_overrides=True, **node_arguments
        )
        self.is_active = False
        self._accepted_change: Callable[[], None] | None = None
        self._schema = SCHEMA if own_parameters is None else SCHEMA.closed(own_parameters)
        self._specs = [*SCHEMA.of_node(executable), *(own_parameters or ())]
        self._foreign = self._declare_parameters()
        self.add_on_set_parameters_callback(self._check_change)
        self.add_post_set_parameters_callback(self._make_change)

    def change(self, scenario: Scenario) -> Callable[[], None]:
        """Prepare a change of dynamic parameters while the node is active.

        Parameters
        ----------
        scenario
            All parameters with the change in them.

        Returns
        -------
        Callable
            Makes the change; called only if it is accepted.

        Raises
        ------
        SuiteError
            If the change can't be; nothing has changed then.
        """
        return lambda: None

    @property
    def autostart(self) -> bool:
        """Whether the node configures and activates by itself."""
        return bool(self.get_parameter('autostart').value)

    def is_given(self, name: str) -> bool:
        """Whether a parameter of other nodes came with this node's, as in a scenario's file.

        Parameters
        ----------
        name
            Parameter that this node does not have itself.
        """
        return name in self._foreign

    def scenario(self) -> Scenario:
        """Return the scenario of the current parameter values.

        Raises
        ------
        ParameterError
            If a value breaks its rule.
        """
        own = {spec.name: plain(self.get_parameter(spec.name).value) for spec in self._specs}
        return Scenario.from_values({**self._foreign, **own})

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set parameters together; what has its value already is no change, even if it is fixed.

        `ros2 param load` sets every value of a dump again.

        Parameters
        ----------
        parameter_list
            Parameters with their new values.
        """
        changed = [p for p in parameter_list if not self._has(p)]
        if parameter_list and not changed:
            return SetParametersResult(successful=True)
        return super().set_parameters_atomically(changed)

    def _has(self, parameter: Parameter) -> bool:
        if not self.has_parameter(parameter.name):
            return False
        current = self.get_parameter(parameter.name)
        return bool(current.get_parameter_value() == parameter.get_parameter_value())

    def declare_parameters(
        self,
        namespace: str,
        parameters: Sequence[tuple[Any, ...]],
        ignore_override: bool = False,
    ) -> list[Parameter]:
        """Declare parameters; an empty list in a parameter file comes as None, without a type.

        Parameters
        ----------
        namespace
            Prefix of the names.
        parameters
            Name, value and descriptor of each.
        ignore_override
            Whether the values count and not those that the node was started with.

        Returns
        -------
        list of Parameter
            The declared parameters.
        """
        typed = [
            (name, value, ParameterDescriptor(dynamic_typing=True), *rest[1:])
            if value is None
            else (name, value, *rest)
            for name, value, *rest in parameters
        ]
        declared: list[Parameter] = super().declare_parameters(namespace, typed, ignore_override)
        return declared

    def _declare_parameters(self) -> dict[str, Value]:
        """Declare this node's parameters; return the checked values of other nodes' ones."""
        overrides = {
            name: parameter.value
            for name, parameter in self.get_parameters_by_prefix('').items()
            if not is_ros_parameter(name)
        }
        for name in overrides:
            self.undeclare_parameter(name)
        overrides = {name: plain(value) for name, value in overrides.items()}
        values = self._schema.validate(with_preset(overrides))
        for spec in self._specs:
            self._declare(spec, values[spec.name])
        own = {spec.name for spec in self._specs}
        return {name: values[name] for name in overrides if name not in own}

    def _declare(self, spec: ParameterSpec, value: Value) -> None:
        """Declare a parameter; of an empty list rclpy needs the type."""
        kind = ROS_TYPE[spec.kind]
        empty = value == ()
        self.declare_parameter(
            spec.name, kind if empty else value, descriptor(spec), ignore_override=True
        )
        if empty:
            # Unset, it would keep `ros2 param dump` and rqt from seeing any of the others.
            self.set_parameters([Parameter(spec.name, kind, [])])

    def _check_change(self, parameters: list[Parameter]) -> SetParametersResult:
        specs = {spec.name: spec for spec in self._specs}
        changes = {p.name: plain(p.value) for p in parameters if p.name in specs}
        fixed = [name for name in changes if self.is_active and not specs[name].dynamic]
        if fixed:
            return SetParametersResult(
                successful=False,
                reason=f'{", ".join(fixed)} can only change while the node is not active',
            )
        try:
            for name, value in changes.items():
                specs[name].validate(value)
            if self.is_active and changes:
                self._accepted_change = self.change(self.scenario().replace(**changes))
        except SuiteError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _make_change(self, parameters: list[Parameter]) -> None:
        change, self._accepted_change = self._accepted_change, None
        if change is not None:
            change()
