"""Hinges of two triangles: closed forms, gradients by differences, rigid motions, states without a direction."""

from __future__ import annotations

from math import pi, tan

import numpy as np
import pytest

from softlab.bench.reference import xpbd_mesh as reference
from softlab.model.base.variant import plain_formulas
from softlab.model.core.build import rest_positions
from softlab.model.formulas import bending
from softlab.model.geometry.mesh import triangle_mesh
from softlab.model.position_based.mesh_constraints import (
    dihedral_values,
    isometric_values,
    mesh_energy,
    quarter_tangents,
)
from softlab.model.scene.scene import Scene

FORMULAS = plain_formulas(bending, np.float64)
SINGLE = plain_formulas(bending, np.float32)
TRIANGLES = np.array([[0, 1, 2], [1, 0, 3]])
RANDOM = np.random.default_rng(11)


def bent(theta: float, edge: float = 0.3, wings: tuple[float, float] = (0.2, 0.25)) -> np.ndarray:
    """(4, 3): a hinge of that angle, wings bent toward the normals (z) where it is positive."""
    half = theta / 2
    c = [0.4 * edge, wings[0] * np.cos(half), wings[0] * np.sin(half)]
    d = [0.7 * edge, -wings[1] * np.cos(half), wings[1] * np.sin(half)]
    return np.array([[0.0, 0.0, 0.0], [edge, 0.0, 0.0], c, d])


