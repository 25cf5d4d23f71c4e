"""Colliders' formulas, uncompiled, against closed forms: how far a point is from each shape on every side of it, when a fast
ball is met, and Coulomb's cone, tried just inside and just outside."""

from __future__ import annotations

import numpy as np
import pytest
from collider_touch import CASES, DT, STEP, numbers_of, scene_of

from softlab.model.base.variant import features_of, plain_formulas
from softlab.model.contact import colliders as kernels
from softlab.model.contact.sheet_plan import cloth_parts
from softlab.model.formulas import colliders

FORMULAS = [plain_formulas(colliders, real) for real in (np.float64, np.float32)]
DOUBLE = FORMULAS[0]
TURN = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]  # so that no axis is special
TURN *= np.sign(np.linalg.det(TURN))

# A capsule from the origin along x to 2, of radius 0.5: where a point lies, how far out it is, and which way leads out.
CAPSULE = [
    ((1.0, 1.5, 0.0), 1.0, (0, 1, 0)),  # beside it
    ((0.3, 0.0, -0.7), 0.2, (0, 0, -1)),
    ((1.7, 0.3, 0.0), -0.2, (0, 1, 0)),  # inside
    ((-3.0, 4.0, 0.0), 4.5, (-0.6, 0.8, 0)),  # beyond its start
    ((5.0, 0.0, 4.0), 4.5, (0.6, 0, 0.8)),  # beyond its end
    ((2.4, 0.0, 0.0), -0.1, (1, 0, 0)),  # in its end's cap
    ((-0.3, 0.0, 0.4), 0.0, (-0.6, 0, 0.8)),  # on its start's cap
]


@pytest.mark.parametrize(("at", "distance", "normal"), CAPSULE)
def test_a_capsule(at: tuple[float, ...], distance: float, normal: tuple[float, ...]) -> None:
    for formulas in FORMULAS:
        found = formulas.capsule(*TURN @ at, *TURN @ (2.0, 0.0, 0.0), 0.5)
        assert found == pytest.approx((distance, *TURN @ normal), abs=1e-6)


def test_a_capsule_without_length_is_a_ball() -> None:
    assert DOUBLE.capsule(0, 3, 4, 0, 0, 0, 1.0) == DOUBLE.sphere(0, 3, 4, 1.0) == (4, 0, 0.6, 0.8)


@pytest.mark.parametrize(
    ("at", "distance", "normal"),
    [
        ((0.0, 2.5, 0.0), 0.5, (0, 1, 0)),
        ((1.3, -2.4, 0.0), 0.5, (0.6, -0.8, 0)),  # off an edge
        ((-1.2, 2.3, -3.6), 0.7, (-2 / 7, 3 / 7, -6 / 7)),  # off a corner
        ((0.9, 0.0, 0.0), -0.1, (1, 0, 0)),  # inside, out by the nearest face
        ((0.5, -1.8, 1.0), -0.2, (0, -1, 0)),
        ((-0.1, 0.5, 2.7), -0.3, (0, 0, 1)),
    ],
)
def test_a_box(at: tuple[float, ...], distance: float, normal: tuple[float, ...]) -> None:
    """Of 2 x 4 x 6 m."""
    assert DOUBLE.box(*at, 1.0, 2.0, 3.0) == pytest.approx((distance, *normal))


def test_a_plane_and_a_ball() -> None:
    n = TURN[0]
    assert DOUBLE.plane(*(0.7 * n + 3 * TURN[1]), *n) == pytest.approx((0.7, *n))
    assert DOUBLE.plane(*(-0.7 * n + 3 * TURN[1]), *n) == pytest.approx((-0.7, *n))
    assert DOUBLE.sphere(*(0.3 * n), 0.5) == pytest.approx((-0.2, *n))
    assert DOUBLE.sphere(0.0, 0.0, 0.0, 0.5) == (-0.5, 0, 1, 0)  # its very centre: upward


@pytest.mark.parametrize(
    ("begin", "end", "part"),
    [
        ((-4.0, 0.6, 0.0), (4.0, 0.6, 0.0), (4 - 0.8) / 8),  # through it: met 0.8 before the middle
        ((-4.0, 0.0, 0.0), (0.5, 0.0, 0.0), 3 / 4.5),  # into its far half
        ((-4.0, 0.0, 0.0), (-0.5, 0.0, 0.0), 1.0),  # into its near half, where pushing it out is right
        ((-4.0, 1.1, 0.0), (4.0, 1.1, 0.0), 1.0),  # past it
        ((-4.0, 0.0, 0.0), (-2.0, 0.0, 0.0), 1.0),  # before it
        ((4.0, 0.0, 0.0), (8.0, 0.0, 0.0), 1.0),  # away from it
        ((0.5, 0.0, 0.0), (-4.0, 0.0, 0.0), 1.0),  # begun inside
    ],
)
def test_when_a_ball_of_radius_1_is_met(begin: tuple[float, ...], end: tuple[float, ...], part: float) -> None:
    assert DOUBLE.sphere_entry(*TURN @ begin, *TURN @ end, 1.0) == pytest.approx(part)


