"""Energy, stress and stiffness of the materials of tetrahedra, as vertex block descent takes them."""

from __future__ import annotations

import numpy as np
import pytest
from vbd_scenes import stress_of

from softlab.model.base.variant import plain_formulas
from softlab.model.formulas.constraints.tetrahedron import MATERIALS
from softlab.model.formulas.elastic import descent, energy, tangent

YOUNG, POISSON = 1e5, 0.3
MU, LAME = YOUNG / (2 * (1 + POISSON)), YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
CONSTANTS = {  # k_D, k_H, rest
    "fixed-corotated": (2 * MU, LAME, 1.0),
    "corotated": (2 * MU, LAME, 1.0),
    "neo-hookean": (MU, LAME + MU, 1 + MU / (LAME + MU)),
}
SHEAR = np.array([[1, 0.5, 0], [0, 1, 0], [0, 0, 1.0]])
TABLE = [  # NUMERICS of the lab, 1e5 Pa, 0.3: F; fixed corotated W, and P's diagonal; corotated the same
    (
        np.diag([1.2, 1, 1]),
        2692.307692, (26923.076923, 13846.153846, 13846.153846), 2692.307692, (26923.076923, 11538.461538),
    ),
    (SHEAR, 4880.552861, (2296.730758,), 4989.843691, (5741.826895,)),
    (np.diag([1.0, 1, 0]), 67307.692308, (0.0, 0.0, -134615.384615), 67307.692308, (-57692.307692,)),
    (
        np.diag([1, 1, -0.5]),
        151442.307692, (43269.230769, 43269.230769, -201923.076923), 151442.307692, (-86538.461538,),
    ),
    (np.zeros((3, 3)), 144230.769231, (-76923.076923,), 375000.0, (-250000.0,)),
]  # fmt: skip


def of(material: str, real: type = np.float64):
    return plain_formulas(energy, real, {"material": MATERIALS.index(material)})


def stress(material: str, f: np.ndarray) -> np.ndarray:
    return np.array(of(material).stress(tuple(f.ravel()), *CONSTANTS[material])[0]).reshape(3, 3)


def density(material: str, f: np.ndarray) -> float:
    return float(of(material).energy(tuple(f.ravel()), *CONSTANTS[material]))


def deformations() -> list[np.ndarray]:
    """Both signs of the determinant, none nearly flat."""
    found = [np.random.default_rng(seed).normal(size=(3, 3)) for seed in range(12)]
    return [f for f in found if abs(np.linalg.det(f)) > 0.1] + [np.eye(3), SHEAR, np.diag([1.2, 1, 1])]


@pytest.mark.parametrize("f,fixed,fixed_stress,linear,linear_stress", TABLE)
def test_the_table(
    f: np.ndarray, fixed: float, fixed_stress: tuple[float, ...], linear: float, linear_stress: tuple[float, ...]
) -> None:
    for material, want, diagonal in (("fixed-corotated", fixed, fixed_stress), ("corotated", linear, linear_stress)):
        assert density(material, f) == pytest.approx(want, rel=1e-9)
        assert np.diag(stress(material, f))[: len(diagonal)] == pytest.approx(diagonal, rel=1e-8, abs=1e-6)


@pytest.mark.parametrize("stretch,lateral,pull", [
    (1.1, 0.970643477, 9365.428), (2.0, 0.774596669, 65384.615), (0.7, 1.087967587, -38113.927),
])  # fmt: skip
def test_stable_neo_hookean_under_tension(stretch: float, lateral: float, pull: float) -> None:
    """Free sides carry nothing, at the Young's modulus and Poisson's ratio asked for."""
    p = stress("neo-hookean", np.diag([stretch, lateral, lateral]))
    assert p[0, 0] == pytest.approx(pull, rel=1e-7) and abs(p[1, 1]) < 1e-2


