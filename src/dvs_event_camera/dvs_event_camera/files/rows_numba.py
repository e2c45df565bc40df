"""Compiled formatting of whole numbers: rows of text as fast as a disk takes them."""

from __future__ import annotations

from typing import Any

import numpy as np

from dvs_common.kernel_cache import kernel

# Characters of the longest number, its sign included.
LONGEST = 20


@kernel
def format_rows(values: Any, digits: Any, ends: Any, out: Any) -> int:
    """Write rows of whole numbers; return the number of characters.

    Parameters
    ----------
    values
        int64, shape (rows, columns).
    digits
        Least number of digits of each column, filled up with zeros; int64, shape (columns,).
    ends
        Character after each column; uint8, shape (columns,).
    out
        Out: characters, uint8, at least rows * columns * (`LONGEST` + 1).
    """
    at = 0
    reversed_digits = np.empty(LONGEST, np.uint8)
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            value = values[i, j]
            if value < 0:
                out[at] = 45
                at += 1
                value = -value
            count = 0
            while value > 0 or count < digits[j]:
                reversed_digits[count] = 48 + value % 10
                value //= 10
                count += 1
            for k in range(count - 1, -1, -1):
                out[at] = reversed_digits[k]
                at += 1
            out[at] = ends[j]
            at += 1
    return at
