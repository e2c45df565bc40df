"""How the loop runs."""

from __future__ import annotations

from dataclasses import dataclass

from dvs_common.scenario.fields import ParameterGroup, parameter
from dvs_common.scenario.nodes import CAMERA, CONTROLLER, NODES, PLANT
from dvs_common.scenario.schema import NON_NEGATIVE, POSITIVE, Interval


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopParameters(ParameterGroup):
    """Time, pace and start of the nodes, and what happens where a partner or light is missing."""

    mode: str = parameter(
        'lockstep',
        'lockstep: sample k waits for command k, reproducible to the byte; realtime: wall clock',
        nodes=NODES,
        choices=('lockstep', 'realtime'),
    )
    sampling_period: float = parameter(
        0.001,
        'Period of luminosity samples and commands, rounded to the nanosecond',
        nodes=(PLANT, CONTROLLER),
        unit='s',
        interval=Interval(low=1e-6, high=1.0),
    )
    duration: float = parameter(
        6.0,
        'Length of the run in simulated time; 0: for ever',
        nodes=(PLANT,),
        unit='s',
        interval=Interval(low=0, high=2**31 - 1),
    )
    real_time_factor: float = parameter(
        0.0,
        'Simulated seconds per wall-clock second in lockstep; 0: as fast as the machine allows',
        nodes=(PLANT,),
        interval=NON_NEGATIVE,
        dynamic=True,
    )
    command_timeout: float = parameter(
        0.1,
        'Age at which a command is stale in realtime mode; in lockstep, time after which a '
        'missing partner is named',
        nodes=(PLANT,),
        unit='s',
        interval=POSITIVE,
    )
    stale_command: str = parameter(
        'hold',
        'Realtime answer to a stale command: hold it, apply -B^+ A x_d or end the run',
        nodes=(PLANT,),
        choices=('hold', 'equilibrium', 'stop'),
    )
    nonphysical_luminosity: str = parameter(
        'stop',
        'What the plant does when y <= 0 meets a physical pixel: end the run with an error, '
        'publish dead_band instead, or publish y as it is',
        nodes=(PLANT,),
        choices=('stop', 'clamp', 'publish'),
    )
    seed: int = parameter(
        0,
        'Seed of every random draw',
        nodes=(PLANT, CAMERA),
        interval=Interval(low=0, high=2**63 - 1),
    )
    autostart: bool = parameter(
        True,
        'Configure and activate by itself; otherwise wait for lifecycle transitions',
        nodes=NODES,
        read_only=True,
    )