# ---------------------------------------------------------------------- Coulomb's cone

MOVES = np.array([0.3, -0.2, 0.5])  # the collider


def responded(normal: float, along: float, static: float, dynamic: float) -> tuple[float, float, float]:
    """(normal, along, across) velocity relative to the collider of a mass that came at these."""
    n, t, s = TURN
    found = np.array(DOUBLE.respond(MOVES + normal * n + along * t, MOVES, n, static, dynamic)) - MOVES
    return float(found @ n), float(found @ t), float(found @ s)


@pytest.mark.parametrize(
    ("along", "static", "dynamic", "left"),
    [
        (0.99, 0.5, 0.4, 0.0),  # 2 m/s taken from the normal velocity: up to 1 m/s sticks
        (1.01, 0.5, 0.4, 1.01 - 0.8),  # above, the dynamic coefficient takes 0.8 m/s
        (1.01, 0.0, 0.0, 1.01),  # smooth
        (3.0, 0.5, 0.0, 3.0),
        (-1.2, 0.5, 0.4, -1.2 + 0.8),
    ],
)
def test_what_sticks_and_what_slides(along: float, static: float, dynamic: float, left: float) -> None:
    assert responded(-2.0, along, static, dynamic) == pytest.approx((0, left, 0), abs=1e-14)


def test_who_leaves_is_let_go() -> None:
    assert responded(0.1, 0.7, 0.5, 0.4) == pytest.approx((0.1, 0.7, 0))


@pytest.mark.parametrize(
    ("normal", "along", "back", "left"),
    [
        (-2.0, 1.49, 1.0, 0.0),  # a change of 3 m/s, half of which holds 1.5 m/s
        (-2.0, 1.51, 1.0, 1.51 - 0.4 * 3),
        (-0.09, 0.044, 0.0, 0.0),  # no faster than what settles: nothing comes back
        (-0.11, 1.0, 0.055, 1.0 - 0.4 * 0.165),
        (0.5, 1.0, 0.5, 1.0),
    ],
)
def test_what_comes_back_and_what_friction_then_takes(normal: float, along: float, back: float, left: float) -> None:
    n, t, s = TURN
    velocity = MOVES + normal * n + along * t
    found = np.array(DOUBLE.rebound(velocity, MOVES, n, 0.5, 0.4, 0.5, 0.1)) - MOVES
    assert (found @ n, found @ t, found @ s) == pytest.approx((back, left, 0), abs=1e-14)


def test_friction_takes_back_what_it_slowed_for_a_substep() -> None:
    """Across the normal alone: of a mass that sticks all that it slid."""
    n, t, s = TURN
    before, after, h = MOVES - 2.0 * n + 1.5 * t, MOVES + 0.4 * n, 0.01
    taken = np.array(DOUBLE.slid(h, after, before, n))
    assert (taken @ n, taken @ t, taken @ s) == pytest.approx((0, -1.5 * h, 0), abs=1e-16)


def test_settling_is_twice_what_gravity_adds_in_a_step() -> None:
    assert DOUBLE.settling_speed(-9.81, 0.01) == DOUBLE.settling_speed(9.81, 0.01) == pytest.approx(0.1962)


# ---------------------------------------------------------------------- one mass and one collider


@pytest.mark.parametrize("real", [np.float64, np.float32])
@pytest.mark.parametrize("name", CASES)
def test_one_mass_meets_a_collider_on_the_cpu(name: str, real: type) -> None:
    kind, table, met, expected = CASES[name]
    scene = scene_of(kind, table)
    touch = getattr(plain_formulas(kernels, real, features_of(cloth_parts(scene))), f"touch_{kind}")
    vectors = [tuple(real(number) for number in vector) for vector in met]
    position, velocity = touch(numbers_of(scene, real), real(STEP * DT), real((STEP + 1) * DT), real(0), *vectors)
    assert [*position, *velocity] == pytest.approx([*expected[0], *expected[1]], abs=1e-6)
