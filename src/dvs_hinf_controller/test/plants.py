"""Random plants and independent optima for the tests of the synthesis."""

from __future__ import annotations

import numpy as np
import scipy.linalg
from hypothesis import strategies as st

from dvs_common.scenario.model import PlantModel


@st.composite
def plants(draw, *, max_states: int = 6, max_inputs: int = 3) -> PlantModel:
    """Plants with real and complex modes, stable and unstable, of moderate condition."""
    n = draw(st.integers(1, max_states))
    m = draw(st.integers(1, max_inputs))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    blocks = []
    while sum(len(block) for block in blocks) < n:
        real, imaginary = rng.uniform(-2, 2), rng.uniform(0.3, 3)
        left = n - sum(len(block) for block in blocks)
        if left > 1 and rng.random() < 0.4:
            blocks.append(np.array([[real, imaginary], [-imaginary, real]]))
        else:
            blocks.append(np.array([[real]]))
    basis = np.linalg.qr(rng.standard_normal((n, n)))[0] * np.exp(rng.uniform(-0.4, 0.4, n))
    state_matrix = basis @ scipy.linalg.block_diag(*blocks) @ np.linalg.inv(basis)
    return PlantModel(
        state_matrix=state_matrix,
        input_matrix=rng.standard_normal((n, m)),
        output_vector=rng.standard_normal(n),
    )


def one_input_gains(model: PlantModel, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``|c'P|`` and ``||P||`` of ``P = (sI - A)^-1 B`` at complex s."""
    n = model.state_count
    p = np.linalg.solve(
        s[:, None, None] * np.eye(n) - model.state_matrix,
        np.broadcast_to(model.input_matrix, (s.size, n, 1)),
    )[:, :, 0]
    return np.abs(p @ model.output_vector), np.linalg.norm(p, axis=1)


def nevanlinna_pick_optimum(model: PlantModel, *, structured: bool) -> float:
    """Infimum of ``sup ||G||`` or of mu for one input, by interpolation, not Riccati equations.

    T(p) = -1 at unstable poles and T(z) = 0 at right half plane zeros, all distinct; the
    weight is the outer function with ``|V| = ||G||/|T|`` or ``1 + ||G||/|T|``.
    """
    poles = np.linalg.eigvals(model.state_matrix)
    poles = poles[poles.real > 0]
    zeros = _right_half_plane_zeros(model)
    frequencies = np.geomspace(1e-5, 1e6, 40001)
    output, state = one_input_gains(model, 1j * frequencies)
    log_weight = np.log(state / output + (1 if structured else 0))
    points = np.concatenate([poles, zeros])
    outer = [
        np.exp(
            2
            / np.pi
            * scipy.integrate.trapezoid(
                log_weight * s * frequencies / (s**2 + frequencies**2), np.log(frequencies)
            )
        )
        for s in points
    ]
    values = np.array(outer) * np.concatenate([-np.ones(poles.size), np.zeros(zeros.size)])
    sums = points[:, None] + points[None, :].conj()
    pick = scipy.linalg.eigh(np.outer(values, values.conj()) / sums, 1 / sums, eigvals_only=True)
    return float(np.sqrt(pick[-1]))


def _right_half_plane_zeros(model: PlantModel) -> np.ndarray:
    n = model.state_count
    pencil = np.block(
        [
            [model.state_matrix, model.input_matrix],
            [model.output_vector[None, :], np.zeros((1, 1))],
        ]
    )
    mass = scipy.linalg.block_diag(np.eye(n), np.zeros((1, 1)))
    zeros = scipy.linalg.eigvals(pencil, mass)
    return zeros[np.isfinite(zeros) & (zeros.real > 0) & (np.abs(zeros) < 1e6)]