@pytest.mark.parametrize("material", MATERIALS)
def test_the_stress_is_the_energys_derivative(material: str) -> None:
    """By central differences of 1e-5, whose error is 1e-10 of third derivatives, and 1e-11 of rounding."""
    step = 1e-5
    for f in deformations():
        slope = np.zeros((3, 3))
        for place in np.ndindex(3, 3):
            away = np.zeros((3, 3))
            away[place] = step
            slope[place] = (density(material, f + away) - density(material, f - away)) / (2 * step)
        scale = max(np.abs(slope).max(), MU)
        np.testing.assert_allclose(stress(material, f), slope, atol=1e-8 * scale)
        np.testing.assert_allclose(stress(material, f), stress_of(material, f, MU, LAME), atol=1e-12 * scale)


@pytest.mark.parametrize("material", MATERIALS)
def test_a_rotation_changes_nothing(material: str) -> None:
    turn = np.linalg.qr(np.random.default_rng(7).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    for f in deformations():
        assert density(material, turn @ f) == pytest.approx(density(material, f), rel=1e-12)
        scale = np.abs(stress(material, f)).max() + MU
        np.testing.assert_allclose(stress(material, turn @ f), turn @ stress(material, f), atol=1e-12 * scale)
    assert np.abs(stress(material, turn)).max() < 1e-10 * MU


def block_and_force(
    material: str, points: np.ndarray, values: np.ndarray, corner: int
) -> tuple[np.ndarray, np.ndarray]:
    formulas = plain_formulas(descent, np.float64, {"material": MATERIALS.index(material)})
    nothing = (0.0,) * descent.STRAINS
    sums = formulas.element(tuple(map(tuple, points)), tuple(values), nothing, corner, 1.0)
    x, y, z, xy, xz, yz = sums[3:]
    return np.array([[x, xy, xz], [xy, y, yz], [xz, yz, z]]), np.array(sums[:3])


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("corner", range(4))
def test_the_block_is_no_less_than_the_curvature(material: str, corner: int) -> None:
    """Of the neo-Hookean material it is the derivative of the force, by differences that are exact of a square but for
    rounding; of the fixed corotated one it is at least that, at any F; of the corotated one at least that where it is not
    stretched much, and that where it is. The four forces of a tetrahedron add up to 0."""
    random = np.random.default_rng(corner)
    rest = np.array([[0.0, 0, 0], [1, 0, 0], [0.2, 1.1, 0], [0.1, 0.3, 0.9]])
    inverse = np.linalg.inv((rest[1:] - rest[0]).T)
    values = np.concatenate([inverse.ravel(), CONSTANTS[material], [0.0]])
    for spread, stretch in ((0.05, 1.0), (0.1, 1.0), (0.1, 1.6), (1.0, 1.0)):
        if material == "corotated" and spread == 1.0:
            continue
        points = stretch * rest + random.normal(0, spread, rest.shape)
        block, force = block_and_force(material, points, values, corner)
        step, curvature = 1e-5, np.zeros((3, 3))
        for axis in range(3):
            both = []
            for sign in (1, -1):
                moved = points.copy()
                moved[corner, axis] += sign * step
                both.append(block_and_force(material, moved, values, corner)[1])
            curvature[axis] = (both[0] - both[1]) / (2 * step)
        scale = np.abs(block).max()
        if material == "neo-hookean" or (material == "corotated" and stretch > 1):
            np.testing.assert_allclose(block, curvature, atol=1e-8 * scale)
        assert np.linalg.eigvalsh(block - (curvature + curvature.T) / 2).min() > -1e-7 * scale
        assert np.linalg.eigvalsh(block).min() > 0
        total = sum(block_and_force(material, points, values, k)[1] for k in range(4))
        np.testing.assert_allclose(total, 0, atol=1e-12 * np.abs(force).max())


@pytest.mark.parametrize("material", MATERIALS)
def test_a_damper_brakes_strains_and_no_rigid_motion(material: str) -> None:
    """A turned and moved tetrahedron is where it was to a damper; a small strain since then is worth time / h of its
    force, but for what is of second order in strains of 1e-4. Its forces have no moment, however large the strain."""
    formulas = plain_formulas(descent, np.float64, {"material": MATERIALS.index(material), "damped": True})
    rest = np.array([[0.0, 0, 0], [1, 0, 0], [0.2, 1.1, 0], [0.1, 0.3, 0.9]])
    inverse = np.linalg.inv((rest[1:] - rest[0]).T)
    values = tuple(np.concatenate([inverse.ravel(), CONSTANTS[material], [0.02]]))
    strained = rest + np.random.default_rng(2).normal(0, 0.05, rest.shape)
    turn = np.linalg.qr(np.random.default_rng(7).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    before = formulas.initial_strain(tuple(map(tuple, strained)), values)
    nothing = formulas.initial_strain(tuple(map(tuple, rest)), values)
    assert np.abs(nothing).max() < 1e-9 * MU
    for corner in range(4):
        there = formulas.element(tuple(map(tuple, strained @ turn.T + 1.0)), values, before, corner, 100.0)[:3]
        undamped = formulas.element(tuple(map(tuple, strained @ turn.T + 1.0)), values, before, corner, 0.0)[:3]
        np.testing.assert_allclose(there, undamped, atol=1e-9 * MU)
        little = tuple(map(tuple, rest + 1e-3 * (strained - rest)))
        new = formulas.element(little, values, nothing, corner, 100.0)[:3]
        still = formulas.element(little, values, nothing, corner, 0.0)[:3]
        np.testing.assert_allclose(np.array(new), 3 * np.array(still), atol=1e-6 * MU)
    forces = [formulas.element(tuple(map(tuple, strained)), values, nothing, k, 1e4)[:3] for k in range(4)]
    assert np.abs(forces).max() > MU
    np.testing.assert_allclose(np.cross(strained, forces).sum(axis=0), 0, atol=1e-12 * np.abs(forces).max())


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_a_visit_solves_its_system(real: type) -> None:
    """Against numpy's solver; blocks as stiff against inertia as 1e6 to 1."""
    formulas, random = plain_formulas(descent, real), np.random.default_rng(5)
    for stiff in (0.0, 1.0, 1e6):
        half = random.normal(size=(3, 3))
        block, force = stiff * half @ half.T, stiff * random.normal(size=3)
        point, inertial = random.normal(size=3), random.normal(size=3)
        sums = [*force, *np.diag(block), block[0, 1], block[0, 2], block[1, 2]]
        given = (tuple(map(real, one)) for one in (point, inertial))
        took = formulas.moved(*given, real(2), real(0.5), tuple(map(real, sums)))
        expected = point - np.linalg.solve(np.eye(3) + block, point - inertial + force)
        np.testing.assert_allclose(took, expected, atol=2e3 * np.finfo(real).eps)


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_axes_of_what_is_nearly_no_strain(real: type) -> None:
    """A = V diag(e) V', V a rotation, to rounding: entries off the diagonal from a tenth down to below all normal numbers,
    over differences of roundings and none. Four sweeps of three turns, each of some ten roundings."""
    axes, eps = plain_formulas(tangent, real).axes, float(np.finfo(real).eps)
    rng = np.random.default_rng(5)
    for size in 10.0 ** np.arange(-45, 0, 4):
        xx, yy, zz = (real(1 + eps * step) for step in rng.integers(-2, 3, 3))
        xy, xz, yz = (real(one) for one in size * rng.normal(size=3))
        e, v = axes(xx, xy, xz, yy, yz, zz)
        v = np.array(v, float).reshape(3, 3)
        whole = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], float)
        np.testing.assert_allclose(v @ v.T, np.eye(3), atol=120 * eps)
        np.testing.assert_allclose(v @ np.diag(np.array(e, float)) @ v.T, whole, atol=120 * eps)
