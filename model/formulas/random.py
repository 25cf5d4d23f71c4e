"""Random numbers that depend only on (seed, step, particle, axis): the same on every backend and thread count.

Philox4x32-10: J. K. Salmon, M. A. Moraes, R. O. Dror, D. E. Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC
2011, section 3.3. The counter is (step low, step high, particle, 0), the key is the seed, word k is axis k. Everything
here is integer arithmetic in 64-bit words that contain 32 bits, which every compiler treats alike.
"""

from __future__ import annotations

import numpy as np

from softlab.model.base.variant import formula, integer_formula, real

LOW = np.uint64(0xFFFFFFFF)
THIRTY_TWO = np.uint64(32)
MULTIPLIER_0 = np.uint64(0xD2511F53)
MULTIPLIER_1 = np.uint64(0xCD9E8D57)
WEYL_0 = np.uint64(0x9E3779B9)
WEYL_1 = np.uint64(0xBB67AE85)
NINE = np.uint64(9)
ONE = np.uint64(1)
ZERO = np.uint64(0)

OPERATIONS = 110  # integer ones, per mass

SCALE = 2.0 ** (-23)


@integer_formula
def philox(seed, step, particle):
    """The four words of Philox4x32-10 at counter (step, particle) under the key `seed`; all arguments uint64."""
    c0 = step & LOW
    c1 = step >> THIRTY_TWO
    c2 = particle & LOW
    c3 = ZERO
    k0 = seed & LOW
    k1 = seed >> THIRTY_TWO
    for _ in range(10):
        product_0 = MULTIPLIER_0 * c0
        product_1 = MULTIPLIER_1 * c2
        c0 = (product_1 >> THIRTY_TWO) ^ c1 ^ k0
        c1 = product_1 & LOW
        c2 = (product_0 >> THIRTY_TWO) ^ c3 ^ k1
        c3 = product_0 & LOW
        k0 = (k0 + WEYL_0) & LOW
        k1 = (k1 + WEYL_1) & LOW
    return c0, c1, c2, c3


@formula
def uniform(word):
    """Return (2 k + 1) 2^-23 - 1 with k the word's upper 23 bits: odd multiples of 2^-23, exact in 24 bits, never
    +-1."""
    odd = real((word >> NINE) + (word >> NINE) + ONE)
    return odd * SCALE - 1.0


@formula
def add_external(acceleration, magnitude, word):
    """Acceleration plus the external force of this axis: magnitude over mass [m/s^2] times a number in (-1, 1)."""
    return acceleration + magnitude * uniform(word)
