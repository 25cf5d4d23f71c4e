"""Tetrahedra that keep their volumes: gradients, what one projection leaves, energies, fillings of closed meshes."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_scenes import mesh_scene

from softlab.app.driver import open_simulation
from softlab.bench.reference import xpbd_mesh as reference
from softlab.model.base.variant import plain_formulas
from softlab.model.core.build import build
from softlab.model.core.energy import energies
from softlab.model.formulas.constraints import volume
from softlab.model.geometry.topology import mesh_of
from softlab.model.position_based.mesh_constraints import constraint_sets, sixfold_volumes, tetrahedra_within

PROJECT = plain_formulas(volume, np.float64).project
REST = np.array([[0.0, 0.0, 0.0], [0.3, 0.02, 0.0], [0.05, 0.25, 0.01], [0.1, 0.08, 0.2]])
WEIGHTS = np.array([1.0, 2.0, 0.5, 3.0])


def sixfold(corners: np.ndarray) -> float:
    return float(sixfold_volumes(corners, np.array([[0, 1, 2, 3]]))[0])


def projected(corners: np.ndarray, compliance: float = 0.0, multiplier: float = 0.0) -> tuple[np.ndarray, float]:
    """(corners (4, 3), multiplier) after one projection towards REST's volume; `compliance`: alpha m / h^2."""
    values, points = (sixfold(REST), 6 * sixfold(REST)), tuple(map(tuple, corners))
    moved, (total,) = PROJECT(points, points, tuple(WEIGHTS), values, (multiplier,), (compliance, 0.0, 1.0))
    return np.array(moved), total


def test_displacements_follow_the_gradient_of_differences() -> None:
    """Each corner by its weight times the gradient of 6 V, times the multiplier; 6 V is of third degree, which
    is linear in every coordinate by itself: central differences miss nothing but rounding."""
    corners = REST * 1.1 + 0.01
    moved, total = projected(corners)
    for corner in range(4):
        for axis in range(3):
            shift = np.zeros((4, 3))
            shift[corner, axis] = 1e-3
            slope = (sixfold(corners + shift) - sixfold(corners - shift)) / 2e-3
            assert (moved - corners)[corner, axis] == pytest.approx(
                WEIGHTS[corner] * slope * total, rel=1e-9, abs=1e-15
            )
    _, gradients = reference.volume(REST)(corners)
    np.testing.assert_allclose(moved - corners, WEIGHTS[:, None] * gradients[0] * total, rtol=1e-9, atol=1e-15)


def test_one_projection_leaves_the_square_of_the_error() -> None:
    """A Newton step along the gradient: C' ~ C^2, a quarter with half the error."""
    left = [abs(sixfold(projected(REST * (1 + part))[0]) / sixfold(REST) - 1) for part in (0.02, 0.01, 0.005)]
    assert left[0] / left[1] == pytest.approx(4, rel=0.1) and left[1] / left[2] == pytest.approx(4, rel=0.05)


def test_momenta_are_kept() -> None:
    corners = REST @ np.diag([1.2, 0.9, 1.1]) + 0.3
    moved, _ = projected(corners, 1e-4, -1e-3)
    impulse = (moved - corners) / WEIGHTS[:, None]
    np.testing.assert_allclose(impulse.sum(axis=0), 0, atol=1e-15)
    np.testing.assert_allclose(np.cross(corners, impulse).sum(axis=0), 0, atol=1e-15)


def test_a_soft_one_rests_where_the_multiplier_is_the_pressure() -> None:
    """XPBD's fixed point, C = - alpha lambda (Macklin et al., eq. 6): projected again and again, what changes goes to 0."""
    corners, multiplier, compliance = REST * 1.05, 0.0, 2e-4
    for _ in range(60):
        corners, multiplier = projected(corners, compliance, multiplier)
    violation = sixfold(corners) - sixfold(REST)
    assert violation == pytest.approx(-compliance * 6 * sixfold(REST) * multiplier, rel=1e-9) and violation > 1e-6


def test_fillings_are_whole_and_turned_outwards() -> None:
    """The tetrahedra of a convex mesh fill it, but for the flat ones that are left out: by volume over its faces."""
    scene = mesh_scene("volume")
    assert scene.mesh is not None
    mesh = mesh_of(scene.mesh)
    corners = tetrahedra_within(mesh)
    volumes = sixfold_volumes(mesh.position, corners)
    a, b, c = (mesh.position[corner] for corner in mesh.triangles.T)
    inside = np.einsum("nk,nk->", a, np.cross(b, c))
    assert volumes.min() > 0 and volumes.sum() == pytest.approx(inside, rel=1e-2)
    assert set(np.unique(corners)) == set(range(len(mesh.position)))
    (found,) = (one for one in constraint_sets(scene) if one.kind == "volume")
    np.testing.assert_allclose(found.values[:, 1], 36 * found.values[:, 0] / 6)


def test_the_energy_is_that_of_a_bulk_modulus() -> None:
    """A ball grown by s: V = s^3 V0 everywhere, K/2 (s^3 - 1)^2 V0 in all."""
    scene = mesh_scene("volume")
    assert scene.mesh is not None
    p = mesh_of(scene.mesh).position
    inside = sixfold_volumes(p, tetrahedra_within(mesh_of(scene.mesh))).sum() / 6
    for s in (0.9, 1.2):
        found = energies(scene, s * p, np.zeros_like(p))["volume"]
        assert found == pytest.approx(2e3 / 2 * (s**3 - 1) ** 2 * inside, rel=1e-9)


def test_a_ball_keeps_its_volume_where_its_edges_alone_would_not() -> None:
    """Pressed onto the floor by its weight under 300 m/s^2, 0.3 kg/m^2 * 4 pi r^2 * 300 = 11 N: over half of its
    cross-section a pressure of 720 Pa, which takes at most 720 / K of the volume away where K is large."""
    floor = {"floor": {"kind": "plane", "point": [0.0, -0.1, 0.0]}, "gravity": {"acceleration": 300.0}}
    left = []
    for stiffness in (1e1, 1e4):
        soft = {"bending": {"model": "dihedral", "stiffness": 1e-6}}  # so that it is its edges that are asked
        scene = mesh_scene("volume", **floor, **soft, volume={"stiffness": stiffness}).replace({"mesh.pinned": "none"})
        assert scene.mesh is not None
        corners = tetrahedra_within(mesh_of(scene.mesh))
        rest = sixfold_volumes(build(scene).position, corners).sum()
        with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1) as simulation:
            simulation.advance(50)
            left.append(sixfold_volumes(simulation.state().position, corners).sum() / rest)
    assert 1 - left[1] < 720 / 1e4 and left[0] < 0.8
