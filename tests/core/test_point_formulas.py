"""What the solvers do to one spring, constraint, contact or cluster, uncompiled, against the law it stands for, worked out
with vectors. (Grid springs, integrators and random numbers: test_formulas.py; hinges: test_bending.py; colliders:
test_collider_formulas.py; rotations: test_rotation.py; motions: test_motion.py.)"""

from __future__ import annotations

import numpy as np
import pytest

from model.formulas import bending, cloth, contact, distance, particle_contact, springs, wind
from model.formulas.shape_matching import cluster, deformation, lattice, pace, rebound
from model.formulas.shape_matching import grid as shape_matching

RANDOM = np.random.default_rng(12)
D = np.array([0.3, -0.4, 1.2])  # 1.3 long
TURN = np.linalg.qr(RANDOM.normal(size=(3, 3)))[0]
TURN *= np.sign(np.linalg.det(TURN))
REAL = np.float64


def vectors(count: int) -> np.ndarray:
    return RANDOM.normal(size=(count, 3))


# ---------------------------------------------------------------------- cloth: springs, wind


def test_a_spring_in_space_pulls_by_hookes_law_and_its_damper_against_the_lengthening() -> None:
    made, w = springs.make_3d(REAL), np.array([2.0, -1.0, 0.5])
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
        made = wind.make(REAL).triangle_wind(*TURN @ edges[0], *TURN @ edges[1], *TURN @ stream, drag, lift)
        assert made == pytest.approx(TURN @ expected, abs=1e-12)
    assert np.cross(ab, ac) @ normal != 0


def test_gusts_go_smoothly_from_one_number_to_the_next() -> None:
    made = wind.make(REAL)
    first, second = np.uint64(123456789), np.uint64(3987654321)
    a, b = made.gust(first, second, 0.0), made.gust(first, second, 1.0)
    assert a == made.gust(first, np.uint64(0), 0.0) and b == made.gust(np.uint64(0), second, 1.0) and a != b
    for part in (0.25, 0.5, 0.9):
        assert made.gust(first, second, part) == pytest.approx(a + (3 * part**2 - 2 * part**3) * (b - a))
    assert made.gust_interval(2.75, 0.5) == (5, pytest.approx(0.5))
    assert cloth.make(REAL).gusty(4.0, 0.25, -0.5) == 4 * (1 - 0.125)


# ---------------------------------------------------------------------- position-based constraints


def test_a_prediction_and_what_it_came_to() -> None:
    made, h = distance.make(REAL), 0.01
    keep = made.kept(h * 0.3, 5.0)  # c = 0.3 N s/m, 0.2 kg
    assert keep == pytest.approx(1 - h * 0.3 / 0.2)
    velocity = made.kicked(2.0, keep, h, -9.81)
    assert velocity == pytest.approx(2 * keep - 0.0981)
    assert made.predicted(1.5, h, velocity) == pytest.approx(1.5 + h * velocity)
    assert made.rate(1.7, 1.5, 1 / h) == pytest.approx(20)


def test_an_inextensible_constraint_gets_its_length_and_moves_its_ends_by_their_weights() -> None:
    made, w, rest = distance.make(REAL), (2.0, 3.0), 1.0
    _, scale = made.rigid_change(D @ D, rest, made.reciprocal(sum(w), 1.0, 0.0))
    first = [made.moved(0.0, w[0], -scale, d) for d in D]
    second = [made.moved(d, w[1], scale, d) for d in D]
    assert np.linalg.norm(np.subtract(second, first)) == pytest.approx(rest)
    assert np.array(first) / w[0] + np.subtract(second, D) / w[1] == pytest.approx(np.zeros(3), abs=1e-15)
    assert made.rigid_change(0.0, rest, 1.0) == (0, 0) and made.reciprocal(0.0, 1.0, 0.0) == 0


