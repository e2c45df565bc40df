"""Random plants of every kind that a user may have, and a problem for each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from dvs_common.scenario.model import PixelScene, PlantModel
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_hinf_controller.problem import DesignProblem

KINDS = ('generic', 'integrator', 'triple pole', 'lightly damped', 'stiff', 'fixed mode')


@dataclass(frozen=True, slots=True, kw_only=True)
class RandomPlant:
    """A plant, and how it was made."""

    kind: str
    plain: PlantModel
    scaled: PlantModel
    states: np.ndarray
    rate: float
    luminosity: float

    @property
    def problem(self) -> DesignProblem:
        """One pixel of luminosity 1 at the set-point 0, tolerance 0.05 a state, in its units."""
        light = np.array([self.luminosity])
        return DesignProblem(
            model=self.scaled,
            equilibrium=self.scaled.equilibrium(np.zeros(self.scaled.state_count), tolerance=1e-6),
            scene=PixelScene(brightness_offsets=light, height=1, width=1),
            bounds=ReferenceBounds(lower=light, upper=light),
            tolerance=0.05,
            log_base=np.e,
            error_weights=1 / self.states,
        )


def random_plant(seed: int) -> RandomPlant:
    """Plant number `seed`: 1 to 20 states, 1 to 3 inputs, numbers scaled by 1e-6 to 1e6.

    Parameters
    ----------
    seed
        The kinds take turns.
    """
    rng = np.random.default_rng([12, seed])
    kind = KINDS[seed % len(KINDS)]
    n = int(rng.integers(1, 5)) if rng.random() < 0.5 else int(rng.integers(5, 21))
    n = max(n, {'triple pole': 3, 'lightly damped': 2, 'stiff': 2, 'fixed mode': 2}.get(kind, 1))
    m = int(rng.integers(1, 4))
    modes = _modes(rng, kind, n)
    mixing = np.linalg.qr(rng.standard_normal((n, n)))[0] * np.exp(rng.uniform(-0.4, 0.4, n))
    b, c = rng.standard_normal((n, m)), rng.standard_normal(n)
    if kind == 'fixed mode':
        b[0] = 0.0
    if kind == 'stiff':
        mixing = np.eye(n)
    inverse = np.linalg.inv(mixing)
    plain = PlantModel(
        state_matrix=mixing @ modes @ inverse, input_matrix=mixing @ b, output_vector=c @ inverse
    )
    states, inputs = 10 ** rng.uniform(-6, 6, n), 10 ** rng.uniform(-6, 6, m)
    if kind == 'generic' and seed % 12:
        states, inputs = np.ones(n), np.ones(m)
    rate, luminosity = 10 ** rng.uniform(-6, 6), 10 ** rng.uniform(-6, 6)
    scaled = PlantModel(
        state_matrix=plain.state_matrix * states[:, None] / states * rate,
        input_matrix=plain.input_matrix * states[:, None] * inputs * rate,
        output_vector=plain.output_vector / states * luminosity,
    )
    return RandomPlant(
        kind=kind, plain=plain, scaled=scaled, states=states, rate=rate, luminosity=luminosity
    )


def _modes(rng: np.random.Generator, kind: str, n: int) -> np.ndarray:
    first = {
        'generic': lambda: np.array([[rng.uniform(-2, 2)]]),
        'integrator': lambda: np.zeros((1, 1)),
        'triple pole': lambda: rng.choice([0.0, 1.0, -1.0]) * np.eye(3) + np.eye(3, k=1),
        'lightly damped': lambda: _pair(-(10 ** rng.uniform(-4, -1)), rng.uniform(0.5, 3)),
        'stiff': lambda: np.array([[-(10 ** rng.uniform(2, 6))]]),
        'fixed mode': lambda: np.array([[rng.uniform(0.2, 2)]]),
    }[kind]()
    blocks, left = [first], n - len(first)
    while left:
        real = rng.uniform(-2, 1) if left > 8 else rng.uniform(-2, 2)
        block = np.array([[real]])
        if left > 1 and rng.random() < 0.4:
            block = real * np.eye(2) + rng.uniform(0.3, 3) * np.array([[0, 1], [-1, 0]])
        if len(blocks) > 4:
            block = block - (abs(real) + 0.1) * np.eye(len(block))
        blocks.append(block)
        left -= len(block)
    return scipy.linalg.block_diag(*blocks)


def _pair(zeta: float, frequency: float) -> np.ndarray:
    return frequency * (zeta * np.eye(2) + np.array([[0, 1], [-1, 0]]))
