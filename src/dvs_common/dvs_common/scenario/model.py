"""The linear plant, the scene that its pixels see, and the set-points it can hold.

Every other package describes the plant by these types: the simulator steps it, the controller is
designed for it and the exact hybrid automaton runs it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dvs_common.arrays import FloatArray, finite_array
from dvs_common.errors import ParameterError
from dvs_common.scenario.brightness_profile import BrightnessProfile
from dvs_common.scenario.reachability import (
    RANK_TOLERANCE,
    null_space_projector,
    unreachable_basis,
    unreachable_unstable_mode,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantModel:
    """Plant ``xdot = A x + B u`` whose luminosity varies with ``c'x`` (paper, eq. 1).

    Parameters
    ----------
    state_matrix
        A, shape (n, n), 1/s.
    input_matrix
        B, shape (n, m).
    output_vector
        c, shape (n,): gradient of the pixel group; or a row a group, shape (k, n), where
        pixels see different ones.

    Raises
    ------
    ParameterError
        If a shape does not fit, an entry is not finite or a group is zero.
    """

    state_matrix: FloatArray
    input_matrix: FloatArray
    output_vector: FloatArray

    def __post_init__(self) -> None:
        """Check the shapes and freeze the arrays."""
        groups = 2 if np.ndim(self.output_vector) == 2 else 1
        for name, ndim in (('state_matrix', 2), ('input_matrix', 2), ('output_vector', groups)):
            object.__setattr__(self, name, finite_array(name, getattr(self, name), ndim=ndim))
        n = self.output_vector.shape[-1]
        if self.output_vector.size == 0 or not self.gradients.any(axis=1).all():
            raise ParameterError('output_vector', self.output_vector, 'must not be zero')
        if self.state_matrix.shape != (n, n):
            raise ParameterError(
                'state_matrix',
                self.state_matrix.shape,
                f'must be {n} x {n}, since output_vector has {n} entries',
            )
        if self.input_matrix.shape[0] != n or self.input_matrix.shape[1] < 1:
            raise ParameterError(
                'input_matrix',
                self.input_matrix.shape,
                f'must be {n} x m with m >= 1, since output_vector has {n} entries',
            )

    @property
    def state_count(self) -> int:
        """Number of states n."""
        return int(self.state_matrix.shape[0])

    @property
    def input_count(self) -> int:
        """Number of inputs m."""
        return int(self.input_matrix.shape[1])

    @property
    def gradients(self) -> FloatArray:
        """A row a pixel group, shape (k, n)."""
        return np.atleast_2d(self.output_vector)

    @property
    def gradient(self) -> FloatArray:
        """c, shape (n,), of a plant with one pixel group.

        Raises
        ------
        ParameterError
            If there are more.
        """
        self.require_one_group('this')
        row: FloatArray = self.gradients[0]
        return row

    @property
    def group_count(self) -> int:
        """Number of pixel groups k."""
        return len(self.gradients)

    def require_one_group(self, who: str) -> None:
        """Raise `ParameterError` if there is more than one pixel group.

        Parameters
        ----------
        who
            What is made for one group only.
        """
        if self.group_count > 1:
            raise ParameterError(
                'output_vector',
                self.output_vector.tolist(),
                f'has {self.group_count} pixel groups; {who} takes one (docs/pixel_groups.md)',
            )

    def require_stabilizable(self) -> None:
        """Raise `ParameterError` if an unstable mode of (A, B) is not reachable."""
        mode = unreachable_unstable_mode(self.state_matrix, self.input_matrix)
        if mode is not None:
            raise ParameterError(
                'input_matrix',
                self.input_matrix.tolist(),
                f'leaves the unstable mode s = {mode:.6g} of state_matrix out of reach: '
                'the plant is not stabilizable',
            )

    def require_detectable(self) -> None:
        """Raise `ParameterError` if an unstable mode of A is not seen by c."""
        mode = unreachable_unstable_mode(self.state_matrix.T, self.gradients.T)
        if mode is not None:
            raise ParameterError(
                'output_vector',
                self.output_vector.tolist(),
                f'does not see the unstable mode s = {mode:.6g} of state_matrix: '
                'the plant is not detectable',
            )

    def equilibrium(self, set_point: ArrayLike, *, tolerance: float) -> Equilibrium:
        """Nearest stabilizable set-point and the input that holds it (paper, below eq. 2).

        A set-point x_d can be held iff it is reachable and ``A x_d`` lies in range(B).

        Parameters
        ----------
        set_point
            Wanted x_d, shape (n,).
        tolerance
            Largest accepted residual ``||(I - B B^+) A x_d||`` and distance to the reachable
            subspace; coefficients printed to a few digits need it.

        Returns
        -------
        Equilibrium
            The orthogonal projection of `set_point` on the stabilizable set-points.

        Raises
        ------
        ParameterError
            If the residual exceeds `tolerance`; the message names the nearest stabilizable point.
        """
        wanted = finite_array('set_point', set_point, ndim=1)
        n = self.state_count
        if wanted.size != n:
            raise ParameterError(
                'set_point', wanted.tolist(), f'must have as many entries as output_vector, {n}'
            )
        a, b = self.state_matrix, self.input_matrix
        pseudo_inverse = np.linalg.pinv(b, rcond=RANK_TOLERANCE)
        outside_range = (np.eye(n) - b @ pseudo_inverse) @ a
        unreachable = unreachable_basis(a, b).T
        residual = float(
            max(np.linalg.norm(outside_range @ wanted), np.linalg.norm(unreachable @ wanted))
        )
        nearest = null_space_projector(np.vstack([outside_range, unreachable])) @ wanted
        if residual > tolerance:
            raise ParameterError(
                'set_point',
                wanted.tolist(),
                f'is not stabilizable: its residual {residual:.4g} exceeds set_point_tolerance '
                f'= {tolerance:g}. The nearest stabilizable set-point is '
                f'[{", ".join(f"{value:.9g}" for value in nearest)}]',
            )
        nearest.setflags(write=False)
        feedforward = -pseudo_inverse @ a @ nearest
        feedforward.setflags(write=False)
        return Equilibrium(state=nearest, feedforward=feedforward, residual=residual)


@dataclass(frozen=True, slots=True, kw_only=True)
class Equilibrium:
    """A set-point that the plant can hold, and how.

    Parameters
    ----------
    state
        x_d, shape (n,), with ``A x_d`` in range(B).
    feedforward
        Input that holds it, ``-B^+ A x_d``, shape (m,) (paper, eq. 3).
    residual
        How far the point that the user asked for was from being stabilizable.
    """

    state: FloatArray
    feedforward: FloatArray
    residual: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelScene:
    """Scene: pixel i sees ``y_i = c'(x + dx_i)`` (paper, eq. 1), or a profile over it.

    All pixels of a pixel group move with the one scalar ``c'x``; pixel i adds the constant
    ``c'dx_i``.

    Parameters
    ----------
    brightness_offsets
        ``c'dx_i`` of every pixel, shape (r,), row-major over the pixel array.
    height
        Rows of the pixel array.
    width
        Columns of the pixel array; ``height * width = r``.
    profile
        Luminosity over ``c'(x + dx_i)``; None where it is that itself.
    groups
        Pixel group that every pixel sees, shape (r,), from 0; None where there is one.

    Raises
    ------
    ParameterError
        If the number of offsets or of groups is not ``height * width``.
    """

    brightness_offsets: FloatArray
    height: int
    width: int
    profile: BrightnessProfile | None = None
    groups: NDArray[np.intp] | None = None

    def __post_init__(self) -> None:
        """Check the shape and freeze the array."""
        offsets = finite_array('pixel_offsets', self.brightness_offsets, ndim=1)
        object.__setattr__(self, 'brightness_offsets', offsets)
        if self.height < 1 or self.width < 1 or self.height * self.width != offsets.size:
            raise ParameterError(
                'pixel_grid',
                [self.height, self.width],
                f'must be positive and hold the {offsets.size} pixels of pixel_offsets',
            )
        if self.groups is not None and self.groups.shape != offsets.shape:
            raise ParameterError(
                'pixel_groups', self.groups.tolist(), f'must have {offsets.size} entries'
            )

    @classmethod
    def from_offsets(
        cls,
        model: PlantModel,
        pixel_offsets: ArrayLike,
        *,
        height: int,
        width: int,
        groups: NDArray[np.intp] | None = None,
    ) -> PixelScene:
        """Scene of the plant `model` seen by pixels displaced by `pixel_offsets`.

        Parameters
        ----------
        model
            Plant with the brightness gradient c.
        pixel_offsets
            dx, shape (r, n), row-major over the pixel array.
        height
            Rows of the pixel array.
        width
            Columns of the pixel array.
        groups
            Pixel group of every pixel, shape (r,); None where there is one.

        Raises
        ------
        ParameterError
            If `pixel_offsets` does not have n columns or ``height * width`` rows.
        """
        offsets = finite_array('pixel_offsets', pixel_offsets, ndim=2)
        if offsets.shape[1] != model.state_count:
            raise ParameterError(
                'pixel_offsets', offsets.shape, f'must have {model.state_count} columns'
            )
        if groups is None:
            brightness = offsets @ model.gradient
        elif groups.size != len(offsets):
            rule = f'must have {len(offsets)} entries, one for each pixel'
            raise ParameterError('pixel_groups', groups.tolist(), rule)
        else:
            brightness = np.sum(offsets * model.gradients[groups], axis=1)
        return cls(brightness_offsets=brightness, height=height, width=width, groups=groups)

    def pixels_of(self, group: int) -> NDArray[np.intp]:
        """Row-major numbers of the pixels that see a pixel group.

        Parameters
        ----------
        group
            From 0.
        """
        if self.groups is None:
            return np.arange(self.pixel_count)
        return np.flatnonzero(self.groups == group)

    @property
    def pixel_count(self) -> int:
        """Number of pixels r."""
        return int(self.brightness_offsets.size)

    def positions(self, model: PlantModel, state: ArrayLike) -> FloatArray:
        """``c'x + c'dx_i`` of every pixel, shape (r,).

        Parameters
        ----------
        model
            Plant with the brightness gradient c.
        state
            Plant state x in original coordinates, shape (n,).
        """
        state = np.asarray(state, dtype=np.float64)
        if self.groups is None:
            return float(model.gradient @ state) + self.brightness_offsets
        positions: FloatArray = (model.gradients @ state)[self.groups]
        return positions + self.brightness_offsets

    def luminosity(self, model: PlantModel, state: ArrayLike) -> FloatArray:
        """Luminosity y_i of every pixel, shape (r,): `positions`, or the profile there.

        Parameters
        ----------
        model
            Plant with the brightness gradient c.
        state
            Plant state x in original coordinates, shape (n,).
        """
        positions = self.positions(model, state)
        return positions if self.profile is None else self.profile.luminosity(positions)

    def straightened(self, model: PlantModel, state: ArrayLike, slope: float) -> PixelScene:
        """Affine scene for the gradient ``slope c`` that shows the same light at a state.

        Parameters
        ----------
        model
            Plant with the brightness gradient c.
        state
            Plant state x in original coordinates, shape (n,).
        slope
            Slope of the line that takes the place of the profile.
        """
        bare = replace(self, brightness_offsets=np.zeros(self.pixel_count), profile=None)
        along = slope * bare.positions(model, state)
        return replace(bare, brightness_offsets=self.luminosity(model, state) - along)