@pytest.mark.parametrize("damping", [None, 0.0, 0.4])
def test_a_compliant_constraint_solves_its_equation(damping: float | None) -> None:
    """XPBD, eq. 18 and 26: (1 + gamma) w dlambda + a dlambda = -C - a lambda - gamma grad C . (x - x_before)."""
    made, w, rest, compliance, multiplier = distance.make(REAL), 5.0, 1.0, 0.7, -0.05
    gamma, passed = damping or 0.0, np.array([0.02, 0.01, -0.03])
    r = made.reciprocal(w, 1 + gamma, compliance)
    if damping is None:
        change, scale = made.soft_change(D @ D, rest, r, compliance, multiplier)
    else:
        change, scale = made.damped_change(D @ D, rest, r, compliance, multiplier, gamma, made.along_3d(*D, *passed))
    left = -(1.3 - rest) - compliance * multiplier - gamma * (D / 1.3 @ passed)
    assert ((1 + gamma) * w + compliance) * change == pytest.approx(left)
    assert scale == pytest.approx(change / 1.3)


def test_jacobi_sums_or_averages_and_a_tether_only_pulls() -> None:
    made = distance.make(REAL)
    assert made.gathered(1.0, 2.0, 0.3) == pytest.approx(1.6) and made.share(4.0, 2.0) == 8
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
    made, (x, k), w = bending.make_isometric(REAL), hinge(), np.array([1.0, 2.0, 0.5, 3.0])
    way = np.array([made.curvature(*k[1:], *(x[1:, axis] - x[0, axis])) for axis in range(3)])
    assert way == pytest.approx(k @ x)
    reciprocal = 1 / made.square_sum(*w, *k)
    assert reciprocal == pytest.approx(1 / (w @ k**2))
    for rest in (0.0, 0.02):
        part = made.kept_part(*way, rest)
        change = np.array([made.isometric_change(part, way[axis], reciprocal, 0.0, 9.0) for axis in range(3)])
        after = np.array([[made.shifted(x[c, a], w[c], k[c], change[a]) for a in range(3)] for c in range(4)])
        assert k @ after == pytest.approx(rest * way / np.linalg.norm(way), abs=1e-14)
    assert made.kept_part(0.0, 0.0, 0.0, 0.02) == 1
    assert made.kept_part(0.0, 0.0, 1e-160, 0.02) == 1  # whose square is no normal number, and has no approximate root
    soft = made.isometric_change(1.0, 0.4, 1 / (5 + 0.7), 0.7, -0.05)
    assert (5 + 0.7) * soft == pytest.approx(-0.4 + 0.7 * 0.05)
    assert made.softness(0.2, 0.3) == pytest.approx(0.06)


def test_a_dihedral_hinge_is_projected_along_the_gradient_of_its_constraint() -> None:
    """C = |e| (4 tan(theta/4) - at rest). Its slope by theta, by differences; one Newton step takes C to second order."""
    made, edge, rest = bending.make_dihedral(REAL), 0.3, 0.1
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


# ---------------------------------------------------------------------- contacts


def test_particles_that_are_too_near_part_to_their_distance_whatever_their_masses() -> None:
    made, w, n = particle_contact.make(REAL), (2.0, 0.5), D / 1.3
    for contacts in ((1.0, 1.0), (3.0, 2.0)):
        share = made.split(w[0], contacts[0], w[1], contacts[1])
        assert share == pytest.approx(1 / (w[0] * contacts[0] + w[1] * contacts[1]))
    length, *normal = made.direction(*D, 1.5, True)
    depth = made.depth(length, 1.5, 1.5, 0.0)
    share = made.split(w[0], 1.0, w[1], 1.0)
    mine = np.array([made.moved(D[a], w[0], made.added(0.0, share, depth, normal[a])) for a in range(3)])
    theirs = np.array([made.moved(0.0, w[1], -made.added(0.0, share, depth, normal[a])) for a in range(3)])
    assert (length, depth) == (pytest.approx(1.3), pytest.approx(0.2)) and normal == pytest.approx(n)
    assert np.linalg.norm(mine - theirs) == pytest.approx(1.5)
    assert made.split(0.0, 4.0, 0.0, 4.0) == 0
    assert made.direction(0.0, 0.0, 0.0, 1.5, True)[1:] == (0, -1, 0) and made.direction(0, 0, 0, 1.5, False)[1:] == (
        0,
        1,
        0,
    )


