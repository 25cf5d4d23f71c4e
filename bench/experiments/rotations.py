"""Matrices that clusters come to at their worst, and what their nearest rotation must be: NUMERICS' A10 and B20, for laws and
tests. In NumPy float64, by the singular value decomposition; nothing of model/formulas is used."""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np


def quaternions(random: np.random.Generator, count: int) -> np.ndarray:
    """(count, 4) unit quaternions (w, x, y, z), any turn as likely as any other."""
    q = random.normal(size=(count, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def matrices_of(q: np.ndarray) -> np.ndarray:
    """(n, 3, 3) of unit quaternions, in float64: v + 2w (u x v) + 2u x (u x v) of each axis."""
    w, u = q[:, :1, None].astype(float), q[:, 1:].astype(float)
    cross = np.zeros((len(q), 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        cross[:, i, j], cross[:, j, i] = -u[:, k], u[:, k]
    return np.eye(3) + 2 * (w * cross + cross @ cross)


def of_singular_values(random: np.random.Generator, values: np.ndarray) -> np.ndarray:
    """(n, 3, 3) of those, the last one negative for a reflection, turned anyhow on both sides."""
    left, right = (matrices_of(quaternions(random, len(values))) for _ in range(2))
    return left @ (values[:, :, None] * right)


@cache
def sets_of_matrices(count: int) -> dict[str, np.ndarray]:
    """Wherever two eigenvalues of Davenport's matrix come together; about `count` of each (n, 3, 3)."""
    random = np.random.default_rng(3)
    one, zero, few = np.ones((count, 1)), np.zeros((count, 1)), np.ones((max(1, count // 10), 3))
    small, sign = 10.0 ** random.uniform(-9, -1, (count, 3)), random.choice([-1.0, 1.0], (count, 3))
    named = [np.diag(d) for d in product((-3.0, -1.0, 0.0, 1.0, 3.0), repeat=3)]
    named += [np.diag([-3.0, -2.0, -1.0]), np.ones((3, 3)), np.eye(3)[[1, 2, 0]], np.eye(3)[[1, 0, 2]]]
    values = {
        "rigid": few,
        "mirrored": few * [1, 1, -1],
        "nearly mirrored": np.array([1, 1, -1]) + sign * small,
        "flat": np.concatenate([random.uniform(0.1, 1, (count, 2)), zero], axis=1),
        "on a line": few * [1, 0, 0],
        "nearly on a line": np.concatenate([one, (sign * small)[:, 1:]], axis=1),
        "two eigenvalues nearly one": np.concatenate([one, 0.5 * one, small[:, :1] - 0.5], axis=1),
        "of any singular values": 10.0 ** random.uniform(-9, 0, (count, 3)) * sign,
    }
    sets = {name: of_singular_values(random, each) for name, each in values.items()}
    return {"random, half of them mirrored": random.normal(size=(count, 3, 3)), "by name": np.stack(named)} | sets


def best_trace(A: np.ndarray) -> np.ndarray:
    """(n,): s1 + s2 + sign(det A) s3, the largest trace(R'A) of a rotation R."""
    left, s, right = np.linalg.svd(A)
    return s[:, 0] + s[:, 1] + np.linalg.det(left) * np.linalg.det(right) * s[:, 2]


def off_rotation(R: np.ndarray) -> tuple[float, float]:
    """(the largest entry of |R'R - I|, the largest |det R - 1|) of (n, 3, 3)."""
    apart = np.abs(R.swapaxes(1, 2) @ R - np.eye(3)).max(initial=0)
    return float(apart), float(np.abs(np.linalg.det(R) - 1).max(initial=0))
