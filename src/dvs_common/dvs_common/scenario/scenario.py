"""A scenario: one checked set of parameters that serves every node and tool."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.errors import ParameterError
from dvs_common.nanoseconds import NANOSECONDS, as_nanoseconds
from dvs_common.scenario.brightness_profile import Linearisation
from dvs_common.scenario.loop_file import read_loop_values
from dvs_common.scenario.model import Equilibrium, PixelScene, PlantModel
from dvs_common.scenario.parameters import SCHEMA, Parameters
from dvs_common.scenario.profile_file import as_text, read_profile
from dvs_common.scenario.reference_bounds import ReferenceBounds


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario(Parameters):
    """Checked parameters, and the model types that they describe.

    See Also
    --------
    load_scenario : from a parameter file.
    """

    @property
    def model(self) -> PlantModel:
        """Plant A, B, c.

        Raises
        ------
        ParameterError
            If the lengths of the matrices do not fit together.
        """
        n, groups = self._state_count, self._group_count
        output = np.array(self.plant.output_vector)
        return PlantModel(
            state_matrix=self._matrix('state_matrix', rows=n, columns=n),
            input_matrix=self._matrix('input_matrix', rows=n, columns=None),
            output_vector=output.reshape(groups, n) if groups > 1 else output,
        )

    @property
    def _group_count(self) -> int:
        """Number of pixel groups that pixel_groups names, 1 where it is empty."""
        named = self.pixels.pixel_groups
        count = max(named, default=0) + 1
        if named and len(set(named)) != count:
            rule = f'must name every group from 0 to {count - 1}'
            raise ParameterError('pixel_groups', list(named), rule)
        return count

    @property
    def _state_count(self) -> int:
        """Number of states n, the length of a row of output_vector."""
        size, groups = len(self.plant.output_vector), self._group_count
        if size == 0:
            raise ParameterError('output_vector', [], 'must not be empty')
        if size % groups:
            raise ParameterError(
                'output_vector',
                list(self.plant.output_vector),
                f'must have {groups} rows of n entries, since pixel_groups names {groups} groups',
            )
        return size // groups

    @property
    def scene(self) -> PixelScene:
        """Pixel array: a regular grid where there is a pixel_pitch, else from pixel_offsets.

        Raises
        ------
        ParameterError
            If the lengths do not fit together, or brightness_profile can't be read.
        """
        scene, given = self._pixel_array, self.profile
        if not given.brightness_profile:
            for name in ('profile_range', 'profile_reach'):
                if self[name]:
                    raise ParameterError(name, self[name], 'needs brightness_profile')
            return scene
        profile = read_profile(given.brightness_profile, given.profile_range)
        return replace(scene, profile=profile)

    @property
    def linearisation(self) -> Linearisation:
        """Line that takes the place of brightness_profile around the set-point.

        Raises
        ------
        ParameterError
            If the profile does not reach around the set-point, or neither rises nor falls there.
        """
        scene = self.scene
        if scene.profile is None:
            return Linearisation()
        return scene.profile.line_around(
            scene.positions(self.model, self.equilibrium.state), reach=self.profile.profile_reach
        )

    @property
    def _pixel_array(self) -> PixelScene:
        if len(self.pixels.pixel_grid) != 2:
            raise ParameterError('pixel_grid', self.pixels.pixel_grid, 'must be [height, width]')
        height, width = self.pixels.pixel_grid
        model = self.model
        if self.pixels.pixel_pitch:
            return self._regular_scene(model, height, width)
        if self.pixels.pixel_origin:
            raise ParameterError('pixel_origin', self.pixels.pixel_origin, 'needs pixel_pitch')
        offsets = self._matrix('pixel_offsets', rows=None, columns=model.state_count)
        return PixelScene.from_offsets(
            model, offsets, height=height, width=width, groups=self._groups(height, width)
        )

    @property
    def has_linear_plant(self) -> bool:
        """Whether tools start `plant_sim`, the model itself, and no plant of its own."""
        return bool(self.plant.plant_executable == SCHEMA['plant_executable'].default)

    @property
    def equilibrium(self) -> Equilibrium:
        """Stabilizable set-point nearest to set_point, and the input that holds it.

        Raises
        ------
        ParameterError
            If set_point is not stabilizable within set_point_tolerance.
        """
        return self.model.equilibrium(
            self.objective.set_point, tolerance=self.objective.set_point_tolerance
        )

    @property
    def initial_state(self) -> FloatArray:
        """Initial state x0, shape (n,).

        Raises
        ------
        ParameterError
            If it has not n entries.
        """
        state = np.array(self.plant.initial_state)
        n = self._state_count
        if state.size != n:
            rule = f'must have as many entries as output_vector, {n}'
            raise ParameterError('initial_state', state.tolist(), rule)
        return state

    def reference_bounds(self, first_luminosity: FloatArray) -> ReferenceBounds:
        """Bounds m, M of the initial references.

        Parameters
        ----------
        first_luminosity
            y(0), shape (r,); used where reference_lower and reference_upper are empty.

        Raises
        ------
        ParameterError
            If only one of the two is given, a length does not fit or m > M.
        """
        lower, upper = self.sensor.reference_lower, self.sensor.reference_upper
        if not lower and not upper:
            return ReferenceBounds.around(first_luminosity, self.sensor.reference_uncertainty)
        r = first_luminosity.size
        for name, bound in (('reference_lower', lower), ('reference_upper', upper)):
            if len(bound) not in (1, r):
                raise ParameterError(
                    name,
                    list(bound),
                    f'must have 1 or {r} entries, since the pixel array has {r} pixels',
                )
        return ReferenceBounds(
            lower=np.broadcast_to(np.array(lower), (r,)),
            upper=np.broadcast_to(np.array(upper), (r,)),
        )

    @property
    def model_reference_bounds(self) -> ReferenceBounds:
        """Bounds m, M for a consumer that sees no luminosity: y(0) from initial_state."""
        return self.reference_bounds(self.scene.luminosity(self.model, self.initial_state))

    @property
    def sampling_period_ns(self) -> int:
        """Sampling period in nanoseconds."""
        return as_nanoseconds(self.loop.sampling_period)

    @property
    def sample_count(self) -> int:
        """Number of the last sample, ``duration / sampling_period``; 0 means no end."""
        if self.loop.duration == 0:
            return 0
        return max(1, round(self.loop.duration * NANOSECONDS / self.sampling_period_ns))

    @property
    def command_limit(self) -> FloatArray:
        """Largest ``|u_o|`` per input, shape (m,), infinite where there is none."""
        return self._per_input('command_limit', absent=np.inf)

    @property
    def command_rate_limit(self) -> FloatArray:
        """Largest change of ``u_o`` in a second, shape (m,), infinite where there is none."""
        return self._per_input('command_rate_limit', absent=np.inf)

    @property
    def disturbance_bound(self) -> FloatArray:
        """Largest disturbance per input, shape (m,), zero where there is none."""
        return self._per_input('disturbance_bound', absent=0.0)

    @property
    def constant_load(self) -> FloatArray:
        """Constant disturbance of every input, shape (m,)."""
        return self._per_input('constant_load', absent=0.0)

    @property
    def constant_load_bound(self) -> FloatArray:
        """Largest constant load per input, shape (m,), zero where there is none."""
        return self._per_input('constant_load_bound', absent=0.0)

    @property
    def further_plants(self) -> tuple[PlantModel, ...]:
        """Plants for which the promise has to hold besides.

        Raises
        ------
        ParameterError
            If the two lists do not hold equally many plants of this size.
        """
        model = self.model
        n, m = model.state_count, model.input_count
        a, b = self.promise.further_state_matrices, self.promise.further_input_matrices
        for name, values, size in (
            ('further_state_matrices', a, n * n),
            ('further_input_matrices', b, n * m),
        ):
            if len(values) % size:
                rule = f'must have a multiple of {size} entries'
                raise ParameterError(name, list(values), rule)
        count = max(len(a) // (n * n), len(b) // (n * m))
        states = np.array(a or (*model.state_matrix.ravel(),) * count).reshape(-1, n, n)
        inputs = np.array(b or (*model.input_matrix.ravel(),) * count).reshape(-1, n, m)
        if len(states) != len(inputs):
            rule = f'must hold as many plants as further_state_matrices, {len(states)}'
            raise ParameterError('further_input_matrices', list(b), rule)
        return tuple(
            PlantModel(state_matrix=one, input_matrix=two, output_vector=model.output_vector)
            for one, two in zip(states, inputs, strict=True)
        )

    @property
    def error_weights(self) -> FloatArray:
        """Weight of each state in the error, shape (n,), 1 where none are given.

        Raises
        ------
        ParameterError
            If it has neither 0 nor n entries, or every state is free.
        """
        n = self.model.state_count
        weights = np.array(self.objective.error_weights or (1.0,) * n)
        if weights.size != n:
            raise ParameterError('error_weights', weights.tolist(), f'must have 0 or {n} entries')
        if not np.any(weights):
            raise ParameterError('error_weights', weights.tolist(), 'must not all be 0')
        return weights

    @property
    def output_tolerance(self) -> float:
        """Tolerance of ``|c'(x - x_d)|``, infinite where there is none."""
        return self.objective.output_tolerance or np.inf

    def _per_input(self, name: str, *, absent: float) -> FloatArray:
        """Value of every input, shape (m,); ParameterError unless there are 0, 1 or m entries."""
        m = self.model.input_count
        values = self[name] or (absent,)
        if len(values) not in (1, m):
            raise ParameterError(name, list(values), f'must have 0, 1 or {m} entries')
        return np.broadcast_to(np.array(values), (m,))

    def _matrix(self, name: str, *, rows: int | None, columns: int | None) -> FloatArray:
        flat = np.array(self[name], dtype=np.float64)
        known = rows if rows is not None else columns
        assert known is not None
        wanted = rows * columns if rows is not None and columns is not None else None
        if flat.size == 0 or flat.size % known or (wanted is not None and flat.size != wanted):
            shape = f'{rows or "r"} x {columns or "m"}'
            raise ParameterError(
                name,
                list(self[name]),
                f'has {flat.size} entries, must have {shape} (row-major), since output_vector '
                f'has {self._state_count}',
            )
        return flat.reshape(rows or -1, columns or -1)

    def _regular_scene(self, model: PlantModel, height: int, width: int) -> PixelScene:
        n = model.state_count
        pitch = np.array(self.pixels.pixel_pitch)
        if pitch.size != 2 * n:
            raise ParameterError(
                'pixel_pitch',
                list(pitch),
                f'must have 2 x {n} entries, since output_vector has {n}',
            )
        origin = np.array(self.pixels.pixel_origin or (0.0,) * n)
        if origin.size != n:
            raise ParameterError('pixel_origin', list(origin), f'must have {n} entries')
        groups = self._groups(height, width)
        column, row = np.arange(width) - (width - 1) / 2, np.arange(height) - (height - 1) / 2
        if groups is not None:
            steps = row[:, None, None] * pitch[n:] + column[None, :, None] * pitch[:n]
            return PixelScene.from_offsets(
                model,
                (origin + steps).reshape(-1, n),
                height=height,
                width=width,
                groups=groups,
            )
        column_step, row_step = (pitch.reshape(2, n) @ model.gradient).tolist()
        offsets = float(origin @ model.gradient) + (row[:, None] * row_step + column * column_step)
        return PixelScene(brightness_offsets=offsets.ravel(), height=height, width=width)

    def _groups(self, height: int, width: int) -> NDArray[np.intp] | None:
        """Pixel group of every pixel, shape (r,); None where there is one."""
        named = np.array(self.pixels.pixel_groups, np.intp)
        if named.size not in (0, height, height * width):
            raise ParameterError(
                'pixel_groups',
                named.tolist(),
                f'must have {height} entries, one for each row of pixel_grid, or '
                f'{height * width}, one for each pixel',
            )
        if not named.any():
            return None
        return named if named.size == height * width else np.repeat(named, width)


def load_scenario(
    path: str | Path, *, namespace: str | None = None, node: str | None = None
) -> Scenario:
    """Scenario of a ROS 2 parameter file, with the knots of a brightness profile in its place.

    Parameters
    ----------
    path
        YAML file; its keys are ``/**``, names of nodes, or what else rcl matches with a node.
    namespace
        Absolute namespace of the loop, empty for the root; None for that of the file's keys.
    node
        Node whose values count where those of the nodes differ; otherwise the plant's count
        before the camera's, and the camera's before the controller's.

    Raises
    ------
    ParameterError
        If the file can't be read, is no parameter file, has a key that matches no node of the
        loop, names an unknown parameter, or a value breaks its rule; or its brightness_profile
        can't be read.
    """
    values = read_loop_values(path, namespace).merged(node)
    profile = values.get('brightness_profile')
    if isinstance(profile, str) and profile.startswith(('./', '../')):
        values['brightness_profile'] = str((Path(path).parent / profile).resolve())
    scenario = Scenario.from_values(values)
    read = scenario.scene.profile if profile else None
    return scenario if read is None else scenario.replace(brightness_profile=as_text(read))
