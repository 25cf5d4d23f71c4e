"""Stress and tangent of the materials: tables, differences, rotations, and a tangent that is nowhere negative."""

from __future__ import annotations

import numpy as np
import pytest

from softlab.model.base.variant import plain_formulas
from softlab.model.formulas.constraints.tetrahedron import COROTATED, FIXED, HOOKEAN, MATERIALS
from softlab.model.formulas.elastic import deformation, newton, tangent

pytestmark = pytest.mark.filterwarnings("ignore:overflow")  # of a turn by nothing; machine code says none
T = plain_formulas(tangent, np.float64)
ROTATION = plain_formulas(deformation, np.float64).rotation
MU, LAME = 1e5 / 2.6, 0.3e5 / (1.3 * 0.4)
ALPHA = 1 + MU / (LAME + MU)
BASIS = np.eye(9).reshape(9, 3, 3)


def at(material: int, f: np.ndarray) -> tuple[float, np.ndarray]:
    entries = tuple(f.ravel())
    held, p = T.stress(material, entries, ROTATION(entries), MU, LAME, ALPHA)
    return held, np.array(p).reshape(3, 3)


def tangent_of(material: int, f: np.ndarray, safe: bool) -> np.ndarray:
    """(9, 9) of P's entries by F's."""
    entries = tuple(f.ravel())
    s, u, v = T.frame(entries, ROTATION(entries))
    parts = T.moduli(material, s, MU, LAME, ALPHA, safe)
    return np.column_stack([T.differential(u, v, *parts, tuple(one.ravel())) for one in BASIS])


def states() -> list[np.ndarray]:
    """F: at rest, stretched, sheared, squashed, inverted."""
    random = np.random.default_rng(3)
    found = [np.eye(3), np.diag([1.2, 1.0, 1.0]), np.diag([0.6, 0.9, 1.1]), np.diag([1.1, 0.9, -0.4])]
    return found + [np.eye(3) + size * random.normal(size=(3, 3)) for size in (0.02, 0.3, 0.5, 0.8, 1.0, 1.0)]


@pytest.mark.parametrize(
    ("f", "fixed", "plain"),
    [
        (np.diag([1.2, 1, 1]), (2692.307692, [26923.076923, 13846.153846]), (2692.307692, [26923.076923, 11538.461538])),
        (
            np.diag([1.0, 1, 0]),
            (67307.692308, [0, 0, -134615.384615]),
            (67307.692308, [-57692.307692, -57692.307692, -134615.384615]),
        ),
        (np.diag([1, 1, -0.5]), (151442.307692, [43269.230769]), (151442.307692, [-86538.461538] * 2 + [-201923.076923])),
        (np.array([[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]), (4880.552861, [2296.730758]), (4989.843691, [5741.826895])),
    ],
)  # fmt: skip
def test_energy_and_stress_of_the_table(f: np.ndarray, fixed: tuple, plain: tuple) -> None:
    """E 1e5, nu 0.3, computed from the energies of A. Stomakhin et al. and of M. Mueller, M. Gross."""
    for material, (energy, diagonal) in ((FIXED, fixed), (COROTATED, plain)):
        held, p = at(material, f)
        assert held == pytest.approx(energy, rel=1e-9)
        np.testing.assert_allclose(np.diag(p)[: len(diagonal)], diagonal, atol=1e-6 * MU)


@pytest.mark.parametrize("material", range(3), ids=MATERIALS)
def test_stress_is_the_energys_slope_and_the_tangent_the_stresss(material: int) -> None:
    random, step = np.random.default_rng(0), 1e-6
    for f in states():
        change = random.normal(size=(3, 3))
        (high, above), (low, below) = at(material, f + step * change), at(material, f - step * change)
        _, p = at(material, f)
        assert (high - low) / (2 * step) == pytest.approx((p * change).sum(), rel=1e-7, abs=1e-3)
        slope = tangent_of(material, f, False) @ change.ravel()
        np.testing.assert_allclose(slope, (above - below).ravel() / (2 * step), rtol=1e-6, atol=1e-6 * MU)


@pytest.mark.parametrize("material", range(3), ids=MATERIALS)
def test_blocks_are_the_tangent_seen_by_corners(material: int) -> None:
    random = np.random.default_rng(1)
    f, p, o = states()[6], random.normal(size=3), random.normal(size=3)
    entries = tuple(f.ravel())
    s, u, v = T.frame(entries, ROTATION(entries))
    parts = T.moduli(material, s, MU, LAME, ALPHA, False)
    got = np.array(T.block(u, *parts, T.seen_in(v, *p), T.seen_in(v, *o))).reshape(3, 3)
    whole = tangent_of(material, f, False).reshape(3, 3, 3, 3)
    np.testing.assert_allclose(got, np.einsum("ijkl,j,l->ik", whole, p, o), atol=1e-9 * MU)


@pytest.mark.parametrize("material", range(3), ids=MATERIALS)
def test_the_safe_tangent_is_the_exact_one_without_its_negative_eigenvalues(material: int) -> None:
    for f in states():
        exact, safe = tangent_of(material, f, False), tangent_of(material, f, True)
        np.testing.assert_allclose(exact, exact.T, atol=1e-9 * MU)
        value, vector = np.linalg.eigh((exact + exact.T) / 2)
        np.testing.assert_allclose(safe, (vector * np.maximum(value, 0)) @ vector.T, atol=1e-8 * MU)


@pytest.mark.parametrize("material", range(3), ids=MATERIALS)
def test_a_rotation_makes_no_stress_and_is_taken_along(material: int) -> None:
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    held, p = at(material, turn)
    assert abs(held) < 1e-9 * MU
    np.testing.assert_allclose(p, 0, atol=1e-10 * MU)
    f = states()[5]
    np.testing.assert_allclose(at(material, turn @ f)[1], turn @ at(material, f)[1], atol=1e-9 * MU)


def test_flattened_to_a_point_all_is_finite() -> None:
    for material in (FIXED, COROTATED, HOOKEAN):
        for f in (np.zeros((3, 3)), np.diag([1.0, 0, 0]), np.diag([-1.0, -1, -1])):
            assert (
                np.isfinite(tangent_of(material, f, True)).all() and np.isfinite(tangent_of(material, f, False)).all()
            )


def test_the_inverse_of_a_symmetric_matrix_and_whether_it_is_positive() -> None:
    inverse = plain_formulas(newton, np.float64).inverse
    random = np.random.default_rng(4)
    for _ in range(20):
        a = random.normal(size=(3, 3))
        a = a + a.T + random.uniform(-1, 5) * np.eye(3)
        xx, xy, xz, yy, yz, zz, good = inverse(a[0, 0], a[0, 1], a[0, 2], a[1, 1], a[1, 2], a[2, 2])
        assert good == (np.linalg.eigvalsh(a).min() > 0)
        if good:
            np.testing.assert_allclose(
                [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], np.linalg.inv(a), rtol=1e-9, atol=1e-9
            )
