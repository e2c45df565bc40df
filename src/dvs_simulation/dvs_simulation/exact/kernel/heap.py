"""An indexed binary min-heap of one threshold per pixel."""

from __future__ import annotations

import numpy as np

from dvs_simulation.exact.compilation import jit


@jit
def heap_update(
    keys: np.ndarray, pixels: np.ndarray, places: np.ndarray, i: int, key: float
) -> None:
    """Give pixel `i` a new key and restore the order of the min-heap."""
    size = keys.size
    start = places[i]
    place = start
    child = 2 * place + 1
    while child < size:
        if child + 1 < size and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        moved = pixels[child]
        keys[place] = keys[child]
        pixels[place] = moved
        places[moved] = place
        place = child
        child = 2 * place + 1
    while place <= start and place > 0:
        parent = (place - 1) >> 1
        if keys[parent] <= key:
            break
        moved = pixels[parent]
        keys[place] = keys[parent]
        pixels[place] = moved
        places[moved] = place
        place = parent
    keys[place] = key
    pixels[place] = i
    places[i] = place
