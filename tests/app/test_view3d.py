"""The drawing in space: what a picture of a cloth shows, the demo of a cloth, and its window on a virtual screen."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_cloth import FakeCloth
from real_window import StillWindow, display, needs_display  # noqa: F401  # a fixture, and the window of another demo

from softlab.app.output.offscreen import OffscreenRenderer, opengl_available, render_frame
from softlab.app.output.video import Picture, render
from softlab.app.render import colours
from softlab.app.render.collider_shapes import grounds, shadow_matrix
from softlab.app.render.scenery import KEY
from softlab.app.render.sheet_view import heavy_masses
from softlab.model.base.errors import InputError
from softlab.model.core.build import rest_positions
from softlab.model.scene.scene import Scene, load_scene

HANGING: dict[str, Any] = {
    "cloth": {"rows": 7, "columns": 9, "spacing": 0.25, "pinned": "top-corners"},
    "structural": {},
    "shear": {},
    "gravity": {"enabled": False},
    "method": {"dt": 0.001},
}
SCENE = Scene(HANGING)
FLAT = Scene(HANGING | {"cloth": HANGING["cloth"] | {"placement": "flat"}})
REST = rest_positions(SCENE.grid)
RANDOM = np.random.default_rng(5)


# ---------------------------------------------------------------------- pictures


@cache
def available() -> tuple[bool, str]:
    return opengl_available()


@pytest.fixture
def drawing() -> None:
    works, text = available()
    if not works:
        pytest.skip(f"no off-screen OpenGL: {text}")


def near(image: np.ndarray, renderer: OffscreenRenderer, place: Any, reach: int = 1) -> np.ndarray:
    """(pixels, 3) in 0 to 1 around a place [m]."""
    x, y = renderer.camera.to_window(np.asarray(place, dtype=float))
    row, column = round(renderer.height - 1 - y), round(x)
    return image[row - reach : row + reach + 1, column - reach : column + reach + 1, :3].reshape(-1, 3) / 255


def hue(pixels: np.ndarray) -> np.ndarray:
    """(3,) mean colour without its lightness: what light of one colour leaves as it was."""
    mean = pixels.mean(axis=0)
    return mean / mean.sum()


def looks_like(pixels: np.ndarray, colour: Any) -> bool:
    """Same hue as a surface's colour; the highlight adds at most 0.06 of white, 0.03 of the sum of a middle tone."""
    return bool(np.abs(hue(pixels) - np.array(colour) / np.sum(colour)).max() < 0.03)


@pytest.mark.usefixtures("drawing")
def test_front_and_back_have_their_own_colours() -> None:
    middle = REST.mean(axis=0)
    with OffscreenRenderer(SCENE, 480, 360, legend=False) as renderer:
        for yaw, seen, hidden in ((0.2, colours.CLOTH_FRONT, colours.CLOTH_BACK),
                                  (0.2 + np.pi, colours.CLOTH_BACK, colours.CLOTH_FRONT)):  # fmt: skip
            renderer.camera.yaw = yaw
            renderer.fit(REST)
            renderer.draw(REST)
            pixels = near(renderer.image(), renderer, middle)
            assert looks_like(pixels, seen) and not looks_like(pixels, hidden)


@pytest.mark.usefixtures("drawing")
def test_light_comes_from_above() -> None:
    """A cloth bent over an edge along x: the half that faces up is lighter than the half that faces down."""
    position = REST.copy()
    upper, lower = REST[:, 1] > -0.7, REST[:, 1] < -0.8
    position[:, 2] = np.where(upper, -REST[:, 1], 1.5 + REST[:, 1])
    with OffscreenRenderer(SCENE, 480, 360, legend=False) as renderer:
        renderer.camera.yaw = renderer.camera.pitch = 0.0
        renderer.fit(position)
        renderer.draw(position)
        image = renderer.image()
        up = near(image, renderer, position[upper].mean(axis=0)).mean()
        down = near(image, renderer, position[lower].mean(axis=0)).mean()
    assert up > 1.3 * down > 0.2


@pytest.mark.usefixtures("drawing")
def test_springs_have_the_colour_of_their_strain() -> None:
    position = REST * (1.0, 1.4, 1.0)  # vertical springs stretched by 0.4
    with OffscreenRenderer(SCENE, 640, 480, lines=True) as renderer:
        renderer.fit(position)
        assert renderer.strain_range == pytest.approx(0.5)
        renderer.draw(position)
        image = renderer.image()
        for first, second, strain in ((30, 39, 0.4), (30, 31, 0.0)):
            pixels = near(image, renderer, (position[first] + position[second]) / 2)
            wanted = colours.strain_colours(np.array([strain]), 0.5)[0]
            assert np.abs(pixels - wanted).max(axis=1).min() < 0.04
        legend = image[-90:, -320:, :3].reshape(-1, 3) / 255
        assert np.abs(legend - colours.STOPS[-1]).max(axis=1).min() < 0.05


