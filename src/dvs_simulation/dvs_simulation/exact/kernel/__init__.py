"""Inner loop of the exact simulation, from event to event. Compiled by numba, or interpreted.

Between events the input e is constant, and with ``rate = d eta / dt`` every block obeys
``eta(t + tau) = eta(t) + (integral_0^tau exp(M s) ds) rate``, which needs no division by a pole.

No crossing is missed: a step is accepted only with a proof that no threshold is reached inside. A
threshold counts as reached within ``4 eps`` of the size of s, so that a tangency that is within
rounding of touching is an event.

These modules import each other relatively, because `compilation` loads the folder a second time,
under another name, without numba.
"""