def test_how_much_of_a_depth_is_taken() -> None:
    made = particle_contact.make(REAL)
    assert (
        made.held(1.5, *D, 0.1) == pytest.approx(1.4) and made.held(1.5, *D, 0.3) == 1.5
    )  # no more than a push beyond
    assert made.depth(1.4, 1.45, 1.5, 0.02) == pytest.approx(0.05)
    assert made.depth(1.47, 1.45, 1.5, 0.02) == 0  # parting fast enough, nothing pulls
    assert made.depth(1.51, 1.5, 1.5, 0.02) == pytest.approx(-0.01)  # adhesion takes all of a gap of 0.01
    assert made.depth(1.7, 1.5, 1.5, 0.02) == -0.02  # and of a wider one what it may
    assert made.within(2.24, 1.5) and not made.within(2.25, 1.5) and not made.within(0.0, 0.0)
    assert made.touching(2.2530, 1.5) and not made.touching(2.2546, 1.5)


def test_friction_of_particles_takes_back_what_its_cone_holds() -> None:
    made, before, n = particle_contact.make(REAL), np.array([0.1, -0.5, 1.0]), D / 1.3
    slip = np.array(made.slip(*D, *before, *n))
    assert slip == pytest.approx((D - before) - ((D - before) @ n) * n)
    size = np.linalg.norm(slip)
    assert made.grip(*slip, 1.01 * size / 0.5, 0.0, 0.5, 0.3) == 1
    assert made.grip(*slip, 0.99 * size / 0.5, 0.0, 0.5, 0.3) == pytest.approx(0.3 * 0.99 / 0.5)
    assert made.grip(*slip, -1.0, 0.1 * size, 0.5, 0.3) == pytest.approx(0.03)  # pressed by adhesion alone
    assert made.added_friction(1.0, 0.5, 0.2, 0.6, 0.25, 0.4) == pytest.approx(1 + 0.5 * (0.2 * 0.6 - 0.25 * 0.4))


def test_who_must_part_faster_who_goes_too_fast_and_who_sleeps() -> None:
    made, n = particle_contact.make(REAL), D / 1.3
    came, now = -2.0 * n + [0.4, 0.3, 0.0], -0.1 * n
    came -= (came @ n + 2.0) * n
    assert made.lacking(*came, *now, *n, 0.6, 1.9) == pytest.approx(0.6 * 2 + 0.1)
    assert made.lacking(*came, *now, *n, 0.6, 2.1) == 0 and made.lacking(*came, *(1.3 * n), *n, 0.6, 0.1) == 0
    assert made.far(*D) == pytest.approx(1.3)
    assert made.shortened(2.0, 1.0, 0.5, 0.2) == pytest.approx(1.4) and made.shortened(2.0, 1.0, 0.5, 0.6) == 2
    assert made.rested(2.0, 1.0, 0.5, 0.6) == 1 and made.rested(2.0, 1.0, 0.5, 0.4) == 2