@pytest.mark.usefixtures("drawing")
def test_pins_are_marked_and_a_selected_mass_has_a_ring() -> None:
    with OffscreenRenderer(SCENE, 480, 360, legend=False) as renderer:
        renderer.draw(REST)
        image = renderer.image()
        for corner in (0, 8):
            assert near(image, renderer, REST[corner]).max() < 0.2
        assert near(image, renderer, REST[-1]).mean() > 0.2
        renderer._view.draw(renderer.camera, 0.5, selected=31)
        ring = near(renderer.image(), renderer, REST[31], 11)
        assert np.abs(ring - colours.SELECTED).max(axis=1).min() < 0.05
        assert np.abs(near(image, renderer, REST[31], 11) - colours.SELECTED).max(axis=1).min() > 0.2


@pytest.mark.usefixtures("drawing")
def test_heavy_masses_are_as_wide_as_balls_of_the_same_stuff() -> None:
    """The diameter of a ball goes with the cube root of its mass; a light one is drawn as the others are."""
    rope = load_scene("rope-stiff")
    ((index, wide),) = heavy_masses(rope)
    assert index.tolist() == [64] and wide**3 == pytest.approx(rope.loads["end"].mass / rope.grid.mass)
    light = Scene(
        {
            "cloth": {"rows": 1, "columns": 3, "mass": 1.0},
            "load": {"at": [0, 1], "mass": 0.5},
            "structural": {},
            "method": {"solver": "xpbd"},
        }
    )
    assert not heavy_masses(light)


def test_colliders_hide_what_is_behind_and_move_with_time() -> None:
    ball = {"sphere": {"center": [1.0, -0.7, 0.8], "radius": 0.3, "velocity": [0.0, 0.0, -1.6]}}
    with OffscreenRenderer(Scene(HANGING | ball), 480, 360, legend=False) as renderer:
        renderer.camera.yaw = renderer.camera.pitch = 0.0
        renderer.fit(REST)
        renderer.draw(REST)
        assert looks_like(near(renderer.image(), renderer, (1.0, -0.7, 1.1)), colours.COLLIDER)
        renderer.draw(REST, time=1.0)  # now behind the cloth
        assert looks_like(near(renderer.image(), renderer, (1.0, -0.7, 0.0)), colours.CLOTH_FRONT)


@pytest.mark.usefixtures("drawing")
@pytest.mark.parametrize(
    "collider",
    [
        {"capsule": {"start": [0.3, -0.7, 0.6], "end": [1.7, -0.7, 0.6], "radius": 0.2}},
        {"box": {"center": [1.0, -0.7, 0.6], "half_size": [0.4, 0.3, 0.1]}},
    ],
)
def test_capsules_and_boxes_are_drawn(collider: dict[str, Any]) -> None:
    with OffscreenRenderer(Scene(HANGING | collider), 320, 240, legend=False) as renderer:
        renderer.camera.yaw = renderer.camera.pitch = 0.0
        renderer.fit(REST)
        renderer.draw(REST)
        assert looks_like(near(renderer.image(), renderer, (1.0, -0.7, 0.7)), colours.COLLIDER)


@pytest.mark.usefixtures("drawing")
def test_there_is_a_ground_with_lines_and_a_shadow_on_it() -> None:
    position = rest_positions(FLAT.grid)
    scene = Scene(FLAT.as_dict() | {"plane": {"point": [0.0, -0.5, 0.0]}})
    with OffscreenRenderer(scene, 640, 480, legend=False) as renderer:
        renderer.fit(position)
        renderer.camera.distance *= 1.6
        renderer.draw(position)
        image = renderer.image()
        (ground,) = grounds(scene, 0.0, 0.0)
        under = (np.append(position.mean(axis=0), 1) @ shadow_matrix(ground, KEY).T)[:3]
        corner = (np.append(position[-1], 1) @ shadow_matrix(ground, KEY).T)[:3]
        inside = corner + 0.03 * (under - corner)  # just within the corner that the cloth does not hide
        outside = corner - 0.25 * (under - corner)
        dark, light = (near(image, renderer, place, 2).max(axis=0).mean() for place in (inside, outside))
        assert dark < 0.93 < light < 0.98  # shadow, ground; the background is white
        camera = renderer.camera
    way = (under - corner) * (1, 0, 1)
    wall = {"kind": "plane", "normal": way.tolist(), "point": (corner - 0.1 * way).tolist()}
    with OffscreenRenderer(Scene(scene.as_dict() | {"wall": wall}), 640, 480, legend=False) as walled:
        walled.camera = camera
        walled.draw(position)
        ended = [near(walled.image(), walled, place, 2).max(axis=0).mean() for place in (inside, outside)]
        assert ended == pytest.approx([dark, 1.0], abs=0.01)  # behind the wall there is no floor
    with OffscreenRenderer(scene, 640, 480, legend=False) as renderer:
        renderer.camera = camera
        renderer.camera.pitch = -0.3  # from below: seen through
        renderer.draw(position)
        below = near(renderer.image(), renderer, position.mean(axis=0), 8)
        assert looks_like(np.median(below, axis=0)[None], colours.CLOTH_BACK)  # of most pixels: between the lines


