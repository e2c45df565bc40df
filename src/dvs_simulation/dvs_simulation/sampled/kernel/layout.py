"""What the compiled loop works on: plain arrays in named tuples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray

Ints = NDArray[np.int64]
Counts = NDArray[np.int32]
Bools = NDArray[np.bool_]

# Why a run has ended.
DONE, UNUSUAL, DARK = range(3)


class PlantArrays(NamedTuple):
    """Plant, optics, and what acts on them from one command to the next."""

    state: FloatArray  # x, (n,), moves
    transitions: FloatArray  # (D, n, n), one a length of a piece
    gains: FloatArray  # (D, n, m)
    gradient: FloatArray  # c, (n,)
    offsets: FloatArray  # c'dx_i, (r,)
    first_piece: Ints  # (N + 1,): pieces of sample s are first_piece[s] to first_piece[s + 1]
    lengths: Ints  # (P,): which transition
    commands: Ints  # (P,): of which sample the command is, -1 for the feed-forward
    push: FloatArray  # (P, m), added to the command; or no rows
    input_noise: FloatArray  # (P, m), added after it; or no rows
    state_noise: FloatArray  # (P, n), added to the state after the piece; or no rows


class PixelArrays(NamedTuple):
    """Camera: pixels with the log law, ideal or with imperfections that levels show."""

    level: FloatArray  # level at the last sample, (r,), moves
    origin: FloatArray  # (r,)
    counts: Counts  # N of ideal pixels, (r,), moves
    step: float  # h ln b
    floor: float  # smallest luminosity of the logarithm
    numbers: Counts  # 0, 1, ..., r - 1
    ideal: bool
    ladder: bool
    present: FloatArray  # (r,), moves
    on: Counts  # (r,), moves
    off: Counts  # (r,), moves
    on_thresholds: FloatArray  # (r,)
    off_thresholds: FloatArray  # (r,)
    refractory_ns: int
    ready_ns: Ints  # (r,), moves
    leaks: bool
    phase: FloatArray  # (r,)
    rates: FloatArray  # (r,)
    dead: Ints
    frozen: FloatArray  # (len(dead),)
    nanosecond_s: float


class EstimateArrays(NamedTuple):
    """The controller's knowledge of the references."""

    counts: Ints  # (r,), moves
    estimate: FloatArray  # (r,), moves
    first: FloatArray  # estimate at N = 0, (r,), moves
    lower: FloatArray  # (r,), moves
    upper: FloatArray  # (r,), moves
    counted_lower: FloatArray  # without what losses have added, (r,), moves
    counted_upper: FloatArray
    active: Bools  # (r,)
    active_count: int
    target: float  # mean of the set-point luminosities of the active pixels
    step: float
    on: float
    off: float
    on_spacing: float
    off_spacing: float
    leaks: FloatArray  # factor of the lower ends by number of periods, or empty


class ControlArrays(NamedTuple):
    """K, advanced from event to event."""

    state: FloatArray  # (k,), moves
    transitions: FloatArray  # by number of periods less one, (G, k, k)
    gains: FloatArray  # (G, k)
    output: FloatArray  # (m, k)
    feedthrough: FloatArray  # (m,)
    feedforward: FloatArray  # (m,)
    deviation: FloatArray  # (1,), moves
    poles: NDArray[np.complex128]  # (k,)
    real: bool
    modal_input: NDArray[np.complex128]  # (k,)
    vectors: NDArray[np.complex128]  # (k, k)
    turned: bool
    nanosecond_s: float


class Record(NamedTuple):
    """What a run leaves: row s is of sample s."""

    states: FloatArray  # (N + 1, n)
    luminosities: FloatArray  # (N + 1, r)
    commands: FloatArray  # (N + 1, m)
    estimates: FloatArray  # (N + 1, r)
    first_event: Ints  # (N + 2,)
