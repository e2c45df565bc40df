"""The arrays that the inner loop works on, and the names of their rows.

Few and plain arrays, because numba counts references: a function that takes many arrays in a tuple
spends more time on that than on the arithmetic.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dvs_common.arrays import FloatArray

IntArray = np.ndarray

# Rows of `modal`, shape (8, N). Coordinates: p real poles, q pairs (2 each), then dense blocks.
# A row about pairs holds its value in the first coordinate of the pair.
POLE = 0  # pole of a real mode, or decay sigma of a pair, 1/s
FREQUENCY = 1  # omega of a pair, rad/s
MODULUS = 2  # |sigma + i omega| of a pair
PAIR_WEIGHT = 3  # norm of the two weights of a pair
WEIGHT = 4  # weight of the coordinate in s
FORCING = 5  # d rate / d e
DRIFT = 6  # constant part of the rate
ERROR_SIZE = 7  # norm of the coordinate's column in x - x_d
MODAL_ROWS = 8

# Columns of `dense_bound`, shape (b, 4): one row a block
LOG_NORM, NORM_0, NORM_1, NORM_2 = range(4)  # log norm of M; |v|, |M'v|, |M'M'v|

# Rows of `state`, shape (6, N)
ETA, RATE, NEW_ETA, NEW_RATE, SPARE_ETA, SPARE_RATE = range(6)

# Columns of `pixel`, shape (r, 4)
REFERENCE, OFFSET, ESTIMATE, WINDOW_START = range(4)  # |q_i(0)|, c'dx_i, lambdabar_i, s

# Columns of `pixel_state`, shape (r, 3)
COUNT, SIGN, WINDOW_COUNT = range(3)  # N_i, sign of the reference, events in the rate window

# Entries of the float array `clock`
TIME, TIME_LOW, SUM, SUM_LOW, STEP, ERROR, PEAK, PEAK_BOUND, INTEGRAL = range(9)
CLOCK_SIZE = 9

# Entries of the integer array `tally`
BUFFERED, EVENTS, SAMPLE, CULPRIT, EVALUATIONS, STEPS = range(6)
TALLY_SIZE = 6

# Results of the inner loop
DONE, FULL, ZENO, DIVERGED = range(4)

# A pixel that fires this many events within WINDOW / event_rate seconds trips the guard.
WINDOW = 100


class Modes(NamedTuple):
    """Modal system ``eta' = blkdiag eta + forcing e + drift``, seen through ``s``."""

    shape: IntArray  # p, q, b, then the b + 1 edges of the dense blocks
    modal: FloatArray  # (8, N)
    dense: FloatArray  # (b, k, k), blocks in the upper left corner
    dense_bound: FloatArray  # (b, 4)
    error_basis: FloatArray  # (n, N): deviation x - x_d from eta


class Heap(NamedTuple):
    """Indexed binary min-heap of one threshold per pixel."""

    key: FloatArray  # (r,)
    pixel: IntArray  # (r,) pixel at each place, int32
    place: IntArray  # (r,) place of each pixel, int32


class Pixels(NamedTuple):
    """Constants and state of the pixels, and the powers ``b^(k h)`` for k = -K..K."""

    pixel: FloatArray  # (r, 4)
    pixel_state: IntArray  # (r, 3), int64
    power: FloatArray  # (2 K + 1,)


class Samples(NamedTuple):
    """Instants at which the state is wanted, and the state there."""

    time: FloatArray  # (k,)
    eta: FloatArray  # (k, N)
    drive: FloatArray  # (k,) e, after the events of the instant


class Events(NamedTuple):
    """Buffer of events."""

    time: FloatArray  # (capacity,)
    code: IntArray  # (capacity, 3), int32: pixel, polarity, sign


class Constants(NamedTuple):
    """Numbers that do not change during a run."""

    offset: float  # c'x_d
    growth: float  # largest growth rate of a mode, 0 if none
    log_step: float  # h ln b
    dead_band: float
    end: float  # s
    tail_start: float  # s; the error is watched from here on
    tail_step: float  # longest step while it is watched, s
    event_rate: float  # events per second and pixel
    divergence: float  # largest |s - c'x_d|