@pytest.mark.usefixtures("drawing")
def test_pictures_have_eight_bits_a_colour_and_smooth_edges() -> None:
    with OffscreenRenderer(SCENE, 320, 240, legend=False) as renderer:
        renderer.camera.pitch = 0.0
        edge = REST[[0, 6 * 9]].mean(axis=0)  # the left one: upright, and moved into the middle of a pixel
        left, _ = renderer.camera.to_window(edge)
        renderer.camera.pan(np.floor(left) + 0.5 - left, 0.0)
        renderer.draw(REST)
        image = renderer.image()
        assert np.unique(image[:, :, :3].reshape(-1, 3), axis=0).shape[0] > 150
        x, y = renderer.camera.to_window(edge)
        row = image[239 - round(y), round(x) - 4 : round(x) + 5, 0].astype(int)
        between = (row > row.min() + 12) & (row < row.max() - 12)
        assert renderer._view._target.samples < 2 or between.any()


@pytest.mark.usefixtures("drawing")
def test_bad_shapes_are_refused_and_diverged_states_drawn() -> None:
    with OffscreenRenderer(SCENE, 160, 120) as renderer:
        with pytest.raises(InputError, match=r"\(63, 3\)"):
            renderer.draw(REST[:, :2])
        renderer.fit(np.full((63, 3), np.nan))
        renderer.draw(np.full((63, 3), 1e300))
        renderer.draw(REST)
        assert np.isfinite(renderer.camera.matrix()).all()


@pytest.mark.usefixtures("drawing")
@pytest.mark.parametrize("cloth", [{"rows": 1, "columns": 1}, {"rows": 1, "columns": 6}, {"rows": 2, "columns": 2}])
def test_small_cloths_can_be_drawn(cloth: dict[str, int]) -> None:
    for parts in ({}, {"bending": {}}, {"structural": {}, "shear": {}}):
        scene = Scene({"cloth": cloth} | parts)
        with OffscreenRenderer(scene, 160, 120, legend=False) as renderer:
            renderer.draw(rest_positions(scene.grid))
            x, y = renderer.camera.to_window(rest_positions(scene.grid)[0])
            assert renderer.image()[119 - round(y) - 2 :, round(x) - 3 : round(x) + 4][:5, :, :3].min() < 200


@pytest.mark.usefixtures("drawing")
def test_a_simulation_is_drawn_as_its_state_is_and_normals_only_where_they_are_seen() -> None:
    simulation = FakeCloth(SCENE)
    moved = (REST + RANDOM.normal(0, 0.02, REST.shape)).astype(np.float32)  # as it is read: normals of the same numbers
    simulation._position = moved.astype(np.float64)
    with OffscreenRenderer(SCENE, 320, 240, legend=False) as renderer:
        renderer.draw(simulation.read("position"))
        by_state = renderer.image()
        simulation.asked.clear()
        renderer._view.upload_from(simulation)
        assert simulation.asked == ["position", "normal"]
        renderer._view.draw(renderer.camera, 0.5)
        np.testing.assert_array_equal(renderer.image(), by_state)
        simulation.asked.clear()
        assert renderer._view.toggle_lines()
        renderer._view.upload_from(simulation)
        assert simulation.asked == ["position"]
        renderer._view.upload_from(simulation, simulation._position.astype(np.float32))
        assert simulation.asked == ["position"]  # what was read already is not read again


@pytest.mark.usefixtures("drawing")
def test_frames_and_clips_of_a_cloth(tmp_path: Path) -> None:
    import imageio_ffmpeg
    from PIL import Image

    tables = HANGING | {"gravity": {}, "sphere": {"center": [1.0, -2.0, 0.0], "radius": 0.3, "velocity": [0, 3.0, 0]}}
    simulation = FakeCloth(Scene(tables))
    frame = render(simulation, tmp_path / "frame.png", picture=Picture(320, 240))
    assert np.asarray(Image.open(frame)).shape == (240, 320, 3)
    clip = render(simulation, tmp_path / "clip.mp4", steps=30, steps_per_frame=10, picture=Picture(160, 120))
    assert imageio_ffmpeg.count_frames_and_secs(clip)[0] == 4
    assert simulation.asked.count("normal") == 4
    assert render_frame(
        simulation.scene, REST, tmp_path / "lines.png", Picture(160, 120), lines=True, time=0.2
    ).exists()
    states = np.stack([REST, 1.1 * REST])
    assert render(states, tmp_path / "states.mp4", scene=SCENE, picture=Picture(160, 120)).exists()