def test_a_cloths_contact_is_divided_by_gershgorins_bound_and_rubs_by_coulomb() -> None:
    made, b, c = contact.make(REAL), 0.2, 0.5
    assert made.mixed(1.0, 2.0, 4.0, b, c) == pytest.approx(0.3 * 1 + 0.2 * 2 + 0.5 * 4)
    assert made.first_weight(b, c) == pytest.approx(0.3)
    stiffness = made.stiffness(2.0, 3.0, 1.0, 1.5, 0.5, 2.0, 4.0, 0.7, b, c)
    assert stiffness == pytest.approx(2 * 3 + 0.3 * 1.5 + 0.2 * 0.5 * 2 + 0.5 * 4 * 0.7)
    assert made.inverse(stiffness) == pytest.approx(1 / stiffness) and made.inverse(0.0) == 0
    assert made.held_distance(0.02, 0.05, 0.01, 0.003) == pytest.approx(0.013)
    assert made.held_distance(0.02, 0.05, 0.03, 0.003) == 0.02 and made.held_distance(0.02, 0.015, 0.03, 0.003) == 0.015
    assert made.slip(0.0099, 0.02, 0.5, 0.3) == 1 and made.slip(0.0101, 0.02, 0.5, 0.3) == pytest.approx(0.006 / 0.0101)
    assert made.along(0.7, 0.6, 0.5) == pytest.approx(0.4)
    assert made.correction(0.02, 0.6, 0.25) == pytest.approx(0.003)
    assert made.rubbed(0.02, 0.6, 0.5, 0.01, 0.25) == pytest.approx((0.012 - 0.005) / 4)
    assert made.taken(1.0, 0.3, 0.2) == pytest.approx(0.94) and made.shifted(1.0, 2.0, 0.3) == pytest.approx(1.6)
    assert made.away(1.0, 0.4, 0.6, b, c) == pytest.approx(1 - 0.08 - 0.3)
    rest = made.rest_distance(3.0, 1.0, 0.0, 4.0, 1.0, 2.0, b, c, 0.1)
    assert rest == pytest.approx(0.1 * np.hypot(3 - 0.2, 4 - 0.2 - 1.0))


# ---------------------------------------------------------------------- clusters


def test_a_cluster_finds_where_it_was_turned_and_moved_to_whatever_its_lean() -> None:
    """Rest offsets whose mean is not quite 0 (rounding leaves that), turned and moved: goals are where the particles are."""
    made, mass, rest = cluster.make(REAL), RANDOM.uniform(1, 2, 5), vectors(5)
    lean = mass @ rest / mass.sum()
    now = rest @ TURN.T + [3.0, -1.0, 2.0]
    ways = np.array([[made.weighted(m, p[a], now[0, a]) for a in range(3)] for m, p in zip(mass, now, strict=True)])
    moments = np.zeros((3, 3))
    for way, r in zip(ways, rest, strict=True):
        moments = np.array([[made.added(moments[a, b], way[a], r[b]) for b in range(3)] for a in range(3)])
    way = ways.sum(axis=0)
    upright = np.array([[made.upright(moments[a, b], way[a], lean[b]) for b in range(3)] for a in range(3)])
    offset = rest - lean
    assert upright == pytest.approx(TURN @ ((mass[:, None] * offset).T @ offset))
    middle = [made.centre(now[0, a], way[a], 1 / mass.sum(), *TURN[a], *lean) for a in range(3)]
    goals = np.array([[made.goal(middle[a], *TURN[a], *r) for a in range(3)] for r in rest])
    assert goals == pytest.approx(now)
    lanes = RANDOM.normal(size=16)
    assert made.total(*lanes) == pytest.approx(lanes.sum())
    assert made.arrived(1.0, made.added_way(0.1, 0.25, 3.0, 2.0)) == pytest.approx(1.35)


