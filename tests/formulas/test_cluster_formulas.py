"""Formulas of shape matching, one cluster at a time: goals, motions, lattices, strains that stay."""

from __future__ import annotations

import numpy as np
import pytest
from test_point_formulas import RANDOM, REAL, TURN, D

from softlab.model.base.variant import plain_formulas
from softlab.model.formulas.shape_matching import cluster, deformation, lattice, pace, rebound
from softlab.model.formulas.shape_matching import grid as shape_matching


def vectors(count: int) -> np.ndarray:
    return RANDOM.normal(size=(count, 3))


# ---------------------------------------------------------------------- clusters


def test_a_cluster_finds_where_it_was_turned_and_moved_to_whatever_its_lean() -> None:
    """Rest offsets whose mean is not quite 0 (rounding leaves that), turned and moved: goals are where the particles are."""
    made, mass, rest = plain_formulas(cluster, REAL), RANDOM.uniform(1, 2, 5), vectors(5)
    lean = mass @ rest / mass.sum()
    now = rest @ TURN.T + [3.0, -1.0, 2.0]
    ways = np.array([[made.weighted(m, p[a], now[0, a]) for a in range(3)] for m, p in zip(mass, now, strict=True)])
    moments = np.zeros((3, 3))
    for way, r in zip(ways, rest, strict=True):
        moments = np.array([[made.added(moments[a, b], way[a], r[b]) for b in range(3)] for a in range(3)])
    way = ways.sum(axis=0)
    upright = np.array([[made.corrected(moments[a, b], way[a], lean[b]) for b in range(3)] for a in range(3)])
    offset = rest - lean
    assert upright == pytest.approx(TURN @ ((mass[:, None] * offset).T @ offset))
    middle = [made.centre(now[0, a], way[a], 1 / mass.sum(), *TURN[a], *lean) for a in range(3)]
    goals = np.array([[made.goal(middle[a], *TURN[a], *r) for a in range(3)] for r in rest])
    assert goals == pytest.approx(now)
    lanes = RANDOM.normal(size=16)
    assert made.total(lanes) == pytest.approx(lanes.sum())
    assert made.arrived(1.0, made.displacement_added(0.1, 0.25, 3.0, 2.0)) == pytest.approx(1.35)


def test_the_motion_of_a_cluster_is_found_from_its_sums_and_slows_to_it() -> None:
    """Particles that move as one: the sums, counted from the first, give centre, velocity and spin back, in any place."""
    made, mass, place = plain_formulas(pace, REAL), RANDOM.uniform(1, 2, 6), vectors(6)
    spin, drift = np.array([0.3, -0.7, 0.5]), np.array([2.0, 0.5, -1.0])
    centre = mass @ place / mass.sum()
    velocity = drift + np.cross(spin, place - centre)
    d, u = place - place[0], velocity - velocity[0]
    w, m = mass @ d, mass @ u
    turn = (mass[:, None] * np.cross(d, u)).sum(axis=0)
    second = (mass[:, None, None] * d[:, :, None] * d[:, None, :]).sum(axis=0)
    moments = second[0, 0], second[1, 1], second[2, 2], second[0, 1], second[0, 2], second[1, 2]
    found = made.motion(w, m, turn, moments, 1 / mass.sum(), place[0], velocity[0])
    assert found == pytest.approx([*centre, *drift, *spin])
    assert made.cross_added(1.0, 2.0, 3.0, 4.0, 5.0) == 1 + 6 - 20 and made.weighted(2.0, 5.0, 3.0) == 4
    assert made.slowed(0.1, 0.5, 1.0, 2.0, 3.0, 4.0, 0.5, 0.4) == pytest.approx(0.1 + 0.5 * (1 + 6 - 2 - 0.4))


def test_a_bodys_rebound_is_its_rigid_share_no_larger_than_allowed() -> None:
    made = plain_formulas(rebound, REAL)
    assert made.weighed(1.0, 2.0, *D) == pytest.approx(1 + 2 * 1.69)
    assert made.rigid(1.0, 2.0, 3.0, 4.0, 0.5) == 1 + 6 - 2
    assert made.enlarged(6.0, 3.0, 5.0) == 2 and made.enlarged(6.0, 1.0, 5.0) == 5 and made.enlarged(6.0, 0.0, 5.0) == 0
    assert made.touched(1.0, 2.0, 0.0, 0.0, 0.0) == 1 and made.touched(1.0, 2.0, 0.0, -1.0, 0.0) == 3
    assert made.asked(1.0, 2.0, 3.0, 0.0, 0.0, 0.0) == 1 and made.asked(1.0, 2.0, 3.0, 0.0, 0.0, 1.0) == 7
    assert made.wanted(0.5, 3.0, made.squared(1.0, -2.0)) == 3 * 0.25 * 5
    assert made.bound(4.0, 2.0, 6.0, 0.125) == 4 * 6 / 4 and made.bound(0.0, 2.0, 6.0, 0.125) == 0
    one, other, alone = (5.0, 6.0, 3.0), (2.0, 3.0, 1.0), (1.0, 0.0, 0.0)
    assert made.shared(0.0, *one, *other) == 9 / 4 == made.shared(0.0, *other, *one)  # best for both
    assert made.shared(1.0, *one, *other) == 2  # no energy gained
    assert made.shared(0.0, *(2.0, 60.0, 3.0), *other) == 2  # no more than the mean of their bounds
    assert made.shared(0.0, *one, *alone) == 1  # of no rigid body
    assert made.scaled(3.0, 2.0) == 6
    assert made.joined(1.0, 2.0) == 3 and made.rebounded(1.0, 0.25, 2.0) == 2.75


