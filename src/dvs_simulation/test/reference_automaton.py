"""The automaton once more, in forty digits and another way: dense scanning and bisection.

Shares no code and no idea with the package: matrix exponentials of the augmented system, pixels in
luminosity instead of the scalar s, references as running products.
"""

from __future__ import annotations

import mpmath as mp

from dvs_simulation.exact import ClosedLoop

_HALVINGS = 70


class ReferenceAutomaton:
    """Events of a `log` loop, found with mpmath."""

    def __init__(self, loop: ClosedLoop, *, digits: int = 40) -> None:
        mp.mp.dps = digits
        n, k = loop.model.state_count, loop.controller.order
        c = loop.controller
        a, b = (
            mp.matrix(loop.model.state_matrix.tolist()),
            mp.matrix(loop.model.input_matrix.tolist()),
        )
        self.n, self.size = n, n + k
        f = mp.zeros(self.size + 1)
        f[:n, :n] = a
        g = b * mp.matrix(c.feedthrough.tolist())
        for i in range(n):
            f[i, self.size] = g[i]
        if k:
            f[:n, n : self.size] = b * mp.matrix(c.output_matrix.tolist())
            f[n : self.size, n : self.size] = mp.matrix(c.state_matrix.tolist())
            for i in range(k):
                f[n + i, self.size] = c.input_vector[i]
        self.f = f
        self.c = [mp.mpf(float(value)) for value in loop.model.output_vector]
        self.xd = [mp.mpf(float(value)) for value in loop.equilibrium.state]
        self.offset = [mp.mpf(float(value)) for value in loop.scene.brightness_offsets]
        self.q = [mp.mpf(float(value)) for value in loop.reference]
        self.z = [mp.mpf(float(value)) for value in loop.sector().initial_estimate]
        self.ratio = mp.exp(mp.mpf(loop.event_threshold) * mp.log(mp.mpf(loop.log_base)))
        self.state = mp.zeros(self.size + 1, 1)
        for i in range(n):
            self.state[i] = mp.mpf(float(loop.initial_state[i])) - self.xd[i]
        self.target = sum(mp.fdot(self.c, self.xd) + offset for offset in self.offset)
        self.set_drive()
        self.cache: dict[object, mp.matrix] = {}

    def set_drive(self) -> None:
        """Mean of z - D."""
        self.state[self.size] = (mp.fsum(self.z) - self.target) / len(self.z)

    def flow(self, state: mp.matrix, tau: mp.mpf) -> mp.matrix:
        """State after `tau`."""
        if tau not in self.cache:
            self.cache[tau] = mp.expm(self.f * tau, method='taylor')
        return self.cache[tau] * state

    def scalar(self, state: mp.matrix) -> mp.mpf:
        """s = c'x."""
        return mp.fsum(self.c[i] * (state[i] + self.xd[i]) for i in range(self.n))

    def fired(self, state: mp.matrix) -> int:
        """First pixel whose luminosity has left (q / b^h, q b^h), or -1."""
        s = self.scalar(state)
        for i, offset in enumerate(self.offset):
            y = s + offset
            if y >= self.q[i] * self.ratio or y <= self.q[i] / self.ratio:
                return i
        return -1

    def run(self, count: int, step: float, until: float) -> list[tuple[mp.mpf, int, int]]:
        """First `count` events before `until` as (time, pixel, polarity); scans with `step`."""
        events: list[tuple[mp.mpf, int, int]] = []
        time = mp.mpf(0)
        step = mp.mpf(step)
        while len(events) < count and time < until:
            following = self.flow(self.state, step)
            if self.fired(following) < 0:
                self.state, time = following, time + step
                continue
            # Forty digits from halved steps: the exponentials are shared by all events.
            width = step
            for _ in range(_HALVINGS):
                width /= 2
                middle = self.flow(self.state, width)
                if self.fired(middle) < 0:
                    self.state, time = middle, time + width
            self.state, time = self.flow(self.state, width), time + width
            i = self.fired(self.state)
            y = self.scalar(self.state) + self.offset[i]
            polarity = 1 if y > self.q[i] else -1
            self.q[i] *= self.ratio**polarity
            self.z[i] *= self.ratio**polarity
            self.set_drive()
            events.append((time, i, polarity))
        return events
