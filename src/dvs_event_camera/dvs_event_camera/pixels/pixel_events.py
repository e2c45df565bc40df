"""What a pixel array emits: events as parallel arrays in one total, stable order."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

# A packed sort key is non-negative: time above pixel above a bit of polarity and one of sign.
KEY_BITS = 63


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelEvents:
    """Events of one interval, sorted by (time, pixel), that is by (t, y, x).

    Events of one pixel with the same stamp come OFF first, then ON.

    Parameters
    ----------
    t
        Absolute time, int64 nanoseconds, shape (k,), non-decreasing.
    pixel
        Row-major pixel index, int32, shape (k,).
    polarity
        +1 (ON) or -1 (OFF), int8, shape (k,).
    sign
        Sign of the pixel's reference, +1 or -1, int8, shape (k,); -1 only with `signed_log`.
    noise
        1 where light is not the cause of the event, 0 where it is, int8, shape (k,); None where
        nothing is labelled.
    """

    t: NDArray[np.int64]
    pixel: NDArray[np.int32]
    polarity: NDArray[np.int8]
    sign: NDArray[np.int8]
    noise: NDArray[np.int8] | None = None

    def __len__(self) -> int:
        return int(self.t.size)

    @classmethod
    @functools.cache
    def empty(cls) -> PixelEvents:
        """No events."""
        return cls(
            t=np.empty(0, np.int64),
            pixel=np.empty(0, np.int32),
            polarity=np.empty(0, np.int8),
            sign=np.empty(0, np.int8),
        )

    def take(self, which: slice | NDArray[np.int64]) -> PixelEvents:
        """Some of the events, in the order given.

        Parameters
        ----------
        which
            Slice or indices.
        """
        return PixelEvents(
            t=self.t[which],
            pixel=self.pixel[which],
            polarity=self.polarity[which],
            sign=self.sign[which],
            noise=None if self.noise is None else self.noise[which],
        )

    def unlabelled(self) -> PixelEvents:
        """The same events without labels."""
        return replace(self, noise=None)

    def delayed(self, delay_ns: NDArray[np.int64]) -> PixelEvents:
        """Events later by `delay_ns`, out of order.

        Parameters
        ----------
        delay_ns
            Delay of each event, ns, shape (k,).
        """
        return replace(self, t=self.t + delay_ns)

    def in_order(self, kernels: Any = None) -> PixelEvents:
        """The same events in the order of (t, pixel, polarity).

        Parameters
        ----------
        kernels
            Module `pixel_kernels`, or None.
        """
        if not len(self):
            return self
        base = int(self.t.min())
        shift = max(1, int(self.pixel.max()).bit_length()) + 3
        bits = (int(self.t.max()) - base).bit_length() + shift
        if bits > KEY_BITS:
            return self.take(np.lexsort((self.polarity, self.pixel, self.t)))
        # As in `sorted_from`: integers that hold whole events sort several times as fast.
        keys = self.t - base << shift
        keys |= self.pixel.astype(np.int64) << 3
        keys |= (self.polarity > 0).astype(np.int64) << 2
        keys |= (self.sign < 0).astype(np.int64) << 1
        if self.noise is not None:
            keys |= self.noise
        if kernels is None:
            keys.sort()
        else:
            kernels.radix_sort(keys, np.empty_like(keys), 0, bits)
        low = keys & ((1 << shift) - 1)
        return PixelEvents(
            t=(keys >> shift) + base,
            pixel=(low >> 3).astype(np.int32),
            polarity=((low >> 1 & 2) - 1).astype(np.int8),
            sign=(1 - (low & 2)).astype(np.int8),
            noise=None if self.noise is None else (low & 1).astype(np.int8),
        )

    def labelled(self, noise: NDArray[np.int8]) -> PixelEvents:
        """The same events with other labels.

        Parameters
        ----------
        noise
            1 for noise, 0 for signal, shape (k,).
        """
        return replace(self, noise=noise)

    @staticmethod
    def merged(one: PixelEvents, other: PixelEvents, kernels: Any = None) -> PixelEvents:
        """Events of both in order; labelled if the non-empty ones are.

        Parameters
        ----------
        one, other
            Events in any order.
        kernels
            Module `pixel_kernels`, or None.
        """
        if not len(one) or not len(other):
            return (one if len(one) else other).in_order(kernels)
        labels = [part.noise for part in (one, other) if part.noise is not None]
        both = PixelEvents(
            t=np.concatenate([one.t, other.t]),
            pixel=np.concatenate([one.pixel, other.pixel]),
            polarity=np.concatenate([one.polarity, other.polarity]),
            sign=np.concatenate([one.sign, other.sign]),
            noise=np.concatenate(labels) if len(labels) == 2 else None,
        )
        return both.in_order(kernels)

    @classmethod
    def sorted_from(
        cls,
        start_ns: int,
        elapsed: NDArray[np.int64],
        pixel: NDArray[np.int64],
        polarity: NDArray[np.int8],
        sign: NDArray[np.int8],
    ) -> PixelEvents:
        """Put events in order.

        Parameters
        ----------
        start_ns
            Time from which `elapsed` counts, ns.
        elapsed
            Time since `start_ns`, ns, >= 0, shape (k,).
        pixel
            Pixel index, shape (k,).
        polarity
            +1 or -1, shape (k,).
        sign
            +1 or -1, shape (k,).
        """
        if not elapsed.size:
            return cls.empty()
        pixel_bits = max(1, int(pixel.max()).bit_length())
        if int(elapsed.max()).bit_length() + pixel_bits + 2 > KEY_BITS:
            order = np.lexsort((polarity, pixel, elapsed))
            return cls(
                t=elapsed[order] + start_ns,
                pixel=pixel[order].astype(np.int32),
                polarity=polarity[order].astype(np.int8),
                sign=sign[order].astype(np.int8),
            )
        # One integer holds the whole event, so a plain sort (several times as fast as argsort)
        # orders it, and events that compare equal are equal: the order is total.
        keys = pack_keys(elapsed, pixel, polarity, sign, pixel_bits)
        keys.sort()
        return cls.from_keys(keys, start_ns, pixel_bits)

    @classmethod
    def from_keys(cls, keys: NDArray[np.int64], start_ns: int, pixel_bits: int) -> PixelEvents:
        """Unpack sorted keys made by `pack_keys`.

        Parameters
        ----------
        keys
            Sorted keys, shape (k,).
        start_ns
            Time from which the keys' times count, ns.
        pixel_bits
            Width of the pixel field.
        """
        return cls(
            t=(keys >> (pixel_bits + 2)) + start_ns,
            pixel=((keys >> 2) & ((1 << pixel_bits) - 1)).astype(np.int32),
            polarity=((keys & 2) - 1).astype(np.int8),
            sign=(1 - ((keys & 1) << 1)).astype(np.int8),
        )


def pack_keys(
    elapsed: NDArray[np.int64],
    pixel: NDArray[np.int64],
    polarity: NDArray[np.int8],
    sign: NDArray[np.int8],
    pixel_bits: int,
) -> NDArray[np.int64]:
    """Events as integers whose order is (time, pixel, polarity).

    Parameters
    ----------
    elapsed
        Time since the start of the interval, ns, >= 0, shape (k,).
    pixel
        Pixel index below ``2**pixel_bits``, shape (k,).
    polarity
        +1 or -1, shape (k,).
    sign
        +1 or -1, shape (k,).
    pixel_bits
        Width of the pixel field.
    """
    return (
        (elapsed.astype(np.int64) << (pixel_bits + 2))
        | (pixel.astype(np.int64) << 2)
        | (polarity > 0).astype(np.int64) << 1
        | (sign < 0).astype(np.int64)
    )
