"""Which nodes a loop consists of, and how each is started: for `closed_loop` and launch alike."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory

from dvs_common.errors import ParameterError
from dvs_common.node.node_plan import NodePlan, checked_namespace
from dvs_common.scenario.parameters import CAMERA, CONTROLLER, PLANT, SCHEMA
from dvs_common.scenario.scenario import Scenario

# Option of `composed_loop`; a parameter can't name one node of a process in any namespace.
PLANT_WAITS = '--plant-waits'
# Roles that may be played on another machine, or by hardware.
MOVABLE_ROLES = (CAMERA, CONTROLLER)
_PARTNERS = {
    CAMERA: ('dvs_event_camera', 'event_camera'),
    CONTROLLER: ('dvs_hinf_controller', 'hinf_controller'),
}


def scenario_file(scenario: str) -> Path:
    """Parameter file of a scenario.

    Parameters
    ----------
    scenario
        A path, or the name of one of the scenarios that come with the suite.

    Raises
    ------
    ParameterError
        If there is neither such a file nor such a scenario; lists those that there are.
    """
    path = Path(scenario)
    if path.is_file():
        return path
    installed = {file.stem: file for file in sorted(_config_directory().glob('*.yaml'))}
    if scenario in installed:
        return installed[scenario]
    raise ParameterError(
        'scenario', scenario, f'must be a parameter file or one of {", ".join(installed)}'
    )


def _config_directory() -> Path:
    try:
        return Path(get_package_share_directory('dvs_closed_loop')) / 'config'
    except PackageNotFoundError:
        raise ParameterError(
            'package', 'dvs_closed_loop', 'is not in AMENT_PREFIX_PATH; is the workspace sourced?'
        ) from None


def given(**parameters: object) -> dict[str, object]:
    """Parameters that the user gave: those that are neither None nor empty.

    Parameters
    ----------
    **parameters
        Values by parameter name.

    Raises
    ------
    ParameterError
        If a value breaks the parameter's rule.
    """
    values = {name: value for name, value in parameters.items() if value not in (None, '')}
    return {name: SCHEMA[name].validate(value) for name, value in values.items()}


def loop_plan(
    scenario: Scenario,
    parameter_file: Path,
    *,
    namespace: str = '',
    parameters: Mapping[str, object] | None = None,
    elsewhere: Collection[str] = (),
    composed: bool = False,
    plant_waits: bool = False,
) -> tuple[NodePlan, ...]:
    """Nodes of a scenario's loop; the plant, or the process that has it, is the last.

    Parameters
    ----------
    scenario
        Checked parameters.
    parameter_file
        File with those parameters, which the nodes read themselves.
    namespace
        Namespace of the whole loop; empty for none.
    parameters
        Values that differ from the file.
    elsewhere
        Roles, out of `MOVABLE_ROLES`, that nodes started elsewhere play.
    composed
        Whether all nodes share one process.
    plant_waits
        Whether the plant node is to be activated from outside instead of by itself.

    Raises
    ------
    ParameterError
        If the namespace is none, a role is unknown, or the plant can't be composed.
    """
    for role in elsewhere:
        if role not in MOVABLE_ROLES:
            raise ParameterError('elsewhere', role, f'must be out of {", ".join(MOVABLE_ROLES)}')
    common = NodePlan(
        package='',
        executable='',
        parameter_file=parameter_file,
        parameters=_resolved(scenario, parameters or {}),
        namespace=checked_namespace(namespace),
    )
    if composed:
        package, executable = _composed_program(scenario, elsewhere)
        options = (PLANT_WAITS,) if plant_waits else ()
        return (replace(common, package=package, executable=executable, options=options),)
    partners = [
        replace(common, package=package, executable=executable)
        for role, (package, executable) in _PARTNERS.items()
        if role not in elsewhere
    ]
    package, executable = plant_program(scenario, parameter_file)
    plant = replace(common, package=package, executable=executable)
    if plant_waits:
        plant = replace(plant, parameters={**common.parameters, 'autostart': False})
    return (*partners, plant)


def _resolved(scenario: Scenario, parameters: Mapping[str, object]) -> dict[str, object]:
    """Values that differ from the file; nodes get the profile, and need not have its file."""
    profile = scenario.profile.brightness_profile
    return {**({'brightness_profile': profile} if profile else {}), **parameters}


def plant_program(scenario: Scenario, parameter_file: Path) -> tuple[str, str]:
    """Package and executable of a scenario's plant, or no package and the path of a program.

    Parameters
    ----------
    scenario
        Checked parameters.
    parameter_file
        Its file; a path that begins with a dot is relative to its folder.

    Raises
    ------
    ParameterError
        If plant_executable is neither package/executable nor the path of a program.
    """
    value = scenario.plant.plant_executable
    if value.startswith(('./', '../', '/')):
        program = (parameter_file.parent / value).resolve()
        if not (program.is_file() and os.access(program, os.X_OK)):
            raise ParameterError('plant_executable', value, f'is no executable file ({program})')
        return '', str(program)
    package, slash, executable = value.partition('/')
    if not (package and slash and executable) or '/' in executable:
        raise ParameterError(
            'plant_executable',
            value,
            'must be package/executable, as in dvs_plant_sim/plant_sim, or a path, as in '
            './my_plant.py',
        )
    return package, executable


def _composed_program(scenario: Scenario, elsewhere: Collection[str]) -> tuple[str, str]:
    if not scenario.has_linear_plant:
        raise ParameterError(
            'plant_executable',
            scenario.plant.plant_executable,
            f'can not share a process with the other nodes, only {PLANT} can: no --composed',
        )
    if elsewhere:
        raise ParameterError('elsewhere', ' '.join(elsewhere), 'can not be given with --composed')
    return 'dvs_closed_loop', 'composed_loop'
