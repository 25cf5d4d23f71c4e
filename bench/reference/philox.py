"""Philox4x32-10 on arrays of NumPy integers, written from the paper; independent of model/formulas/random.py.

J. K. Salmon, M. A. Moraes, R. O. Dror, D. E. Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC 2011, section 3.3.
Tested with the known-answer vectors that its authors publish with Random123 (tests/physics/test_reference.py).
"""

from __future__ import annotations

import numpy as np

ROUNDS = 10
MULTIPLIERS = (0xD2511F53, 0xCD9E8D57)
KEY_STEPS = (0x9E3779B9, 0xBB67AE85)  # golden ratio and sqrt(3) - 1, times 2^32
WORD = np.uint64(0xFFFFFFFF)
SHIFT = np.uint64(32)


def philox4x32(counter: np.ndarray, key: tuple[int, int]) -> np.ndarray:
    """Return random words (..., 4) uint32 for counters (..., 4) of 32-bit words under a key of two 32-bit words."""
    c = [np.asarray(counter)[..., k].astype(np.uint64) for k in range(4)]
    k0, k1 = int(key[0]), int(key[1])
    for _ in range(ROUNDS):
        first, second = np.uint64(MULTIPLIERS[0]) * c[0], np.uint64(MULTIPLIERS[1]) * c[2]  # 32 x 32 bits fit in 64
        c = [
            (second >> SHIFT) ^ c[1] ^ np.uint64(k0),
            second & WORD,
            (first >> SHIFT) ^ c[3] ^ np.uint64(k1),
            first & WORD,
        ]
        k0, k1 = (k0 + KEY_STEPS[0]) & 0xFFFFFFFF, (k1 + KEY_STEPS[1]) & 0xFFFFFFFF
    return np.stack(c, axis=-1).astype(np.uint32)


def random_directions(seed: int, step: int, particles: int, axes: int = 2) -> np.ndarray:
    """Return the external force of magnitude 1 in step number `step`: (particles, axes) float64 in (-1, 1).

    The counter is (step low, step high, particle, 0), the key the seed's two halves, word k is axis k; the upper 23
    bits k of a word give (2 k + 1) 2^-23 - 1.
    """
    counter = np.zeros((particles, 4), dtype=np.uint64)
    counter[:, 0], counter[:, 1] = step & 0xFFFFFFFF, step >> 32
    counter[:, 2] = np.arange(particles)
    words = philox4x32(counter, (seed & 0xFFFFFFFF, seed >> 32))[:, :axes]
    return (2.0 * (words >> np.uint32(9)) + 1.0) * 2.0**-23 - 1.0
