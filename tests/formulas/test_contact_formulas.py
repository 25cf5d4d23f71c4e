"""Formulas of particles and cloths that touch, one point at a time: distances, friction, speeds, sleep."""

from __future__ import annotations

import numpy as np
import pytest
from test_point_formulas import REAL, D

from softlab.model.base.variant import plain_formulas
from softlab.model.formulas import contact, particle_contact

# ---------------------------------------------------------------------- contacts


def test_particles_that_are_too_near_part_to_their_distance_whatever_their_masses() -> None:
    made, w, n = plain_formulas(particle_contact, REAL), (2.0, 0.5), D / 1.3
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
    made = plain_formulas(particle_contact, REAL)
    assert (
        made.enforced_distance(1.5, *D, 0.1) == pytest.approx(1.4) and made.enforced_distance(1.5, *D, 0.3) == 1.5
    )  # no more than a push beyond
    assert made.depth(1.4, 1.45, 1.5, 0.02) == pytest.approx(0.05)
    assert made.depth(1.47, 1.45, 1.5, 0.02) == 0  # parting fast enough, nothing pulls
    assert made.depth(1.51, 1.5, 1.5, 0.02) == pytest.approx(-0.01)  # adhesion takes all of a gap of 0.01
    assert made.depth(1.7, 1.5, 1.5, 0.02) == -0.02  # and of a wider one what it may
    assert made.within(2.24, 1.5) and not made.within(2.25, 1.5) and not made.within(0.0, 0.0)
    assert made.touching(2.2530, 1.5) and not made.touching(2.2546, 1.5)


def test_friction_of_particles_takes_back_what_its_cone_holds() -> None:
    made, before, n = plain_formulas(particle_contact, REAL), np.array([0.1, -0.5, 1.0]), D / 1.3
    slip = np.array(made.slip(*D, *before, *n))
    assert slip == pytest.approx((D - before) - ((D - before) @ n) * n)
    size = np.linalg.norm(slip)
    assert made.grip(*slip, 1.01 * size / 0.5, 0.0, 0.5, 0.3) == 1
    assert made.grip(*slip, 0.99 * size / 0.5, 0.0, 0.5, 0.3) == pytest.approx(0.3 * 0.99 / 0.5)
    assert made.grip(*slip, -1.0, 0.1 * size, 0.5, 0.3) == pytest.approx(0.03)  # pressed by adhesion alone
    assert made.added_friction(1.0, 0.5, 0.2, 0.6, 0.25, 0.4) == pytest.approx(1 + 0.5 * (0.2 * 0.6 - 0.25 * 0.4))


def test_who_must_part_faster_who_goes_too_fast_and_who_sleeps() -> None:
    made, n = plain_formulas(particle_contact, REAL), D / 1.3
    came, now = -2.0 * n + [0.4, 0.3, 0.0], -0.1 * n
    came -= (came @ n + 2.0) * n
    assert made.lacking(came, now, n, 0.6, 1.9) == pytest.approx(0.6 * 2 + 0.1)
    assert made.lacking(came, now, n, 0.6, 2.1) == 0 and made.lacking(came, 1.3 * n, n, 0.6, 0.1) == 0
    assert made.far(*D) == pytest.approx(1.3)
    assert made.shortened(2.0, 1.0, 0.5, 0.2) == pytest.approx(1.4) and made.shortened(2.0, 1.0, 0.5, 0.6) == 2
    assert made.rested(2.0, 1.0, 0.5, 0.6) == 1 and made.rested(2.0, 1.0, 0.5, 0.4) == 2


def test_a_cloths_contact_is_divided_by_gershgorins_bound_and_rubs_by_coulomb() -> None:
    made, b, c = plain_formulas(contact, REAL), 0.2, 0.5
    assert made.mixed(1.0, 2.0, 4.0, b, c) == pytest.approx(0.3 * 1 + 0.2 * 2 + 0.5 * 4)
    assert made.first_weight(b, c) == pytest.approx(0.3)
    stiffness = made.stiffness(2.0, 3.0, 1.0, 1.5, 0.5, 2.0, 4.0, 0.7, b, c)
    assert stiffness == pytest.approx(2 * 3 + 0.3 * 1.5 + 0.2 * 0.5 * 2 + 0.5 * 4 * 0.7)
    assert made.inverse(stiffness) == pytest.approx(1 / stiffness) and made.inverse(0.0) == 0
    assert made.enforced_distance(0.02, 0.05, 0.01, 0.003) == pytest.approx(0.013)
    assert (
        made.enforced_distance(0.02, 0.05, 0.03, 0.003) == 0.02
        and made.enforced_distance(0.02, 0.015, 0.03, 0.003) == 0.015
    )
    assert made.slip(0.0099, 0.02, 0.5, 0.3) == 1 and made.slip(0.0101, 0.02, 0.5, 0.3) == pytest.approx(0.006 / 0.0101)
    assert made.along(0.7, 0.6, 0.5) == pytest.approx(0.4)
    assert made.correction(0.02, 0.6, 0.25) == pytest.approx(0.003)
    assert made.rubbed(0.02, 0.6, 0.5, 0.01, 0.25) == pytest.approx((0.012 - 0.005) / 4)
    assert made.taken(1.0, 0.3, 0.2) == pytest.approx(0.94) and made.shifted(1.0, 2.0, 0.3) == pytest.approx(1.6)
    assert made.away(1.0, 0.4, 0.6, b, c) == pytest.approx(1 - 0.08 - 0.3)
    rest = made.rest_distance(3.0, 1.0, 0.0, 4.0, 1.0, 2.0, b, c, 0.1)
    assert rest == pytest.approx(0.1 * np.hypot(3 - 0.2, 4 - 0.2 - 1.0))
