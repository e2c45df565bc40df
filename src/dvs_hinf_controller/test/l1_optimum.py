"""Least ``N_G + N_T`` of any stabilizing controller, by a linear program of its own.

Unknown is the command itself, ``u(t)`` after an impulse of w, constant over cells and with an
impulse at t = 0: no Youla family, no observer, no filters. A stabilizing controller with this
response exists if x dies out and ``(I + G c') (sI - A)^-1`` is stable, both linear in u
(Boyd and Barratt 1991, chapter 7; Dahleh and Diaz-Bobillo 1995, chapter 6).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.optimize
import scipy.sparse

from dvs_common.scenario.model import PlantModel

_CELLS_PER_OCTAVE = 4
_NODES_PER_CELL = 2
_FASTEST = 300.0
_SLOWEST = 14.0
_MOST_CUTS = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class _Affine:
    """``g = free + by_u u`` at the nodes, and ``equal u = wanted``."""

    by_u: np.ndarray
    weights: np.ndarray
    equal: np.ndarray
    wanted: np.ndarray


def l1_optimum(model: PlantModel, *, rtol: float = 2e-2) -> float:
    """The optimum to within some per cent, from above but for the directions left out.

    Parameters
    ----------
    model
        Plant, stabilizable and detectable, with rates near 1, in units where the tolerance and
        the mean luminosity are 1.
    rtol
        Relative excess of the worst direction at which no further one is added.
    """
    problem = _responses(model)
    rows = [model.output_vector]
    best, u = 0.0, np.zeros(problem.by_u.shape[2])
    directions = [np.full(model.state_count, model.state_count**-0.5)]
    for _ in range(_MOST_CUTS):
        best, u = _solved(problem, rows, directions)
        g = problem.by_u @ u
        v, worst = _worst_direction(g, problem.weights)
        accounted = max(float(problem.weights @ np.abs(g @ d)) for d in directions)
        if worst <= accounted * (1 + rtol):
            break
        directions.append(v)
    return best


def _responses(model: PlantModel) -> _Affine:
    stable, unstable = _split(model)
    rates = np.abs(np.linalg.eigvals(model.state_matrix))
    rates = rates[rates > 1e-3]  # rounding moves a triple pole by 1e-5
    slow = float(rates.min(initial=1.0))
    rate = min(float(rates.max(initial=1.0)), 30 * slow)
    edges = _edges(1 / (_FASTEST * rate), _SLOWEST / slow)
    nodes = np.concatenate(
        [np.linspace(a, b, _NODES_PER_CELL, endpoint=False) for a, b in itertools.pairwise(edges)]
        + [edges[-1:]]
    )
    m = model.input_count
    parts = [
        _answers(stable, nodes, edges, forward=True),
        _answers(unstable, nodes, edges, forward=False),
    ]
    by_u = sum(
        np.einsum('ij,tjk->tik', part.basis, answer)
        for part, answer in zip((stable, unstable), parts, strict=True)
    )
    start = -parts[1][0]
    start[:, :m] += unstable.b
    weights = _trapezoid(nodes)
    inner = np.array([unstable.c @ scipy.linalg.expm(-unstable.a * t) for t in nodes])
    at_modes = np.einsum('t,tj,tik->ijk', weights, inner, by_u).reshape(-1, by_u.shape[2])
    return _Affine(
        by_u=by_u,
        weights=weights,
        equal=np.vstack([start, at_modes]),
        wanted=np.concatenate([np.zeros(len(start)), -unstable.basis.ravel()]),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Part:
    """Modes of a kind: ``x = basis z``, ``z' = a z + b u``, and c'x = c z."""

    basis: np.ndarray
    a: np.ndarray
    b: np.ndarray
    c: np.ndarray


def _split(model: PlantModel) -> tuple[_Part, _Part]:
    """Modes left of the axis, and the others."""
    a = model.state_matrix
    edge = -2e-4
    t, q, count = scipy.linalg.schur(a, output='real', sort=lambda re, im: re < edge)
    x = scipy.linalg.solve_sylvester(t[:count, :count], -t[count:, count:], -t[:count, count:])
    basis = q @ np.block(
        [[np.eye(count), x], [np.zeros((len(a) - count, count)), np.eye(len(a) - count)]]
    )
    b = np.linalg.solve(basis, model.input_matrix)
    parts = []
    for index in (slice(0, count), slice(count, None)):
        columns = basis[:, index]
        parts.append(
            _Part(
                basis=columns,
                a=t[index, index],
                b=b[index],
                c=model.output_vector @ columns,
            )
        )
    return parts[0], parts[1]


def _edges(first: float, last: float) -> np.ndarray:
    edges, step = [0.0], first
    while edges[-1] < last:
        edges += (edges[-1] + step * np.arange(1, _CELLS_PER_OCTAVE + 1)).tolist()
        step *= 2
    return np.array(edges)


def _answers(part: _Part, nodes: np.ndarray, edges: np.ndarray, *, forward: bool) -> np.ndarray:
    """z at the nodes by (impulse, u of every cell), shape (N, size, m (1 + cells)).

    Forward from rest; or backward from rest at the end, which is the same z if it begins at what
    the impulse leaves.
    """
    size, m = part.b.shape
    out = np.zeros((nodes.size, size, m * edges.size))
    if forward:
        out[0, :, :m] = part.b
    flow = np.zeros((size + m, size + m))
    flow[:size, :size], flow[:size, size:] = part.a, part.b
    flow = flow if forward else -flow
    cells = np.searchsorted(edges, (nodes[1:] + nodes[:-1]) / 2) - 1
    steps = range(nodes.size - 1) if forward else range(nodes.size - 2, -1, -1)
    length, moved = 0.0, np.eye(size + m)
    for step in steps:
        here, there = (step, step + 1) if forward else (step + 1, step)
        wanted = nodes[step + 1] - nodes[step]
        if abs(wanted - length) > 1e-9 * wanted:
            length, moved = wanted, scipy.linalg.expm(flow * wanted)
        out[there] = moved[:size, :size] @ out[here]
        at = slice(m * (1 + cells[step]), m * (2 + cells[step]))
        out[there][:, at] += moved[:size, size:]
    return out


def _trapezoid(nodes: np.ndarray) -> np.ndarray:
    gaps = np.diff(nodes)
    return (np.append(gaps, 0.0) + np.append(0.0, gaps)) / 2


def _worst_direction(g: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, float]:
    """Unit v with a (locally) largest ``integral |v'g|``, from many starts."""
    rng = np.random.default_rng(0)
    v = rng.standard_normal((g.shape[1], 200))
    for _ in range(60):
        v = (weights[:, None] * g).T @ np.sign(g @ v)
        v /= np.maximum(np.linalg.norm(v, axis=0), 1e-300)
    totals = weights @ np.abs(g @ v)
    best = int(np.argmax(totals))
    return v[:, best], float(totals[best])


