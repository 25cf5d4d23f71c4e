"""Sums of products and matrices of a few rows, element by element, in an order of their own; exact sums of many numbers."""

from __future__ import annotations

from math import fsum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

SWEEPS = (
    8  # of Jacobi's rotations: a 3 x 3 matrix is diagonal to rounding after four or five (it converges quadratically)
)


def dot(a: ArrayLike, b: ArrayLike) -> Any:
    """Return (...,): the sum over the last, short axis of a b, from the first product to the last."""
    a, b = np.asarray(a), np.asarray(b)
    partial_sum = a[..., 0] * b[..., 0]
    for k in range(1, a.shape[-1]):
        partial_sum = partial_sum + a[..., k] * b[..., k]
    return partial_sum


def norm(vectors: ArrayLike) -> Any:
    """Return (...,): the length of vectors along the last axis: the root of `dot`; overflow and underflow are not
    avoided."""
    return np.sqrt(dot(vectors, vectors))


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return (..., n, m): the products of matrices a (..., n, k) and b (..., k, m), k being small."""
    a, b = np.asarray(a), np.asarray(b)
    partial_sum = a[..., :, 0, None] * b[..., None, 0, :]
    for k in range(1, a.shape[-1]):
        partial_sum = partial_sum + a[..., :, k, None] * b[..., None, k, :]
    return np.asarray(partial_sum)


def applied(matrix: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return (..., n): matrices (..., n, k) times vectors (..., k)."""
    return np.asarray(dot(np.asarray(matrix), np.asarray(vectors)[..., None, :]))


def combined(weights: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return (..., d): the sum over k of weights (..., k) times vectors (..., k, d), k being small."""
    partial_sum = weights[..., 0, None] * vectors[..., 0, :]
    for k in range(1, weights.shape[-1]):
        partial_sum = partial_sum + weights[..., k, None] * vectors[..., k, :]
    return np.asarray(partial_sum)


def total(values: np.ndarray) -> Any:
    """Return the sum over the first axis, exact but for one rounding, so that it has no order (J. R. Shewchuk,
    "Adaptive Precision Floating-Point Arithmetic", Discrete and Computational Geometry 18 (1997)): a float, or (d,) of
    (n, d)."""
    values = np.asarray(values, dtype=np.float64)
    if values.ndim == 1:
        return fsum(values.tolist())
    return np.array([fsum(column.tolist()) for column in values.reshape(len(values), -1).T]).reshape(values.shape[1:])


def mean(values: np.ndarray) -> Any:
    """`total` over the number of values."""
    return total(values) / len(values)


def determinant(matrices: np.ndarray) -> np.ndarray:
    """Return (...,): of matrices (..., 3, 3) or (..., 2, 2), by the first row."""
    m = np.asarray(matrices)
    if m.shape[-1] == 2:
        return np.asarray(m[..., 0, 0] * m[..., 1, 1] - m[..., 0, 1] * m[..., 1, 0])
    return np.asarray(dot(m[..., 0, :], np.cross(m[..., 1, :], m[..., 2, :])))


def inverse(matrices: np.ndarray) -> np.ndarray:
    """Return (..., d, d): of regular matrices (..., d, d), d = 2 or 3, by cofactors over the determinant."""
    m = np.asarray(matrices, dtype=np.float64)
    if m.shape[-1] == 2:
        (a, b), (c, d) = (m[..., 0, 0], m[..., 0, 1]), (m[..., 1, 0], m[..., 1, 1])
        adjugate = np.stack([np.stack([d, -b], axis=-1), np.stack([-c, a], axis=-1)], axis=-2)
    else:
        x, y, z = m[..., 0, :], m[..., 1, :], m[..., 2, :]
        adjugate = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=-1)
    return np.asarray(adjugate / determinant(m)[..., None, None])


def eigenvalues(symmetric: np.ndarray) -> np.ndarray:
    """Return (..., d) float64, ascending: of symmetric matrices (..., d, d), d small, by cyclic Jacobi rotations (G. H.
    Golub, C. F. Van Loan, "Matrix Computations", 4th edition, section 8.5.2), to some ulps of the largest."""
    m = np.array(symmetric, dtype=np.float64)
    size = m.shape[-1]
    for _ in range(SWEEPS):
        for p in range(size):
            for q in range(p + 1, size):
                _rotate(m, p, q)
    return np.sort(np.stack([m[..., k, k] for k in range(size)], axis=-1), axis=-1)


def _rotate(m: np.ndarray, p: int, q: int) -> None:
    """Rotate symmetric matrices `m` (..., d, d) in the plane of axes p and q so that the entry (p, q) becomes 0."""
    off = m[..., p, q].copy()
    turns = off != 0
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        ratio = np.where(turns, (m[..., q, q] - m[..., p, p]) / (2 * np.where(turns, off, 1.0)), 0.0)
        tangent = np.where(ratio >= 0, 1.0, -1.0) / (np.abs(ratio) + np.sqrt(1 + ratio * ratio))
    tangent = np.where(turns, tangent, 0.0)
    cosine = 1 / np.sqrt(1 + tangent * tangent)
    sine = tangent * cosine
    m[..., p, p] = m[..., p, p] - tangent * off
    m[..., q, q] = m[..., q, q] + tangent * off
    m[..., p, q] = m[..., q, p] = 0.0
    for k in range(m.shape[-1]):
        if k not in (p, q):
            one, other = m[..., k, p].copy(), m[..., k, q].copy()
            m[..., k, p] = m[..., p, k] = cosine * one - sine * other
            m[..., k, q] = m[..., q, k] = sine * one + cosine * other
