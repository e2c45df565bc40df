"""Lower bound of ``N_G + N_T`` of any stabilizing controller, by a linear program of its own.

No Youla family, no observer, no filters. With any u, the response g of x to an impulse of w obeys
``g' = A g + B u`` from ``g(0-) = 0``, and for the modes of A that do not decay, ``A basis = basis
A_u`` and ``c_u = c' basis``, it must be that ``integral g c_u exp(-A_u t) dt = -basis`` (Boyd and
Barratt 1991, chapter 7; Dahleh and Diaz-Bobillo 1995, chapter 6). So for every matrix Xi, and
every function phi with ``B'phi = 0`` that ends at zero,

    Y = Xi (c_u exp(-A_u t))' - phi' - A'phi   has   integral Y'g dt = -sum Xi_ij basis_ij,

whatever u is. Where ``Y = c y_0 + sum v_j y_j``, ``|y_0| <= 1``, ``|y_j| <= p_j``, ``sum p_j = 1``
for some unit vectors v_j, it is at most ``N_T + N_G``: the dual program seeks the largest such
value. Here phi is linear between nodes and zero at the end, where Y only decays or turns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse

from dvs_common.scenario.model import PlantModel

# Cells from one doubling of their length to the next, and the first one's length over the
# fastest time constant: coarse first.
_GRIDS = ((4, 0.02), (12, 0.005), (24, 0.001))
# A mode turns by at most this angle in a cell: then Y is linear in it to 0.3 %.
_WIDEST_ANGLE, _ALIVE = 0.15, 7.0
_HORIZON = 20.0
_STILL = 1e-3
# Rounding moves a triple pole at zero by 1e-5; damping begins at 5e-5 here.
_EDGE = -3e-5
_MOST_CUTS, _MOST_ADDED = 12, 8


def l1_lower_bound(model: PlantModel, *, enough: float = np.inf) -> float:
    """The optimum from below, but for half a per cent; some per cent below it.

    Parameters
    ----------
    model
        Plant, stabilizable and detectable, with rates near 1, in units where the tolerance and
        the mean luminosity are 1.
    enough
        Value at which the search for a larger one ends.
    """
    best, directions = 0.0, np.eye(model.state_count)
    for cells_per_doubling, first in _GRIDS:
        program = _Program.on_grid(model, cells_per_doubling, first)
        before = 0.0
        for _ in range(_MOST_CUTS):
            solution = program.solve(directions)
            best = max(best, solution.value)
            if best >= enough:
                return best
            if solution.value < 1.005 * before:
                break
            before = solution.value
            steep, sizes = _steep_directions(solution.response)
            accounted = float(np.abs(solution.response @ directions).sum(axis=0).max())
            counted = directions[:, solution.shares > 1e-4]
            added = steep[:, sizes > accounted][:, :_MOST_ADDED]
            directions = np.column_stack([counted, added])
    return best


@dataclass(frozen=True, slots=True, kw_only=True)
class _Solution:
    """Value, g times the length of its cell at both ends of every cell, and p of every v."""

    value: float
    response: np.ndarray
    shares: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class _Program:
    """``left (Xi, psi) = V y`` at both ends of every cell, and the value of Xi."""

    left: scipy.sparse.csc_array
    gains: np.ndarray
    output: np.ndarray

    @classmethod
    def on_grid(cls, model: PlantModel, cells_per_doubling: int, first: float) -> _Program:
        times, still = _times(model, cells_per_doubling, first)
        modes, wanted = _modes_at(model, times)
        n, cells = model.state_count, times.size - 1
        free = scipy.linalg.null_space(model.input_matrix.T)
        drift = model.state_matrix.T @ free
        moving = int((times < times[-1] - still).sum())
        units = np.append(np.diff(times), 1.0)
        blocks = scipy.sparse.lil_array(
            (cells * 2 * n, n * modes.shape[1] + free.shape[1] * moving)
        )
        for cell in range(cells):
            length = times[cell + 1] - times[cell]
            for end in (0, 1):
                rows = slice((2 * cell + end) * n, (2 * cell + end + 1) * n)
                blocks[rows, : n * modes.shape[1]] = np.kron(np.eye(n), modes[cell + end])
                for node, slope in ((cell, 1 / length), (cell + 1, -1 / length)):
                    if node < moving:
                        at = n * modes.shape[1] + free.shape[1] * node
                        here = free * slope - drift * (node == cell + end)
                        blocks[rows, at : at + free.shape[1]] = here * units[node]
        gains = np.concatenate([wanted.ravel(), np.zeros(free.shape[1] * moving)])
        return cls(left=blocks.tocsc(), gains=gains, output=model.output_vector)

    def solve(self, directions: np.ndarray) -> _Solution:
        clarabel = pytest.importorskip('clarabel')
        n, count = directions.shape
        ends = self.left.shape[0] // n
        seen = np.column_stack([self.output, directions])
        rows, unknowns = self.left.shape
        sizes = ends * (1 + count)
        equal = scipy.sparse.hstack(
            [self.left, -scipy.sparse.kron(scipy.sparse.eye_array(ends), seen)]
        )
        shares = np.vstack([np.zeros((1, count)), np.eye(count)])
        tops = scipy.sparse.kron(np.ones((ends, 1)), -shares)
        eye = scipy.sparse.eye_array(sizes)
        nothing = scipy.sparse.csc_array((sizes, unknowns))
        matrix = scipy.sparse.vstack(
            [
                scipy.sparse.hstack([equal, scipy.sparse.csc_array((rows, count))]),
                np.append(np.zeros(unknowns + sizes), np.ones(count))[None],
                scipy.sparse.hstack([nothing, eye, tops]),
                scipy.sparse.hstack([nothing, -eye, tops]),
            ]
        )
        most = np.tile(np.append(1.0, np.zeros(count)), ends)
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        scale = np.abs(self.gains).max()
        found = clarabel.DefaultSolver(
            scipy.sparse.csc_matrix((matrix.shape[1],) * 2),
            np.append(-self.gains / scale, np.zeros(sizes + count)),
            scipy.sparse.csc_matrix(matrix),
            np.concatenate([np.zeros(rows), [1.0], most, most]),
            [clarabel.ZeroConeT(rows + 1), clarabel.NonnegativeConeT(2 * sizes)],
            settings,
        ).solve()
        assert 'Solved' in str(found.status), found.status
        return _Solution(
            value=-found.obj_val * scale,
            response=np.array(found.z[:rows]).reshape(ends, n) * scale,
            shares=np.array(found.x[-count:]),
        )


def _times(model: PlantModel, cells_per_doubling: int, first: float) -> tuple[np.ndarray, float]:
    """Nodes, and the part at the end where phi is zero: a whole turn of what does not decay."""
    modes = np.linalg.eigvals(model.state_matrix)
    modes = modes[np.abs(modes) > _STILL]  # rounding moves a triple pole by 1e-5
    rates = np.abs(modes)
    slow = float(rates.min(initial=1.0))
    rate = min(float(rates.max(initial=1.0)), 30 * slow)
    turning = np.abs(modes.imag[(modes.real >= _EDGE) & (modes.real < 0.05 * rates)])
    still = 2.2 * np.pi / turning[turning > _STILL].min(initial=np.inf)
    edges, step = [0.0], first / rate
    while edges[-1] < _HORIZON / slow + still:
        edges += (edges[-1] + step * np.arange(1, cells_per_doubling + 1)).tolist()
        alive = rates[np.abs(modes.real) * edges[-1] < _ALIVE]
        if 2 * step * alive.max(initial=0.0) <= _WIDEST_ANGLE:
            step *= 2
    return np.array(edges), max(still, 1.5 * step)


def _modes_at(model: PlantModel, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bounded rows ``c_u exp(-A_u t)`` at every time, shape (N, q), and what each asks of g."""
    a = model.state_matrix
    # The modes that do not decay come first, and of those the ones that move.
    t, q, count = scipy.linalg.schur(a, output='real', sort=lambda re, im: re >= _EDGE)
    basis, flow = q[:, :count], t[:count, :count]
    rows = np.array([model.output_vector @ basis @ scipy.linalg.expm(-flow * s) for s in times])
    wanted = -basis
    moving = np.abs(np.linalg.eigvals(flow)) > _STILL if count else np.zeros(0, dtype=bool)
    if count - moving.sum() > 1:  # a chain of integrators: only its end stays bounded
        _, turn, kept = scipy.linalg.schur(
            flow, output='real', sort=lambda re, im: np.hypot(re, im) > _STILL
        )
        bounded = np.column_stack([turn[:, :kept], np.linalg.svd(flow)[2][-1]])
        rows, wanted = rows @ bounded, wanted @ bounded
    size = np.abs(rows).max(axis=0, initial=1e-300)
    return rows / size, wanted / size


def _steep_directions(response: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors v with a (locally) large ``sum |v'g|``, the largest first, and these sums."""
    rng = np.random.default_rng(0)
    v = rng.standard_normal((response.shape[1], 200))
    for _ in range(60):
        v = response.T @ np.sign(response @ v)
        v /= np.maximum(np.linalg.norm(v, axis=0), 1e-300)
    v = v[:, np.argsort(-np.abs(response @ v).sum(axis=0))]
    apart = ~np.tril(np.abs(v.T @ v) > 0.98, -1).any(axis=1)
    return v[:, apart], np.abs(response @ v[:, apart]).sum(axis=0)
