"""Sums, small matrices and functions of the host, against NumPy and Python's own: right to rounding."""

from __future__ import annotations

import math

import numpy as np
import pytest

from softlab.model.geometry.arithmetic import functions, ordered

EPS = float(np.finfo(float).eps)
RANDOM = np.random.default_rng(3)


def test_products_are_those_of_matrices() -> None:
    """Three products and two sums: an error of at most 3 eps of the sum of sizes."""
    a, b, v = RANDOM.normal(size=(50, 3, 3)), RANDOM.normal(size=(50, 3, 3)), RANDOM.normal(size=(50, 3))
    w = RANDOM.normal(size=(50, 4))
    for found, right, size in (
        (ordered.product(a, b), a @ b, np.abs(a) @ np.abs(b)),
        (ordered.applied(a, v), (a @ v[..., None])[..., 0], (np.abs(a) @ np.abs(v)[..., None])[..., 0]),
        (ordered.dot(v, v), (v * v).sum(axis=1), (v * v).sum(axis=1)),
        (ordered.combined(w, RANDOM_POINTS), (w[..., None] * RANDOM_POINTS).sum(axis=1), np.full((50, 3), 50.0)),
    ):
        assert found.shape == right.shape and (np.abs(found - right) <= 6 * EPS * size).all()
    assert np.allclose(ordered.norm(v), np.linalg.norm(v, axis=1), rtol=4 * EPS)
    assert ordered.dot([1.0, 2.0], [3.0, 4.0]) == 11.0


RANDOM_POINTS = RANDOM.normal(size=(50, 4, 3))


@pytest.mark.parametrize("size", [2, 3])
def test_inverses_and_determinants(size: int) -> None:
    """Cofactors lose at most some eps times the condition, under 1e3 here."""
    m = RANDOM.normal(size=(200, size, size))
    m = m[np.linalg.cond(m) < 1e3]
    assert np.allclose(ordered.determinant(m), np.linalg.det(m), rtol=1e-11)
    assert np.allclose(ordered.product(ordered.inverse(m), m), np.eye(size), atol=1e-9)
    assert (ordered.inverse(np.diag([2.0, 4.0, 8.0])[:size, :size]) == np.diag([0.5, 0.25, 0.125])[:size, :size]).all()


@pytest.mark.parametrize("size", [2, 3])
def test_eigenvalues_of_symmetric_matrices(size: int) -> None:
    """To 16 eps of the largest; of a line and of a point, too."""
    points = RANDOM.normal(size=(100, 5, size)) * 10.0 ** RANDOM.integers(-3, 4, size=(100, 1, size))
    m = np.swapaxes(points, 1, 2) @ points
    right = np.linalg.eigvalsh(m)
    assert (np.abs(ordered.eigenvalues(m) - right) <= 16 * EPS * right[:, -1:]).all()
    line = np.outer([1.0, 2.0, 3.0][:size], [1.0, 2.0, 3.0][:size])
    assert np.allclose(ordered.eigenvalues(line)[:-1], 0, atol=16 * EPS * line.trace())
    assert (ordered.eigenvalues(np.zeros((2, size, size))) == 0).all()


def test_sums_are_exact_in_any_order() -> None:
    values = RANDOM.normal(size=1000) * 10.0 ** RANDOM.integers(-8, 9, size=1000)
    shuffled = RANDOM.permutation(values)
    assert ordered.total(values) == ordered.total(shuffled) == math.fsum(values)
    both = np.stack([values, shuffled], axis=1)
    assert (ordered.total(both) == math.fsum(values)).all() and ordered.mean(both).shape == (2,)
    assert ordered.total(np.array([1e16, 1.0, -1e16])) == 1.0


def test_sine_and_cosine_are_right_to_an_ulp() -> None:
    """Against Python's, which are right to 0.55 ulp: together under 1.6 ulp; most are the same."""
    x = np.concatenate(
        [RANDOM.uniform(-20, 20, 20000), RANDOM.uniform(-1e5, 1e5, 20000), np.pi / 2 * np.arange(-40, 41)]
    )
    for own, right in ((functions.sine, math.sin), (functions.cosine, math.cos)):
        found, exact = own(x), np.array([right(one) for one in x.tolist()])
        assert (np.abs(found - exact) <= 1.6 * np.spacing(np.abs(exact))).all()
        assert (found == exact).mean() > 0.8
    assert functions.sine(0.0) == 0.0 and functions.cosine(0.0) == 1.0 and isinstance(functions.sine(1.0), float)
    assert functions.sine_and_cosine(np.radians(90.0))[0] == 1.0


def test_exponentials_logarithms_and_powers_are_rounded_once() -> None:
    x = np.concatenate([RANDOM.uniform(-30, 30, 300), 10.0 ** RANDOM.uniform(-300, 2, 100), [0.0, -0.0, 1e-320]])
    assert np.allclose(functions.expm1(x), np.expm1(x), rtol=4 * EPS, atol=0)
    positive = np.abs(x) * 10.0 ** RANDOM.integers(-5, 200, size=len(x))
    assert np.allclose(functions.log1p(positive), np.log1p(positive), rtol=4 * EPS, atol=0)
    part = RANDOM.uniform(0, 1, 100)
    assert np.allclose(functions.power(part, 2.6), part**2.6, rtol=4 * EPS)
    assert functions.expm1(-np.inf) == -1.0 and functions.expm1(np.inf) == np.inf and functions.log1p(np.inf) == np.inf
    assert functions.expm1(1000.0) == np.inf and functions.power(0.0, 2.6) == 0.0
    assert np.isnan(functions.expm1(np.nan)) and functions.expm1(np.zeros((2, 3))).shape == (2, 3)
