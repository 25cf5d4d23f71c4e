"""The judge's materials: tabled energies and stresses, and each derivative against differences of what it derives."""

from __future__ import annotations

import numpy as np
import pytest

from softlab.bench.reference import elastic_materials as materials

YOUNG, POISSON = 1e5, 0.3
MU, LAM = materials.lame(YOUNG, POISSON)
SHEAR = np.eye(3) + 0.5 * np.outer([1, 0, 0], [0, 1, 0])
FIXED, LINEAR = "fixed-corotated", "corotated"
TABLE = [  # F; material; energy density; stresses by row and column
    (np.diag([1.2, 1, 1]), FIXED, 2692.307692, {(0, 0): 26923.076923, (1, 1): 13846.153846, (2, 2): 13846.153846}),
    (np.diag([1.2, 1, 1]), LINEAR, 2692.307692, {(0, 0): 26923.076923, (1, 1): 11538.461538, (2, 2): 11538.461538}),
    (SHEAR, FIXED, 4880.552861, {(0, 0): 2296.730758, (0, 1): 19804.951920, (1, 0): 18656.586541, (2, 2): 0.0}),
    (
        SHEAR,
        LINEAR,
        4989.843691,
        {(0, 0): 5741.826895, (0, 1): 20666.225955, (1, 0): 17795.312507, (2, 2): 3551.123816},
    ),
    (np.diag([1.0, 1, 0]), FIXED, 67307.692308, {(2, 2): -134615.384615}),
    (np.diag([1.0, 1, 0]), LINEAR, 67307.692308, {(0, 0): -57692.307692, (2, 2): -134615.384615}),
    (np.diag([1, 1, -0.5]), FIXED, 151442.307692, {(0, 0): 43269.230769, (2, 2): -201923.076923}),
    (np.diag([1, 1, -0.5]), LINEAR, 151442.307692, {(0, 0): -86538.461538, (2, 2): -201923.076923}),
    (np.zeros((3, 3)), FIXED, 144230.769231, {(i, j): -76923.076923 * (i == j) for i in range(3) for j in range(3)}),
    (np.zeros((3, 3)), LINEAR, 375000.0, {(i, j): -250000.0 * (i == j) for i in range(3) for j in range(3)}),
]
MANY = np.random.default_rng(3).normal(size=(40, 3, 3))  # half of them inside out
each_material = pytest.mark.parametrize("material", materials.MATERIALS)


def apart(gradients: np.ndarray) -> np.ndarray:
    """Those away from where the rotation jumps: the two smallest singular values, the last one signed, add up to 0."""
    s = materials.decompose(gradients)[1]
    return gradients[s[..., 1] + s[..., 2] > 0.2]


def test_lame() -> None:
    assert pytest.approx(38461.538462, abs=1e-6) == MU and pytest.approx(57692.307692, abs=1e-6) == LAM
    for poisson in (0.5, -1.0):
        with pytest.raises(ValueError, match="poisson"):
            materials.lame(1e5, poisson)


@pytest.mark.parametrize(("gradient", "material", "energy", "stresses"), TABLE)
def test_the_table(gradient: np.ndarray, material: str, energy: float, stresses: dict[tuple[int, int], float]) -> None:
    """Closed forms of E 1e5, nu 0.3, to the digits printed (1e-6 Pa): flat and inside-out tetrahedra are among them."""
    assert materials.energy_density(material, gradient, MU, LAM) == pytest.approx(energy, abs=1e-6)
    found = materials.stress(material, gradient, MU, LAM)
    for place, value in stresses.items():
        assert found[place] == pytest.approx(value, abs=1e-6)


@each_material
def test_nothing_at_rest_and_no_turn_matters(material: str) -> None:
    """Psi(I) = 0 without a stress; Psi(Q F) = Psi(F) and P(Q F) = Q P(F) to rounding."""
    np.testing.assert_allclose(materials.energy_density(material, np.eye(3), MU, LAM), 0, atol=1e-9)
    np.testing.assert_allclose(materials.stress(material, np.eye(3), MU, LAM), 0, atol=1e-9)
    turn = materials.rotation(np.random.default_rng(5).normal(size=(3, 3)))
    some = apart(MANY)
    np.testing.assert_allclose(
        materials.energy_density(material, turn @ some, MU, LAM),
        materials.energy_density(material, some, MU, LAM),
        rtol=1e-11,
    )
    one, other = materials.stress(material, turn @ some, MU, LAM), turn @ materials.stress(material, some, MU, LAM)
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-10 * np.abs(one).max())


