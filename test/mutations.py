"""Seeded mutations of messages and files: what a bad writer, disk or network may make of them."""

import random
import struct

NUMBERS = (0, 1, 2**16, 2**31 - 1, 2**31, 2**32 - 1)
DOUBLES = (float('nan'), float('inf'), float('-inf'), 1e308, -1e308, 5e-324, -0.0, 0.0)
STAMPS = ((0, 0), (-(2**31), 0), (2**31 - 1, 999_999_999), (0, 2**32 - 1), (2**31 - 1, 2**32 - 1))


class Mutations:
    """Draws mutated copies of bytes.

    Parameters
    ----------
    seed
        Seed of the generator.
    others
        Messages of other kinds, which may come in the place of the right one.
    """

    def __init__(self, seed, others=()):
        self._random = random.Random(seed)
        self._others = others
        self._ways = [
            self._flip,
            self._cut,
            self._extend,
            self._number,
            self._double,
            self._stamp,
            self._noise,
            *([self._other] if others else []),
        ]

    def of(self, message):
        """A copy of `message` with one to three mutations."""
        mutated = bytearray(message)
        for _ in range(self._random.randint(1, 3)):
            mutated = self._random.choice(self._ways)(mutated)
        return bytes(mutated)

    def _place(self, message, size):
        return self._random.randrange(max(1, (len(message) - size) // 4 + 1)) * 4

    def _flip(self, message):
        for _ in range(self._random.randint(1, 8) if message else 0):
            message[self._random.randrange(len(message))] ^= 1 << self._random.randrange(8)
        return message

    def _cut(self, message):
        return message[: self._random.randrange(len(message) + 1)]

    def _extend(self, message):
        return message + self._random.randbytes(self._random.randint(1, 200))

    def _number(self, message):
        place = self._place(message, 4)
        message[place : place + 4] = struct.pack('<I', self._random.choice(NUMBERS))
        return message

    def _double(self, message):
        place = self._place(message, 8)
        message[place : place + 8] = struct.pack('<d', self._random.choice(DOUBLES))
        return message

    def _stamp(self, message):
        message[4:12] = struct.pack('<iI', *self._random.choice(STAMPS))
        return message

    def _noise(self, message):
        start = self._random.randrange(len(message) + 1)
        return message[:start] + self._random.randbytes(self._random.randint(0, 100))

    def _other(self, _):
        return bytearray(self._random.choice(self._others))
