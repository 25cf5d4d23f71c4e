"""What the solvers do to one spring, constraint, contact or cluster, uncompiled, against the law it stands for, worked out
with vectors. (Grid springs, integrators and random numbers: test_formulas.py; hinges: test_bending.py; colliders:
test_collider_formulas.py; rotations: test_rotation.py; motions: test_motion.py.)"""

from __future__ import annotations

import numpy as np
import pytest

from softlab.model.base.variant import plain_formulas
from softlab.model.formulas import bending, cloth, distance, springs, wind

RANDOM = np.random.default_rng(12)
D = np.array([0.3, -0.4, 1.2])  # 1.3 long
TURN = np.linalg.qr(RANDOM.normal(size=(3, 3)))[0]
TURN *= np.sign(np.linalg.det(TURN))
REAL = np.float64


# ---------------------------------------------------------------------- cloth: springs, wind


def test_a_spring_in_space_pulls_by_hookes_law_and_its_damper_against_the_lengthening() -> None:
    made, w = plain_formulas(springs, REAL), np.array([2.0, -1.0, 0.5])
    n, k, rest, c = D / 1.3, 50.0, 1.0, 3.0
    assert made.spring_acceleration_3d(*D, k, k * rest) == pytest.approx(k * (1.3 - rest) * n)
    assert made.damped_pull_3d(*D, *w, k, k * rest, c) == pytest.approx((k * (1.3 - rest) + c * (w @ n)) * n)
    assert (
        made.spring_acceleration_3d(0.0, 0.0, 0.0, k, k) == (0, 0, 0) == made.damped_pull_3d(0.0, 0.0, 0.0, *w, k, k, c)
    )


@pytest.mark.parametrize("degrees", [0.0, 20.0, 60.0, 90.0, -35.0])
def test_a_plate_in_the_wind_is_dragged_along_and_lifted_across(degrees: float) -> None:
    """Of area A, at the angle a to the stream u: drag 2 A u^2 |sin a| along it, lift 2 A u^2 |sin a| cos a across it, to the
    side that the stream leads the plate's normal to; whichever way the triangle goes round."""
    angle, speed, area, drag, lift = np.radians(degrees), 3.0, 0.35, 0.7, 0.4
    along, normal = np.array([np.cos(angle), np.sin(angle), 0]), np.array([-np.sin(angle), np.cos(angle), 0])
    ab, ac = 0.7 * along, 2 * area / 0.7 * np.array([0.0, 0.0, -1.0]) + 0.2 * along
    stream = np.array([speed, 0.0, 0.0])
    across = np.array([0.0, -np.sign(np.sin(angle)), 0.0])  # where the stream pushes the plate's face
    expected = 2 * area * speed**2 * abs(np.sin(angle)) * (drag * stream / speed + lift * np.cos(angle) * across)
    for edges in ((ab, ac), (ac, ab)):
        made = plain_formulas(wind, REAL).triangle_wind(TURN @ edges[0], TURN @ edges[1], TURN @ stream, drag, lift)
        assert made == pytest.approx(TURN @ expected, abs=1e-12)
    assert np.cross(ab, ac) @ normal != 0


def test_gusts_go_smoothly_from_one_number_to_the_next() -> None:
    made = plain_formulas(wind, REAL)
    first, second = np.uint64(123456789), np.uint64(3987654321)
    a, b = made.gust(first, second, 0.0), made.gust(first, second, 1.0)
    assert a == made.gust(first, np.uint64(0), 0.0) and b == made.gust(np.uint64(0), second, 1.0) and a != b
    for part in (0.25, 0.5, 0.9):
        assert made.gust(first, second, part) == pytest.approx(a + (3 * part**2 - 2 * part**3) * (b - a))
    assert made.gust_interval(2.75, 0.5) == (5, pytest.approx(0.5))
    assert plain_formulas(cloth, REAL).gusty(4.0, 0.25, -0.5) == 4 * (1 - 0.125)


# ---------------------------------------------------------------------- position-based constraints


def test_a_prediction_and_what_it_came_to() -> None:
    made, h = plain_formulas(distance, REAL), 0.01
    keep = made.damping_factor(h * 0.3, 5.0)  # c = 0.3 N s/m, 0.2 kg
    assert keep == pytest.approx(1 - h * 0.3 / 0.2)
    velocity = made.kicked(2.0, keep, h, -9.81)
    assert velocity == pytest.approx(2 * keep - 0.0981)
    assert made.predicted(1.5, h, velocity) == pytest.approx(1.5 + h * velocity)
    assert made.rate(1.7, 1.5, 1 / h) == pytest.approx(20)


def test_an_inextensible_constraint_gets_its_length_and_moves_its_ends_by_their_weights() -> None:
    made, w, rest = plain_formulas(distance, REAL), (2.0, 3.0), 1.0
    _, scale = made.rigid_change(D @ D, rest, made.reciprocal(sum(w), 1.0, 0.0))
    first = [made.moved(0.0, w[0], -scale, d) for d in D]
    second = [made.moved(d, w[1], scale, d) for d in D]
    assert np.linalg.norm(np.subtract(second, first)) == pytest.approx(rest)
    assert np.array(first) / w[0] + np.subtract(second, D) / w[1] == pytest.approx(np.zeros(3), abs=1e-15)
    assert made.rigid_change(0.0, rest, 1.0) == (0, 0) and made.reciprocal(0.0, 1.0, 0.0) == 0