def slopes(function: object, some: np.ndarray, eps: float = 1e-3) -> np.ndarray:
    """(..., 9) in the last axis: differences of sixth order, whose error is eps^6 and rounding 1e-16 / eps."""
    found = []
    for place in range(9):
        way = np.zeros(9)
        way[place] = eps
        way = way.reshape(3, 3)
        parts = [
            weight * (function(some + k * way) - function(some - k * way))  # type: ignore[operator]
            for k, weight in ((1, 45 / 60), (2, -9 / 60), (3, 1 / 60))
        ]
        found.append(sum(parts) / eps)
    return np.stack(found, axis=-1)


@each_material
def test_the_stress_is_the_energys_derivative(material: str) -> None:
    """To 1e-8, for J > 0 and J < 0."""
    some = apart(MANY)
    assert (np.linalg.det(some) > 0).any() and (np.linalg.det(some) < 0).any()
    expected = slopes(lambda f: materials.energy_density(material, f, MU, LAM), some).reshape(-1, 3, 3)
    found = materials.stress(material, some, MU, LAM)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * np.abs(found).max())


def test_by_complex_step() -> None:
    """The stable neo-Hookean energy is a polynomial of F: its derivative by a step along i has no error of differences."""
    found = materials.stress("neo-hookean", MANY, MU, LAM)
    for place in np.ndindex(3, 3):
        moved = MANY.astype(complex)
        moved[(..., *place)] += 1e-30j
        slope = materials.energy_density("neo-hookean", moved, MU, LAM).imag / 1e-30
        np.testing.assert_allclose(slope, found[(..., *place)], rtol=0, atol=1e-13 * np.abs(found).max())


@each_material
def test_the_tangent_is_the_stresss_derivative(material: str) -> None:
    """To 1e-8, and symmetric: it has a potential."""
    some = apart(MANY)
    expected = slopes(lambda f: materials.stress(material, f, MU, LAM).reshape(-1, 9), some)
    found = materials.tangent(material, some, MU, LAM)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * np.abs(found).max())
    np.testing.assert_allclose(found, found.transpose(0, 2, 1), rtol=0, atol=1e-13 * np.abs(found).max())


@each_material
def test_hookes_law_at_rest(material: str) -> None:
    """What makes E and nu mean what they say: all materials have the tangent of Hooke's law at rest."""
    at_rest = materials.tangent(material, np.eye(3), MU, LAM)
    np.testing.assert_allclose(at_rest, materials.linear_tangent(MU, LAM), rtol=0, atol=1e-9 * YOUNG)


def test_rotations() -> None:
    """|R'R - I| < 1e-12, det +1, tr(R'A) = s1 + s2 + sign(det) s3, and no scale matters; 0 gives I."""
    half_turn = np.diag([-1.0, -1.0, 1.0])
    hard = np.stack([half_turn, -np.diag([3.0, 2, 1]), np.diag([1.0, 1, 0]), np.diag([1.0, 0, 0]), np.zeros((3, 3))])
    every = np.concatenate([MANY, hard])
    for scale in (1.0, 1e-12, 1e12):
        found = materials.rotation(scale * every)
        np.testing.assert_allclose(
            found.transpose(0, 2, 1) @ found, np.broadcast_to(np.eye(3), found.shape), atol=1e-12
        )
        np.testing.assert_allclose(np.linalg.det(found), 1, atol=1e-12)
        s, sign = np.linalg.svd(every)[1], np.sign(np.linalg.det(every))
        np.testing.assert_allclose((found * every).sum(axis=(1, 2)), s[:, 0] + s[:, 1] + sign * s[:, 2], atol=1e-12)
    np.testing.assert_allclose(found[-4], np.diag([-1.0, -1.0, 1.0]), atol=1e-12)
    np.testing.assert_array_equal(found[-1], np.eye(3))