def anyhow(corners: np.ndarray) -> np.ndarray:
    """Turned and shifted at random."""
    turn, _ = np.linalg.qr(RANDOM.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    return corners @ turn.T + RANDOM.normal(size=3)


def hinge(corners: np.ndarray, formulas: object = FORMULAS, real: type = np.float64) -> np.ndarray:
    a, b, c, d = corners.astype(real)
    return np.array(formulas.hinge(*(b - a), *(c - a), *(d - a)))  # type: ignore[attr-defined]


def gradient(corners: np.ndarray) -> np.ndarray:
    """(4, 3) of theta."""
    _, *numbers = hinge(corners)
    c, d, along = np.array(numbers[:3]), np.array(numbers[3:6]), numbers[6:]
    ends = np.array([FORMULAS.by_ends(*along, one, other) for one, other in zip(c, d, strict=True)])
    return np.stack([*ends.T, c, d])


ANGLES = [-3.1, -2.0, -pi / 2, -0.3, -1e-6, 0.0, 1e-8, 0.5, pi / 2, 2.5, 3.1]


@pytest.mark.parametrize("theta", ANGLES)
def test_the_angle_is_found_whatever_it_is(theta: float) -> None:
    corners = anyhow(bent(theta))
    np.testing.assert_allclose(hinge(corners)[0], tan(theta / 4), rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(reference.hinge(corners).theta, theta, rtol=1e-9, atol=1e-15)
    mesh_way = quarter_tangents(corners, np.array([[0, 1, 2, 3]]))
    np.testing.assert_allclose(mesh_way, tan(theta / 4), rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("theta", ANGLES)
def test_the_gradient_is_that_of_differences(theta: float) -> None:
    """Central differences of step s = 1e-6 of lengths of 0.2 m: s^2 / 0.2^3 from the third derivative, and rounding of the
    angle, 1e-15 / s: 1e-8."""
    corners, step = anyhow(bent(theta)), 1e-6
    found = np.zeros((4, 3))
    for corner in range(4):
        for axis in range(3):
            shift = np.zeros((4, 3))
            shift[corner, axis] = step
            up, down = (4 * np.arctan(hinge(corners + sign * shift)[0]) for sign in (1, -1))
            found[corner, axis] = (up - down) / (2 * step)
    np.testing.assert_allclose(gradient(corners), found, atol=1e-7)
    np.testing.assert_allclose(gradient(corners), reference.hinge(corners).gradient, atol=1e-9)


@pytest.mark.parametrize("theta", ANGLES)
def test_gradients_neither_push_nor_turn(theta: float) -> None:
    corners = anyhow(bent(theta))
    found = gradient(corners)
    np.testing.assert_allclose(found.sum(axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(np.cross(corners, found).sum(axis=0), 0, atol=1e-12)


@pytest.mark.parametrize("theta", [0.0, 0.4, -2.2])
def test_rigid_motions_bend_nothing(theta: float) -> None:
    """Both constraints are 0 wherever the hinge is moved to."""
    rest = anyhow(bent(theta))
    for make in (reference.isometric, reference.dihedral):
        for _ in range(3):
            value, _ = make(rest)(anyhow(bent(theta)))
            np.testing.assert_allclose(value, 0, atol=1e-13)


@pytest.mark.parametrize("theta", [0.2, 1.0, 3.0])
def test_the_isometric_vector_is_twice_the_edge_times_the_half_angles_sine(theta: float) -> None:
    """Of a hinge at rest flat whose triangles keep their shape: |k| = 2 |e| sin(theta/2); cotangents and heights agree."""
    flat, now = bent(0.0), anyhow(bent(theta))
    coefficients = isometric_values(triangle_mesh(flat, TRIANGLES))[0]
    np.testing.assert_allclose(coefficients[:4], reference.hinge(flat).coefficients, rtol=1e-12)
    assert coefficients[4] == 0.0
    np.testing.assert_allclose(coefficients[5], 0.3 * (0.2 + 0.25) / 6, rtol=1e-12)
    curvature = plain_formulas(bending, np.float64).curvature
    k = [curvature(*coefficients[1:4], *(now[1:, axis] - now[0, axis])) for axis in range(3)]
    np.testing.assert_allclose(np.linalg.norm(k), 2 * 0.3 * np.sin(theta / 2), rtol=1e-12)


def test_both_models_agree_for_small_angles() -> None:
    """4 tan(theta/4) = theta + theta^3/48, 2 sin(theta/2) = theta - theta^3/24: apart by theta^2/16 of themselves."""
    rest = bent(0.0)
    for theta in (0.1, 0.05):
        one, two = (make(rest)(bent(theta))[0] for make in (reference.isometric, reference.dihedral))
        apart = abs(float(two[0]) / float(np.linalg.norm(one)) - 1)
        np.testing.assert_allclose(apart, theta**2 / 16, rtol=0.01)


def test_float32_sees_small_angles() -> None:
    """The angle between normals by their product alone would lose half the digits: 1 - theta^2/2 is 1 below 3e-4."""
    for theta in (1e-3, 1e-5, -1e-6):
        found = hinge(bent(theta), SINGLE, np.float32)[0]
        np.testing.assert_allclose(found, theta / 4, rtol=1e-6)


@pytest.mark.parametrize("theta", [pi, -pi, 0.0])
def test_flat_and_folded_states_are_finite_and_folded_ones_open(theta: float) -> None:
    corners = bent(theta)
    corners[np.abs(corners) < 1e-12] = 0.0  # exactly folded
    t, *rest = hinge(corners)
    assert np.isfinite(rest).all()
    assert abs(t) == (1.0 if theta else 0.0)
    found = gradient(corners) * FORMULAS.steepness(0.3, t)
    assert np.linalg.norm(found, axis=1).min() > 0  # there is a way out


def test_triangles_without_area_do_nothing() -> None:
    for corners in (np.zeros((4, 3)), np.array([[0, 0, 0], [1, 0, 0], [0.5, 0, 0], [0.5, 1, 0]], float)):
        assert not hinge(corners).any()


@pytest.mark.parametrize("diagonals", ["one", "alternating"])
def test_a_sheet_rolled_along_its_cells_has_three_times_the_plates_energy(diagonals: str) -> None:
    """Radius R: cells stay plane, so that of the three families of hinges only the edges across bend, by theta = s/R each,
    and hold B/2 * 3 s^2 / s^2 * theta^2: three times B/2 * area / R^2, all the curvature on a third of the hinges. The
    rims' hinges are missing: (n - 2)/(n - 1) of them are there; the rest is of second order in s/R."""
    for n in (9, 33):
        tables = {
            "mesh": {"shape": "sheet", "rows": n, "columns": n, "spacing": 1 / (n - 1), "diagonals": diagonals},
            "bending": {"stiffness": 2.0, "model": "dihedral"},
            "method": {"solver": "xpbd"},
        }
        scene = Scene(tables)
        flat = rest_positions(scene.grid)
        rolled = np.stack([np.sin(flat[:, 0]), flat[:, 1], np.cos(flat[:, 0])], axis=1)
        factor = mesh_energy(scene, rolled, "bending") / (2.0 / 2) * (n - 1) / (n - 2)
        np.testing.assert_allclose(factor, 3.0, rtol=(1 / (n - 1)) ** 2)


def test_rest_states_are_kept_by_name() -> None:
    """Angles at rest of a bent mesh: what is stored is that of `bent`, to the sign."""
    for theta in (0.7, -1.9):
        values = dihedral_values(triangle_mesh(bent(theta), TRIANGLES))
        np.testing.assert_allclose(values[0], [0.3, tan(theta / 4), 0.3 * 0.45 / 6], rtol=1e-9)