@pytest.mark.parametrize("damping", [None, 0.0, 0.4])
def test_a_compliant_constraint_solves_its_equation(damping: float | None) -> None:
    """XPBD, eq. 18 and 26, with C - C_before in place of grad C . (x - x_before): (1 + gamma) w dlambda + a dlambda = -C - a
    lambda - gamma (C - C_before)."""
    made, w, rest, compliance, multiplier = plain_formulas(distance, REAL), 5.0, 1.0, 0.7, -0.05
    gamma, passed = damping or 0.0, np.array([0.02, 0.01, -0.03])
    r = made.reciprocal(w, 1 + gamma, compliance)
    if damping is None:
        change, scale = made.soft_change(D @ D, rest, r, compliance, multiplier)
    else:
        products = D @ passed, passed @ passed
        change, scale = made.damped_change(D @ D, rest, r, compliance, multiplier, gamma, *products)
    left = -(1.3 - rest) - compliance * multiplier - gamma * (1.3 - float(np.linalg.norm(D - passed)))
    assert ((1 + gamma) * w + compliance) * change == pytest.approx(left)
    assert scale == pytest.approx(change / 1.3)


def test_jacobi_sums_or_averages_and_a_tether_only_pulls() -> None:
    made = plain_formulas(distance, REAL)
    assert made.gathered(1.0, 2.0, 0.3) == pytest.approx(1.6) and made.weighted_valence(4.0, 2.0) == 8
    assert made.averaged(1.0, 2.0, 0.3, 4.0) == pytest.approx(1.15) and made.averaged(1.0, 2.0, 0.3, 0.0) == 1
    factor = made.tether(4.0, 0.5)
    assert made.tethered(9.0, 1.0, 2.0, factor) == pytest.approx(1.5)  # 2 m from its anchor at 1, where 0.5 m are left
    assert made.tethered(9.0, 1.0, 2.0, made.tether(4.0, 3.0)) == 9


def hinge() -> tuple[np.ndarray, np.ndarray]:
    """Corners of a bent hinge, and the isometric vector's coefficients by its definition: k = sum K x, sum K = 0."""
    corners = np.array([[0.0, 0, 0], [0.3, 0, 0], [0.1, 0.2, 0.05], [0.2, -0.22, 0.07]])
    return corners @ TURN.T, np.array([-0.9, -0.5, 0.8, 0.6])


def test_one_projection_of_an_isometric_hinge_is_exact() -> None:
    """It is linear: without compliance nothing is left of k but its length at rest, along where it pointed."""
    made, (x, k), w = plain_formulas(bending, REAL), hinge(), np.array([1.0, 2.0, 0.5, 3.0])
    way = np.array([made.curvature(*k[1:], *(x[1:, axis] - x[0, axis])) for axis in range(3)])
    assert way == pytest.approx(k @ x)
    reciprocal = 1 / made.square_sum(*w, *k)
    assert reciprocal == pytest.approx(1 / (w @ k**2))
    for rest in (0.0, 0.02):
        part = made.shortening(*way, rest)
        change = np.array([made.isometric_change(part, way[axis], reciprocal, 0.0, 9.0) for axis in range(3)])
        after = np.array([[made.shifted(x[c, a], w[c], k[c], change[a]) for a in range(3)] for c in range(4)])
        assert k @ after == pytest.approx(rest * way / np.linalg.norm(way), abs=1e-14)
    assert made.shortening(0.0, 0.0, 0.0, 0.02) == 1
    assert made.shortening(0.0, 0.0, 1e-160, 0.02) == 1  # whose square is no normal number, and has no approximate root
    soft = made.isometric_change(1.0, 0.4, 1 / (5 + 0.7), 0.7, -0.05)
    assert (5 + 0.7) * soft == pytest.approx(-0.4 + 0.7 * 0.05)
    assert made.softness(0.2, 0.3) == pytest.approx(0.06)


def test_a_dihedral_hinge_is_projected_along_the_gradient_of_its_constraint() -> None:
    """C = |e| (4 tan(theta/4) - at rest). Its slope by theta, by differences; one Newton step takes C to second order."""
    made, edge, rest = plain_formulas(bending, REAL), 0.3, 0.1
    for theta in (-2.5, 0.3, 3.0):
        up, down = (4 * edge * np.tan((theta + step) / 4) for step in (1e-6, -1e-6))
        assert made.steepness(edge, np.tan(theta / 4)) == pytest.approx((up - down) / 2e-6, rel=1e-8)
    (x, _), w = hinge(), np.array([1.0, 2.0, 0.5, 3.0])

    def angle(at: np.ndarray) -> tuple[float, np.ndarray]:
        a, b, c, d = at
        t, *numbers = made.hinge(*(b - a), *(c - a), *(d - a))
        of_c, of_d, along = np.array(numbers[:3]), np.array(numbers[3:6]), numbers[6:]
        ends = np.array([made.by_ends(*along, one, other) for one, other in zip(of_c, of_d, strict=True)])
        return t, np.stack([*ends.T, of_c, of_d])

    for small in (1e-2, 1e-3):
        t, gradient = angle(x)
        target = t - small
        steep = made.steepness(edge, t)
        reciprocal = 1 / made.gradient_sum(steep, *w, *(gradient**2).sum(axis=1))
        change, times_slope = made.dihedral_change(edge, t, target, steep, reciprocal, 0.0, 9.0)
        assert times_slope == pytest.approx(change * steep)
        after = x + w[:, None] * gradient * times_slope
        assert angle(after)[0] == pytest.approx(target, abs=30 * small**2)
        soft, _ = made.dihedral_change(edge, t, rest, steep, 1 / 7.0, 0.5, -0.2)
        assert 7 * soft == pytest.approx(-4 * edge * (t - rest) + 0.5 * 0.2)
