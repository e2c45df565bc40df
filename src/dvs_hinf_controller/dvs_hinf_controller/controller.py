"""The controller K as matrices: from the mean of the deviations zbar_i to the inputs u."""

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
    same ``c'x`` (docs/theory.md, "Reduction").

    Parameters
    ----------
    state_matrix
        Ac, shape (k, k), 1/s; k = 0 is a static gain.
    input_vector
        Bc, shape (k,).
    output_matrix
        Cc, shape (m, k).
    feedthrough
        Dc, shape (m,).

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
        dims = {'state_matrix': 2, 'input_vector': 1, 'output_matrix': 2, 'feedthrough': 1}
        for name, ndim in dims.items():
            object.__setattr__(self, name, finite_array(name, getattr(self, name), ndim=ndim))
        k, m = self.input_vector.size, self.feedthrough.size
        if self.state_matrix.shape != (k, k) or self.output_matrix.shape != (m, k):
            raise ParameterError(
                'controller',
                {name: getattr(self, name).shape for name in dims},
                'must have shapes (k, k), (k,), (m, k) and (m,)',
            )

    @property
    def order(self) -> int:
        """Number of states k."""
        return int(self.input_vector.size)

    @property
    def input_count(self) -> int:
        """Number of plant inputs m that it drives."""
        return int(self.feedthrough.size)

    def state_space(self) -> control.StateSpace:
        """K as a system of python-control, with the one input e and the m inputs u as outputs."""
        import control

        return control.ss(
            self.state_matrix,
            self.input_vector[:, None],
            self.output_matrix,
            self.feedthrough[:, None],
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
