"""What the plant is, what its pixels see and where it shall be held."""

from __future__ import annotations

from dataclasses import dataclass

from dvs_common.scenario.fields import ParameterGroup, parameter
from dvs_common.scenario.nodes import CONTROLLER, PLANT
from dvs_common.scenario.schema import NON_NEGATIVE, POSITIVE, Interval


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantParameters(ParameterGroup):
    """The linear plant `xdot = A x + B u` with its start (paper, eq. 1)."""

    state_matrix: tuple[float, ...] = parameter(
        (2.0, 10.0, 0.0, 5.0),
        'State matrix A, n x n, row-major (paper, eq. 1)',
        nodes=(PLANT, CONTROLLER),
        unit='1/s',
    )
    input_matrix: tuple[float, ...] = parameter(
        (1.0, 1.0),
        'Input matrix B, n x m, row-major (paper, eq. 1)',
        nodes=(PLANT, CONTROLLER),
        unit='state/(input s)',
    )
    output_vector: tuple[float, ...] = parameter(
        (0.894427190999916, 0.447213595499958),
        'Output vector c, n entries: gradient of the brightness (paper, eq. 1); k x n, row-major, '
        'where pixel_groups names k groups',
        nodes=(PLANT, CONTROLLER),
        unit='luminosity/state',
    )
    initial_state: tuple[float, ...] = parameter(
        (0.4821, 0.1572),
        'Initial state x0 in original coordinates, n entries (paper, section IV)',
        nodes=(PLANT, CONTROLLER),
        unit='state',
    )
    plant_executable: str = parameter(
        'dvs_plant_sim/plant_sim',
        'Plant node that tools start for this scenario: package/executable, or the path of a '
        'program (./my_plant.py is relative to the parameter file)',
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelParameters(ParameterGroup):
    """The pixel array: where its pixels look (paper, eq. 1)."""

    pixel_offsets: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.01, 0.0, -0.01, 0.0),
        'Pixel displacements dx, r x n, row-major over the array (paper, eq. 1); unused where '
        'there is a pixel_pitch',
        nodes=(PLANT, CONTROLLER),
        unit='state',
    )
    pixel_pitch: tuple[float, ...] = parameter(
        (),
        'Displacement from a column to the next and from a row to the next, 2 x n, row-major: '
        'a regular grid in place of pixel_offsets',
        nodes=(PLANT, CONTROLLER),
        unit='state',
    )
    pixel_origin: tuple[float, ...] = parameter(
        (),
        'Displacement of the centre of the grid of pixel_pitch, n entries (empty: 0); along c '
        'it is a brightness offset',
        nodes=(PLANT, CONTROLLER),
        unit='state',
    )
    pixel_grid: tuple[int, ...] = parameter(
        (1, 3),
        'Rows and columns [height, width] of the pixel array; height x width = r',
        nodes=(PLANT, CONTROLLER),
        unit='pixels',
        interval=Interval(low=1, high=65535),
    )
    pixel_groups: tuple[int, ...] = parameter(
        (),
        'Pixel group, a row of output_vector from 0, that each row of the array sees '
        '(height entries) or each pixel (r entries); empty: all see the one group',
        nodes=(PLANT, CONTROLLER),
        interval=Interval(low=0, high=65535),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectiveParameters(ParameterGroup):
    """What the loop shall reach (paper, Problem 1)."""

    set_point: tuple[float, ...] = parameter(
        (0.2321, -0.0928),
        'Set-point x_d, n entries (paper, eq. 2)',
        nodes=(PLANT, CONTROLLER),
        dynamic=True,
        unit='state',
    )
    set_point_tolerance: float = parameter(
        0.001,
        'Largest accepted residual ||(I - B B^+) A x_d||; within it the nearest stabilizable '
        'point is used',
        nodes=(PLANT, CONTROLLER),
        interval=NON_NEGATIVE,
        unit='state/s',
    )
    tolerance: float = parameter(
        0.05,
        'Tolerance eps: limsup ||x - x_d|| must stay below it (paper, Problem 1)',
        nodes=(PLANT, CONTROLLER),
        interval=POSITIVE,
        dynamic=True,
        unit='state',
    )
    error_weights: tuple[float, ...] = parameter(
        (),
        'Weight of each state in the error, n entries: ||W (x - x_d)|| must stay below tolerance; '
        '0: the state is free; empty: all 1. A tolerance of its own for each state: '
        '1/tolerance_i, with tolerance: 1',
        nodes=(PLANT, CONTROLLER),
        interval=NON_NEGATIVE,
    )
    output_tolerance: float = parameter(
        0.0,
        "Tolerance of the output besides: limsup |c'(x - x_d)| must stay below it; 0: none",
        nodes=(PLANT, CONTROLLER),
        unit='luminosity',
        interval=NON_NEGATIVE,
    )
    settling_time: float = parameter(
        0.0,
        'Longest settling time: every closed-loop pole decays to 2 % within it; 0: no constraint',
        nodes=(CONTROLLER,),
        unit='s',
        interval=NON_NEGATIVE,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class DisturbanceParameters(ParameterGroup):
    """What disturbs the simulated plant."""

    input_disturbance: float = parameter(
        0.0,
        'Standard deviation of Gaussian noise on every input, held for a sampling period',
        nodes=(PLANT,),
        unit='input',
        interval=NON_NEGATIVE,
    )
    state_disturbance: float = parameter(
        0.0,
        'Intensity of a Gaussian random walk added to every state',
        nodes=(PLANT,),
        unit='state/sqrt(s)',
        interval=NON_NEGATIVE,
    )
    constant_load: tuple[float, ...] = parameter(
        (),
        'Constant disturbance added to every input, 0, 1 or m entries; empty: none',
        nodes=(PLANT,),
        unit='input',
    )
    output_disturbance: float = parameter(
        0.0,
        'Constant added to the luminosity of every pixel, which the controller has no model of',
        nodes=(PLANT,),
        unit='luminosity',
    )