def test_the_motion_of_a_cluster_is_found_from_its_sums_and_slows_to_it() -> None:
    """Particles that move as one: the sums, counted from the first, give centre, velocity and spin back, in any place."""
    made, mass, place = pace.make(REAL), RANDOM.uniform(1, 2, 6), vectors(6)
    spin, drift = np.array([0.3, -0.7, 0.5]), np.array([2.0, 0.5, -1.0])
    centre = mass @ place / mass.sum()
    velocity = drift + np.cross(spin, place - centre)
    d, u = place - place[0], velocity - velocity[0]
    w, m = mass @ d, mass @ u
    turn = (mass[:, None] * np.cross(d, u)).sum(axis=0)
    second = (mass[:, None, None] * d[:, :, None] * d[:, None, :]).sum(axis=0)
    sums = [*w, *m, *turn, second[0, 0], second[1, 1], second[2, 2], second[0, 1], second[0, 2], second[1, 2]]
    found = made.motion(*sums, 1 / mass.sum(), *place[0], *velocity[0])
    assert found == pytest.approx([*centre, *drift, *spin])
    assert made.turned(1.0, 2.0, 3.0, 4.0, 5.0) == 1 + 6 - 20 and made.weighted(2.0, 5.0, 3.0) == 4
    assert made.slowed(0.1, 0.5, 1.0, 2.0, 3.0, 4.0, 0.5, 0.4) == pytest.approx(0.1 + 0.5 * (1 + 6 - 2 - 0.4))


def test_a_bodys_rebound_is_its_rigid_share_no_larger_than_allowed() -> None:
    made = rebound.make(REAL)
    assert made.weighed(1.0, 2.0, *D) == pytest.approx(1 + 2 * 1.69)
    assert made.rigid(1.0, 2.0, 3.0, 4.0, 0.5) == 1 + 6 - 2
    assert made.enlarged(6.0, 3.0, 5.0) == 2 and made.enlarged(6.0, 1.0, 5.0) == 5 and made.enlarged(6.0, 0.0, 5.0) == 0
    assert made.shared(2.0, 3.0) == 2 == made.shared(3.0, 2.0) and made.scaled(3.0, 2.0) == 6
    assert made.joined(1.0, 2.0) == 3 and made.rebounded(1.0, 0.25, 2.0) == 2.75


def test_windows_of_a_lattice_turned_in_its_plane_have_their_goals_where_the_masses_are() -> None:
    """3 x 3 masses around their middle, rows downwards, turned by 40 degrees and moved: the sums give centre and rotation
    back, and each mass's way to its goal is 0."""
    made, rest, share = shape_matching.make(REAL), 0.5, 1.0
    cosine, sine = np.cos(np.radians(40)), np.sin(np.radians(40))
    turn = np.array([[cosine, -sine], [sine, cosine]])
    place = np.array([[[rest * j, -rest * i] @ turn.T + [2.0, 1.0] for j in (-1, 0, 1)] for i in (-1, 0, 1)])
    here = place[1, 1]
    sums = (0.0,) * 6
    for i, row in zip((-1, 0, 1), place, strict=True):
        line = (0.0,) * 4
        for step, (x, y) in zip((-1, 0, 1), row, strict=True):
            line = made.added_member(*line, x, y, *row[1], share, step, 0.0)
        sums = made.added_row(sums, *line, *row[1], *here, 3 * share, share, i)
    found = made.cluster(sums, *here, 1 / 3, 1 / 3)
    assert found == pytest.approx((*here, cosine, sine), abs=1e-14)
    for i, down in zip((0, 1, 2), (-rest, 0.0, rest), strict=True):
        for step in (-1, 0, 1):
            x, y = place[i, step + 1]
            goals = made.added_goal((0.0,) * 6, *found[:2], *here, *found[2:], made.rest_offset(step, 0.0, rest))
            assert made.added_goal_row(0.0, 0.0, goals, x, y, *here, 1.0, down) == pytest.approx((0, 0), abs=1e-14)
    assert made.moved(1.0, 0.5, 0.25, 0.8, 2.0) == pytest.approx(1 + 0.5 * 0.25 * 0.8 * 2)


