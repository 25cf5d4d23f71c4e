"""Drawing in space without OpenGL: camera and picking, a cloth's triangles and normals, the shapes of colliders."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from softlab.app.render.camera import pick
from softlab.app.render.camera3d import MAX_PITCH, Camera3D
from softlab.app.render.framing import seen_points
from softlab.model.scene.scene import Scene

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