def _solved(
    problem: _Affine, rows: list[np.ndarray], directions: list[np.ndarray]
) -> tuple[float, np.ndarray]:
    nodes, _, unknowns = problem.by_u.shape
    seen = [*rows, *directions]
    total = nodes * len(seen)
    size = np.maximum(
        np.abs(problem.by_u).max(axis=(0, 1)), np.abs(problem.equal).max(axis=0, initial=0)
    )
    responses = problem.by_u / size
    stack = scipy.sparse.csr_array(np.vstack([np.einsum('i,tik->tk', v, responses) for v in seen]))
    eye = scipy.sparse.eye_array(total, format='csr')
    nothing = scipy.sparse.csr_array((total, 2))
    sums = np.zeros((len(seen), unknowns + 2 + total))
    for index in range(len(seen)):
        sums[index, unknowns + (index >= len(rows))] = -1.0
        start = unknowns + 2 + nodes * index
        sums[index, start : start + nodes] = problem.weights
    equal, wanted = _independent(problem.equal / size, problem.wanted)
    cost = np.zeros(unknowns + 2 + total)
    cost[unknowns : unknowns + 2] = 1.0
    for method in ('highs', 'highs-ipm'):
        result = scipy.optimize.linprog(
            cost,
            A_ub=scipy.sparse.vstack(
                [
                    scipy.sparse.hstack([stack, nothing, -eye]),
                    scipy.sparse.hstack([-stack, nothing, -eye]),
                    scipy.sparse.csr_array(sums),
                ]
            ).tocsr(),
            b_ub=np.zeros(2 * total + len(seen)),
            A_eq=np.hstack([equal, np.zeros((len(equal), 2 + total))]),
            b_eq=wanted,
            bounds=[(None, None)] * unknowns + [(0, None)] * (2 + total),
            method=method,
        )
        if result.x is not None:
            break
    assert result.x is not None, result.message
    return float(result.fun), result.x[:unknowns] / size


def _independent(rows: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Equations without those that follow from others, but for the error of the quadrature."""
    heights = np.abs(rows).max(axis=1, initial=0, keepdims=True) + 1e-300
    left, values, right = np.linalg.svd(rows / heights, full_matrices=False)
    kept = values > 1e-4 * values.max(initial=0)
    turned = left.T @ (wanted / heights[:, 0])
    return right[kept], turned[kept] / values[kept]