def test_sums_along_a_lattices_axes_count_from_wherever_they_are_asked_to() -> None:
    made = lattice.make(REAL)
    x, share = np.array([3.0, 3.4, 3.9]), np.array([0.2, 0.5, 0.3])
    parts = [made.part_of(s, p, 3.0) for s, p in zip(share, x, strict=True)]
    assert sum(parts) == pytest.approx(share @ (x - 3.0))
    assert made.part_of_row(2.0, sum(parts), share.sum(), 3.0, 2.5) == pytest.approx(2 * share @ (x - 2.5))
    assert made.shifted(sum(parts), share.sum(), 3.0, 3.4) == pytest.approx(share @ (x - 3.4))
    assert made.added_turn(0.5, 0.2, made.lever(2, 0.75)) == pytest.approx(0.5 + 0.2 * 1.25)
    assert made.entry(*TURN[1], *D) == pytest.approx(TURN[1] @ D)
    assert made.centre(4.0, 0.5, 0.25) == 0.5
    assert made.added_goal(1.0, 0.3, 2, 3.0, 2.5, 0.4, 0.6) == pytest.approx(1 + 0.3 + 2 * 0.5 + 0.4 * 0.6)
    assert made.ended(1.0, 2, 3.0, 2.5, 0.4, 0.6) == pytest.approx(1 + 2 * 0.5 + 0.4 * 0.6)
    assert made.moved(1.0, 3.0, 0.5, 0.5, 0.25, 0.8) == pytest.approx(1 + 3 * 0.05)


def test_strains_sets_and_what_goals_are_made_of() -> None:
    made, f, r = deformation.make(REAL), np.eye(3) + 0.2 * RANDOM.normal(size=(3, 3)), TURN
    upper = ([0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2])
    symmetric = (r.T @ f + f.T @ r) / 2 - np.eye(3)
    assert made.strain(*f.ravel(), *r.ravel()) == pytest.approx(symmetric[upper])
    assert made.determinant(*f.ravel()) == pytest.approx(np.linalg.det(f))
    assert made.cube_root(0.3) == pytest.approx(0.3 ** (1 / 3))
    a, g = RANDOM.normal(size=(3, 3)), RANDOM.normal(size=(3, 3))
    assert made.product(*a.ravel(), *g.ravel()) == pytest.approx((a @ g).ravel())
    assert made.bent(*a.ravel(), *g.ravel()) == pytest.approx((a @ g.T).ravel())
    g = g + g.T
    assert made.gradient(*a.ravel(), *g[upper]) == pytest.approx((a @ g).ravel())
    sp = np.diag([1.25, 0.8, 1.0]) @ TURN
    assert made.undone(*f.ravel(), *sp.ravel()) == pytest.approx((f @ np.linalg.inv(sp)).ravel())
    mixed = 0.3 * f / np.cbrt(np.linalg.det(f)) + 0.7 * r
    assert made.blended(*f.ravel(), *r.ravel(), 0.3) == pytest.approx(mixed.ravel())
    assert made.blended(*(-f).ravel(), *r.ravel(), 0.3) == pytest.approx(r.ravel())  # mirrored: the rotation alone


def test_a_set_grows_by_its_share_of_a_strain_over_the_threshold_and_keeps_its_volume() -> None:
    made, strain = deformation.make(REAL), np.array([[0.1, 0.02, 0.0], [0.02, -0.05, 0.03], [0.0, 0.03, -0.04]])
    upper, sp = ([0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]), np.diag([1.25, 0.8, 1.0])
    length = np.linalg.norm(strain)
    new = np.array(made.crept(*strain[upper], *sp.ravel(), 0.99 * length, 0.2, 9.0)).reshape(3, 3)
    expected = sp + 0.2 * strain @ sp
    assert new == pytest.approx(expected / np.cbrt(np.linalg.det(expected)))
    assert made.crept(*strain[upper], *sp.ravel(), 1.01 * length, 0.2, 9.0) == tuple(sp.ravel())  # under it, to the bit
    cut = np.array(made.crept(*strain[upper], *sp.ravel(), 0.0, 0.2, 0.1)).reshape(3, 3)
    way = (expected - np.eye(3)) * 0.1 / np.linalg.norm(expected - np.eye(3))
    assert cut == pytest.approx((np.eye(3) + way) / np.cbrt(np.linalg.det(np.eye(3) + way)))