def test_windows_of_a_lattice_turned_in_its_plane_have_their_goals_where_the_masses_are() -> None:
    """3 x 3 masses around their middle, rows downwards, turned by 40 degrees and moved: the sums give centre and rotation
    back, and each mass's way to its goal is 0."""
    made, rest, share = plain_formulas(shape_matching, REAL), 0.5, 1.0
    cosine, sine = np.cos(np.radians(40)), np.sin(np.radians(40))
    turn = np.array([[cosine, -sine], [sine, cosine]])
    place = np.array([[[rest * j, -rest * i] @ turn.T + [2.0, 1.0] for j in (-1, 0, 1)] for i in (-1, 0, 1)])
    here = place[1, 1]
    sums = (0.0,) * 6
    for i, row in zip((-1, 0, 1), place, strict=True):
        line = (0.0,) * 4
        for step, (x, y) in zip((-1, 0, 1), row, strict=True):
            line = made.added_member(line, x, y, *row[1], share, step, 0.0)
        sums = made.added_row(sums, line, *row[1], *here, 3 * share, share, i)
    found = made.cluster(sums, *here, 1 / 3, 1 / 3)
    assert found == pytest.approx((*here, cosine, sine), abs=1e-14)
    for i, down in zip((0, 1, 2), (-rest, 0.0, rest), strict=True):
        for step in (-1, 0, 1):
            x, y = place[i, step + 1]
            goals = made.added_goal((0.0,) * 6, *found[:2], *here, *found[2:], made.rest_offset(step, 0.0, rest))
            assert made.added_goal_row(0.0, 0.0, goals, x, y, *here, 1.0, down) == pytest.approx((0, 0), abs=1e-14)
    assert made.moved(1.0, 0.5, 0.25, 0.8, 2.0) == pytest.approx(1 + 0.5 * 0.25 * 0.8 * 2)


def test_sums_along_a_lattices_axes_count_from_wherever_they_are_asked_to() -> None:
    made = plain_formulas(lattice, REAL)
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
    made, f, r = plain_formulas(deformation, REAL), np.eye(3) + 0.2 * RANDOM.normal(size=(3, 3)), TURN
    upper = ([0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2])
    symmetric = (r.T @ f + f.T @ r) / 2 - np.eye(3)
    assert made.strain(f.ravel(), r.ravel()) == pytest.approx(symmetric[upper])
    assert made.determinant(f.ravel()) == pytest.approx(np.linalg.det(f))
    assert made.cube_root(0.3) == pytest.approx(0.3 ** (1 / 3))
    a, g = RANDOM.normal(size=(3, 3)), RANDOM.normal(size=(3, 3))
    assert made.product(a.ravel(), g.ravel()) == pytest.approx((a @ g).ravel())
    assert made.bent(a.ravel(), g.ravel()) == pytest.approx((a @ g.T).ravel())
    g = g + g.T
    assert made.gradient(a.ravel(), g[upper]) == pytest.approx((a @ g).ravel())
    sp = np.diag([1.25, 0.8, 1.0]) @ TURN
    assert made.undone(f.ravel(), sp.ravel()) == pytest.approx((f @ np.linalg.inv(sp)).ravel())
    mixed = 0.3 * f / np.cbrt(np.linalg.det(f)) + 0.7 * r
    assert made.blended(f.ravel(), r.ravel(), 0.3) == pytest.approx(mixed.ravel())
    assert made.blended((-f).ravel(), r.ravel(), 0.3) == pytest.approx(r.ravel())  # mirrored: the rotation alone


def test_a_set_grows_by_its_share_of_a_strain_over_the_threshold_and_keeps_its_volume() -> None:
    made, strain = (
        plain_formulas(deformation, REAL),
        np.array([[0.1, 0.02, 0.0], [0.02, -0.05, 0.03], [0.0, 0.03, -0.04]]),
    )
    upper, sp = ([0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]), np.diag([1.25, 0.8, 1.0])
    length = np.linalg.norm(strain)
    new = np.array(made.crept(strain[upper], sp.ravel(), 0.99 * length, 0.2, 9.0)).reshape(3, 3)
    expected = sp + 0.2 * strain @ sp
    assert new == pytest.approx(expected / np.cbrt(np.linalg.det(expected)))
    assert made.crept(strain[upper], sp.ravel(), 1.01 * length, 0.2, 9.0) == tuple(sp.ravel())  # under it, to the bit
    cut = np.array(made.crept(strain[upper], sp.ravel(), 0.0, 0.2, 0.1)).reshape(3, 3)
    way = (expected - np.eye(3)) * 0.1 / np.linalg.norm(expected - np.eye(3))
    assert cut == pytest.approx((np.eye(3) + way) / np.cbrt(np.linalg.det(np.eye(3) + way)))
