"""Surfaces that are drawn in space: triangles of cloths, normals, colliders, the ground and shadows on it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from test_shapes3d import RANDOM

from softlab.app.render.collider_shapes import (
    Mesh,
    box_mesh,
    capsule_mesh,
    grounds,
    line_distance,
    plane_axes,
    shadow_matrix,
    sphere_mesh,
    with_colliders,
)
from softlab.app.render.drawn_springs import drawn_kinds, drawn_strain
from softlab.app.render.scenery import KEY
from softlab.model.core.build import rest_positions
from softlab.model.geometry.normals import vertex_normals
from softlab.model.geometry.sheets import sheet_triangles as triangles
from softlab.model.scene.scene import Scene

HANGING: dict[str, Any] = {
    "cloth": {"rows": 7, "columns": 9, "spacing": 0.25, "pinned": "top-corners"},
    "structural": {},
    "shear": {},
    "gravity": {"enabled": False},
}
SCENE = Scene(HANGING)
FLAT = Scene(HANGING | {"cloth": HANGING["cloth"] | {"placement": "flat"}})
REST = rest_positions(SCENE.grid)


# ---------------------------------------------------------------------- surfaces and shapes


def areas(position: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(triangles, 3): vectors of twice the area along the normals."""
    a, b, c = (position[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def test_cells_are_split_from_their_first_mass_to_the_one_opposite() -> None:
    faces = triangles(3, 4)
    assert faces.shape == (12, 3) and faces.dtype == np.uint32
    np.testing.assert_array_equal(faces[:2], [[0, 4, 5], [0, 5, 1]])
    for scene, axis in ((SCENE, 2), (FLAT, 1)):  # toward +z where it hangs, up where it lies
        normals = areas(rest_positions(scene.grid), triangles(7, 9))
        np.testing.assert_allclose(normals, np.eye(3)[[axis] * 96] * 0.25**2, atol=1e-15)
    assert triangles(1, 5).shape == triangles(5, 1).shape == (0, 3)


def test_normals_are_the_mean_of_the_triangles_by_area() -> None:
    """Against the sum over a list of triangles; both in float64, rounded to float32 once: 1e-6."""
    position = REST + RANDOM.normal(0, 0.05, REST.shape)
    faces = triangles(7, 9)
    total = np.zeros_like(position)
    for corner in range(3):
        np.add.at(total, faces[:, corner], areas(position, faces))
    wanted = total / np.linalg.norm(total, axis=1, keepdims=True)
    np.testing.assert_allclose(vertex_normals(position, 7, 9), wanted, atol=1e-6)


def test_normals_of_a_ball_point_outward_and_a_line_has_none() -> None:
    """A patch of a ball of radius 1 with cells of h = 0.02: triangles touch it to O(h), their mean to O(h): within 2 h."""
    angle = 0.02 * np.arange(-10, 11)
    down, across = np.meshgrid(angle, angle, indexing="ij")
    patch = np.stack([np.sin(across), -np.sin(down), np.sqrt(1 - np.sin(across) ** 2 - np.sin(down) ** 2)], axis=-1)
    np.testing.assert_allclose(vertex_normals(patch, 21, 21), patch.reshape(-1, 3), atol=0.04)
    assert not vertex_normals(np.zeros((12, 3)), 3, 4).any()
    assert not vertex_normals(rest_positions(Scene({"cloth": {"rows": 1, "columns": 5}}).grid), 1, 5).any()


def test_strain_is_that_of_the_springs_that_are_drawn() -> None:
    assert drawn_kinds(SCENE) == ["structural", "shear"]
    only = Scene({"cloth": {"rows": 4, "columns": 4}, "bending": {}})
    assert drawn_kinds(only) == ["bending"]
    for scene in (SCENE, only):
        strain = drawn_strain(scene, 1.25 * rest_positions(scene.grid))
        np.testing.assert_allclose(strain, 0.25, atol=1e-12)
    assert len(drawn_strain(SCENE, REST)) == 7 * 8 + 6 * 9 + 2 * 6 * 8
    assert drawn_strain(Scene({"cloth": {"rows": 2, "columns": 2}}), np.zeros((4, 3))).shape == (0,)


def volume(mesh: Mesh) -> float:
    """Of what a mesh encloses, by the divergence theorem; positive where its triangles turn outward."""
    p = mesh.vertices.astype(float)
    return float(np.sum(p[mesh.triangles[:, 0]] * areas(p, mesh.triangles)) / 6)


@pytest.mark.parametrize(
    ("mesh", "exact"),
    [
        (sphere_mesh((1, 2, 3), 0.5), 4 / 3 * np.pi * 0.5**3),
        (capsule_mesh((0, 0, 0), (1, 2, 2), 0.4), 4 / 3 * np.pi * 0.4**3 + np.pi * 0.4**2 * 3),
        (capsule_mesh((1, 1, 1), (1, 1, 0), 0.4), 4 / 3 * np.pi * 0.4**3 + np.pi * 0.4**2),
        (box_mesh((1, -1, 0), (0.5, 1.0, 2.0)), 8.0),
    ],
)
def test_meshes_are_closed_and_turn_outward(mesh: Mesh, exact: float) -> None:
    """Inscribed in round shapes: 64 sectors and 20 rings a quarter lose (2 pi / 64)^2 / 6 + (pi / 38)^2 / 4 at most, so
    under half a per cent."""
    assert 0.995 * exact < volume(mesh) < exact * (1 + 1e-5)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-6)
    faces = areas(mesh.vertices.astype(float), mesh.triangles)
    outward = np.sum(faces * mesh.normals[mesh.triangles[:, 1]], axis=1)
    assert (outward >= -1e-9).all()
    edges = np.sort(mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    ends = np.round(mesh.vertices[edges].astype(float), 5)
    real = ends[(ends[:, 0] != ends[:, 1]).any(axis=1)]
    swapped = np.array([sorted(map(tuple, pair)) for pair in real.tolist()]).reshape(-1, 6)
    _, count = np.unique(swapped, axis=0, return_counts=True)
    assert (count % 2 == 0).all()  # every edge has a triangle on both sides


def test_a_capsule_keeps_its_distance_from_its_segment() -> None:
    mesh = capsule_mesh((0, 0, 0), (0, 0, 2), 0.3)
    p = mesh.vertices.astype(float)
    p[:, 2] -= np.clip(p[:, 2], 0, 2)
    np.testing.assert_allclose(np.linalg.norm(p, axis=1), 0.3, atol=1e-6)


@pytest.mark.parametrize("normal", [(0, 1, 0), (1, 0, 0), (0.3, -2, 0.5)])
def test_a_plane_has_axes_of_its_own(normal: tuple[float, float, float]) -> None:
    across, along, n = plane_axes(normal)
    np.testing.assert_allclose(np.array([across, along, n]) @ np.array([across, along, n]).T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(np.cross(across, along), n, atol=1e-15)
    np.testing.assert_allclose(n * np.linalg.norm(normal), normal, atol=1e-15)


def test_the_ground_is_the_scenes_plane_where_it_is_now_or_lies_below() -> None:
    plane = {"plane": {"point": [0.0, -1.0, 0.0], "normal": [0.0, 2.0, 0.0], "velocity": [0.0, 0.5, 0.0]}}
    (ground,) = grounds(Scene(HANGING | plane), 2.0, -9.0)
    np.testing.assert_allclose(ground.point, 0, atol=1e-15)
    np.testing.assert_allclose(ground.normal, (0, 1, 0))
    for lowest in (-1.5, -1.6, 3.0):
        (ground,) = grounds(SCENE, 0.0, lowest)
        assert lowest - 2.25 / 4 < ground.point[1] < lowest
    assert line_distance(2.25) == pytest.approx(0.2) and line_distance(16.0) == pytest.approx(2)


def test_shadows_fall_along_the_light_into_the_plane() -> None:
    (ground,) = grounds(Scene(HANGING | {"plane": {"point": [0.0, -1.0, 0.0], "normal": [0.2, 1.0, -0.1]}}), 0.0, 0.0)
    light = KEY
    places = RANDOM.uniform(-1, 1, (20, 3))
    fallen = (np.column_stack([places, np.ones(20)]) @ shadow_matrix(ground, light).T)[:, :3]
    np.testing.assert_allclose((fallen - ground.point) @ ground.normal, 0, atol=1e-14)
    np.testing.assert_allclose(np.cross(fallen - places, light), 0, atol=1e-14)


def test_colliders_belong_to_the_view_unless_they_are_huge_or_far() -> None:
    bounds = (0.0, -1.5, 0.0, 2.0, 0.0, 0.0)
    ball = {"sphere": {"center": [1.0, -1.0, 0.5], "radius": 0.3, "velocity": [0.0, 0.0, 1.0]}}
    scene = Scene(HANGING | ball)
    assert with_colliders(scene, bounds, 0.0) == pytest.approx((0, -1.5, 0, 2, 0, 0.8))
    assert with_colliders(scene, bounds, 100.0) == bounds  # it flew off
    planet = Scene(HANGING | {"sphere": {"center": [0.0, -1001.0, 0.0], "radius": 1000.0}})
    assert with_colliders(planet, bounds, 0.0)[1] == pytest.approx(-1.5 - 2.25 / 2)
    slab = Scene(HANGING | {"box": {"center": [1.0, -1.5, 0.0], "half_size": [2.2, 0.1, 0.1]}})  # not twice as large
    assert with_colliders(slab, bounds, 0.0) == pytest.approx((-1.2, -1.6, -0.1, 3.2, 0.0, 0.1))
    others = {
        "capsule": {"start": [0.0, 0.0, 0.0], "end": [2.5, 0.0, 0.0], "radius": 0.1},
        "box": {"center": [0.0, -2.0, 0.0], "half_size": [0.1, 0.2, 0.3]},
        "plane": {},
    }
    assert with_colliders(Scene(HANGING | others), bounds, 0.0) == pytest.approx((-0.1, -2.2, -0.3, 2.6, 0.1, 0.3))
