"""Drawing in space without OpenGL: camera and picking, a cloth's triangles and normals, the shapes of colliders."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from app.render.camera import pick
from app.render.camera3d import MAX_PITCH, Camera3D
from app.render.collider_shapes import (
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
from app.render.drawn_springs import drawn_kinds, drawn_strain
from app.render.framing import seen_points
from app.render.scenery import KEY
from model.core.build import rest_positions
from model.geometry.normals import vertex_normals
from model.geometry.sheets import sheet_triangles as triangles
from model.scene.scene import Scene

HANGING: dict[str, Any] = {
    "cloth": {"rows": 7, "columns": 9, "spacing": 0.25, "pinned": "top-corners"},
    "structural": {},
    "shear": {},
    "gravity": {"enabled": False},
}
SCENE = Scene(HANGING)
FLAT = Scene(HANGING | {"cloth": HANGING["cloth"] | {"placement": "flat"}})
REST = rest_positions(SCENE.grid)
RANDOM = np.random.default_rng(5)


# ---------------------------------------------------------------------- the camera


def some_camera() -> Camera3D:
    return Camera3D(800, 600, 1.0, -2.0, 0.5, 6.0, yaw=0.7, pitch=-0.4)


def test_a_place_goes_to_the_window_and_back() -> None:
    camera = some_camera()
    place = np.array([1.4, -2.3, 1.1])
    x, y = camera.to_window(place)
    assert camera.on_plane(x, y, place) == pytest.approx(tuple(place), abs=1e-12)
    np.testing.assert_allclose(camera.to_window(camera.target), (400, 300), atol=1e-9)
    np.testing.assert_allclose(camera.axes @ camera.axes.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(camera.axes) == pytest.approx(1)  # right-handed: nothing is mirrored


def test_the_matrix_of_the_graphics_card_says_the_same_as_the_projection() -> None:
    camera = some_camera()
    places = camera.target + RANDOM.uniform(-1, 1, (50, 3))
    clip = np.column_stack([places, np.ones(50)]) @ camera.matrix().T
    pixels = (clip[:, :2] / clip[:, 3:] + 1) / 2 * (camera.width, camera.height)
    place, depth = camera.project(places)
    np.testing.assert_allclose(pixels, place, atol=1e-9)
    np.testing.assert_allclose(clip[:, 3], depth, atol=1e-12)
    assert (np.abs(clip[:, 2]) < clip[:, 3]).all()  # between the near and the far plane
    nearer = np.argsort(depth)
    assert (np.diff((clip[:, 2] / clip[:, 3])[nearer]) >= 0).all()


def test_what_lies_behind_the_viewer_has_no_place() -> None:
    camera = some_camera()
    behind = camera.eye + camera.axes[2]
    assert np.isnan(camera.to_window(behind)).all()
    assert np.isnan(camera.to_window(np.array([np.nan, 0, 0]))).all()
    assert pick(camera, behind[None], 400, 300, 1e9) is None


def test_turning_keeps_the_target_and_stops_at_the_poles() -> None:
    camera = Camera3D(800, 600, 1.0, 2.0, 3.0, 5.0, yaw=0.0, pitch=0.0)
    front = camera.to_window(np.array([1.0, 2.0, 3.5]))  # half a metre before the target
    camera.orbit(40, 25)
    moved = camera.to_window(np.array([1.0, 2.0, 3.5]))
    assert (moved - front > 5).all()  # what faces the viewer follows the pointer to the right and up
    np.testing.assert_allclose(camera.to_window(camera.target), (400, 300), atol=1e-9)
    assert np.linalg.norm(camera.eye - camera.target) == pytest.approx(5)
    camera.orbit(0, -1e6)
    assert camera.pitch == MAX_PITCH
    camera.orbit(0, 1e6)
    assert camera.pitch == -MAX_PITCH and np.isfinite(camera.matrix()).all()


def test_moving_and_zooming_keep_the_target_plane_under_the_pointer() -> None:
    camera = some_camera()
    x, y = camera.to_window(camera.target)
    before = camera.target
    camera.pan(30, -20)
    np.testing.assert_allclose(camera.to_window(before), (x + 30, y - 20), atol=1e-9)
    place = np.array(camera.on_plane(150, 480, camera.target))
    scale = camera.scale
    camera.zoom(1.7, 150, 480)
    assert camera.scale == pytest.approx(1.7 * scale)
    np.testing.assert_allclose(camera.to_window(place), (150, 480), atol=1e-9)


@pytest.mark.parametrize("size", [(800, 600), (300, 900), (1600, 200)])
@pytest.mark.parametrize("turn", [(0.0, 0.0), (0.45, 0.28), (2.5, -1.2)])
def test_framing_holds_every_corner_and_wastes_nothing(size: tuple[int, int], turn: tuple[float, float]) -> None:
    """The corners lie within the margins, and two opposite margins of one axis are touched: no nearer eye would do."""
    left, bottom, right, top = margins = (20.0, 60.0, 35.0, 40.0)
    bounds = (-1.0, -3.0, 0.0, 2.0, 0.5, 1.5)
    camera = Camera3D(*size, yaw=turn[0], pitch=turn[1]).framing(bounds, margins, 0.1)
    assert (camera.yaw, camera.pitch) == turn
    corners = np.array([[bounds[3 * (k >> axis & 1) + axis] for axis in range(3)] for k in range(8)])
    place = camera.to_window(corners)
    low, high = place.min(axis=0), place.max(axis=0)
    slack = np.concatenate([low - (left, bottom), np.array(size) - (right, top) - high])
    assert (slack > -1e-6).all()
    assert (slack[[0, 2]] < 1e-6).all() or (slack[[1, 3]] < 1e-6).all()


def test_balls_are_held_within_the_margins_and_nothing_is_wasted() -> None:
    """Points on the balls (Fibonacci spirals) lie within the margins, the outermost of them at two opposite ones, to what
    spirals of 2000 miss of a ball; the few outermost points stand for all."""
    size, margins, radius = (800, 600), (20.0, 60.0, 35.0, 40.0), 0.3
    random = np.random.default_rng(3)
    points = random.normal((7.0, -2.0, 1.0), (1.0, 0.2, 2.0), (50, 3))
    camera = Camera3D(*size, yaw=0.9, pitch=0.5).holding(points, margins, radius)
    k = np.arange(2000) + 0.5
    z, turn = 1 - k / 1000, np.pi * (1 + 5**0.5) * k
    ball = np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], axis=1)
    place, depth = camera.project((points[:, None] + radius * ball).reshape(-1, 3))
    left, bottom, right, top = margins
    slack = np.concatenate([place.min(axis=0) - (left, bottom), np.array(size) - (right, top) - place.max(axis=0)])
    apart = np.sqrt(4 * np.pi / 2000)  # rad: of neighbours on a spiral, and the cap between them is lower by that
    missed = radius * (1 - np.cos(apart)) * camera.focal / depth.min()  # pixels
    assert (slack > -1e-6).all() and ((slack[[0, 2]] < missed).all() or (slack[[1, 3]] < missed).all())
    few = camera.outermost(points, margins, radius)
    again = Camera3D(*size, yaw=0.9, pitch=0.5).holding(few, margins, radius)
    assert len(few) == 10
    np.testing.assert_allclose([*again.target, again.distance], [*camera.target, camera.distance], rtol=1e-9)
    assert abs(slack[0] - slack[2]) < 1 and abs(slack[1] - slack[3]) < 1  # left over evenly, to a pixel: balls count as
    assert slack.max() > 10  # large as they are seen at the margin


def test_a_picture_of_bodies_holds_where_they_will_land() -> None:
    """Above a plane the points below them on it, also on a slope, but none farther down than half the body set's extent; of a
    wall nothing, and of bodies that are nowhere nothing."""
    fallen = {"shape": {"name": "beam"}, "kind": "rigid_body", "particle_spacing": 0.2, "origin": [0.0, 0.4, 0.0]}
    method = {"solver": "shape-matching"}

    def landed(**plane: Any) -> np.ndarray:
        scene = Scene({"beam": fallen, "plane": plane, "method": method})
        position = scene.body_set.position
        found = seen_points(scene, position, 0.0)
        np.testing.assert_array_equal(found[: len(position)], position)
        return found[len(position) :]

    position = Scene({"beam": fallen, "method": method}).body_set.position
    level = landed()
    np.testing.assert_allclose(level, position * (1, 0, 1), atol=1e-15)
    slope = landed(normal=[1.0, 10.0, 0.0])
    np.testing.assert_allclose(slope[:, 0] + 10 * slope[:, 1], 0, atol=1e-14)
    np.testing.assert_array_equal(slope[:, [0, 2]], position[:, [0, 2]])
    assert len(landed(normal=[1.0, 0.0, 0.0])) == 0
    far = Scene({"beam": fallen, "method": method})
    np.testing.assert_allclose(landed(point=[0.0, -1e3, 0.0])[:, 1], position[:, 1].min() - far.grid.extent / 2)
    assert len(seen_points(far, np.full_like(position, np.nan), 0.0)) == 0


def test_a_single_mass_does_not_fill_the_window() -> None:
    camera = Camera3D(400, 300).framing((1, 1, 1, 1, 1, 1), (0, 0, 0, 0), 0.5)
    assert camera.scale * 0.5 < 300


def test_the_camera_glides_to_another_and_keeps_its_turn() -> None:
    camera, other = some_camera(), Camera3D(800, 600, 5.0, 0.0, -1.0, 1.5)
    camera.approach(other, 0.5)
    np.testing.assert_allclose(camera.target, (3.0, -1.0, -0.25))
    assert camera.distance == pytest.approx(3.0)  # half of the way in size: sqrt(6 * 1.5)
    assert camera.yaw == 0.7 and camera.pitch == -0.4


def test_arrow_keys_point_as_they_do_in_the_window() -> None:
    camera = some_camera()
    for columns, rows in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        step = camera.to_window(camera.target + 0.01 * np.array(camera.direction(columns, rows))) - (400, 300)
        np.testing.assert_allclose(step / np.hypot(*step), (columns, rows), atol=1e-9)


def test_picking_takes_the_nearest_in_the_window_and_the_front_of_two_layers() -> None:
    camera = Camera3D(800, 600, 0, 0, 0, 5.0, yaw=0.0, pitch=0.0)
    sheet = np.stack(np.meshgrid(np.linspace(-1, 1, 11), np.linspace(-1, 1, 11)), axis=-1).reshape(-1, 2)
    front = np.column_stack([sheet, np.full(121, 0.3)])
    back = np.column_stack([sheet, np.full(121, -0.3)])
    both = np.concatenate([back, front])
    both[5] = np.nan
    for particle in (121 + 60, 121 + 3, 121 + 117):
        x, y = camera.to_window(both[particle])
        assert pick(camera, both, x + 3, y - 2, 10) == particle
        x, y = camera.to_window(both[particle - 121])  # exactly over a mass of the hidden layer
        assert pick(camera, both, x, y, 40) >= 121
    assert pick(camera, both, 5, 5, 10) is None
    x, y = camera.to_window(back[60])
    assert pick(camera, back, x + 9, y, 10) == 60 and pick(camera, back, x + 11, y, 10) is None


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
