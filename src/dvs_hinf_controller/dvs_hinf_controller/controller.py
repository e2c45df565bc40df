"""The controller K as matrices: from the means of the deviations zbar_i to the inputs u."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dvs_common.arrays import FloatArray, finite_array
from dvs_common.errors import ParameterError

if TYPE_CHECKING:
    import control


@dataclass(frozen=True, slots=True, kw_only=True)
class LinearController:
    """``xc' = Ac xc + Bc e``, ``u = Cc xc + Dc e`` with ``e = mean(zbar_i)`` (paper, eq. 24).

    An optimal controller acts on the mean alone, whatever the number of pixels: all pixels see the
    same ``c'x`` (docs/theory.md, "Reduction"). Of several pixel groups it takes a mean each
    (docs/pixel_groups.md); Bc and Dc have a column a group then.

    Parameters
    ----------
    state_matrix
        Ac, shape (k, k), 1/s; k = 0 is a static gain.
    input_vector
        Bc, shape (k,); (k, groups) where there are several pixel groups.
    output_matrix
        Cc, shape (m, k).
    feedthrough
        Dc, shape (m,); (m, groups) likewise.

    Raises
    ------
    ParameterError
        If a shape does not fit or an entry is not finite.
    """

    state_matrix: FloatArray
    input_vector: FloatArray
    output_matrix: FloatArray
    feedthrough: FloatArray

    def __post_init__(self) -> None:
        """Check the shapes and freeze the arrays."""
        channel = 2 if np.ndim(self.feedthrough) == 2 else 1
        dims = {
            'state_matrix': 2,
            'input_vector': channel,
            'output_matrix': 2,
            'feedthrough': channel,
        }
        for name, ndim in dims.items():
            object.__setattr__(self, name, finite_array(name, getattr(self, name), ndim=ndim))
        k, m = len(self.input_vector), len(self.feedthrough)
        if (
            self.state_matrix.shape != (k, k)
            or self.output_matrix.shape != (m, k)
            or self.input_vector.shape[1:] != self.feedthrough.shape[1:]
        ):
            raise ParameterError(
                'controller',
                {name: getattr(self, name).shape for name in dims},
                'must have shapes (k, k), (k,), (m, k) and (m,), or with a column a group '
                '(k, k), (k, p), (m, k) and (m, p)',
            )

    @property
    def input_matrix(self) -> FloatArray:
        """Bc with a column a pixel group, shape (k, groups)."""
        return self.input_vector if self.input_vector.ndim == 2 else self.input_vector[:, None]

    @property
    def feedthrough_matrix(self) -> FloatArray:
        """Dc with a column a pixel group, shape (m, groups)."""
        return self.feedthrough if self.feedthrough.ndim == 2 else self.feedthrough[:, None]

    @property
    def group_count(self) -> int:
        """Number of pixel groups whose means it takes."""
        return int(self.feedthrough_matrix.shape[1])

    @property
    def order(self) -> int:
        """Number of states k."""
        return len(self.input_vector)

    @property
    def input_count(self) -> int:
        """Number of plant inputs m that it drives."""
        return len(self.feedthrough)

    def state_space(self) -> control.StateSpace:
        """K as a system of python-control, from e to the m inputs u."""
        import control

        return control.ss(
            self.state_matrix,
            self.input_matrix,
            self.output_matrix,
            self.feedthrough_matrix,
        )

    def response(self, frequencies: FloatArray) -> np.ndarray:
        """Frequency response K(jw), complex, shape (len(frequencies), m).

        Parameters
        ----------
        frequencies
            w, shape (f,), rad/s.
        """
        identity = np.eye(self.order)
        pencil = 1j * np.asarray(frequencies)[:, None, None] * identity - self.state_matrix
        states = np.linalg.solve(
            pencil, np.broadcast_to(self.input_vector[:, None], (len(pencil), self.order, 1))
        )
        return np.asarray((self.output_matrix @ states)[..., 0] + self.feedthrough)
