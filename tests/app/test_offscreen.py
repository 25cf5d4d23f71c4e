"""Pictures without a window: what is drawn, where, in which colour; files that are whole or not there."""

from __future__ import annotations

import json
import subprocess
import sys
from functools import cache

import numpy as np
import pytest

from softlab.app.output.offscreen import OffscreenRenderer, opengl_available
from softlab.app.render import colours, opengl
from softlab.model.base.errors import BackendUnavailable, InputError
from softlab.model.core.build import rest_positions
from softlab.model.scene.scene import Scene

SCENE = Scene({"grid": {"rows": 9, "columns": 9, "pinned": "top-corners"}, "springs": {}, "gravity": {}})
REST = rest_positions(SCENE.grid)


@cache
def available() -> tuple[bool, str]:
    return opengl_available()


@pytest.fixture(scope="module", autouse=True)
def drawing() -> None:
    works, text = available()
    if not works:
        pytest.skip(f"no off-screen OpenGL: {text}")


def near(image: np.ndarray, renderer: OffscreenRenderer, place: tuple[float, float], reach: int = 2) -> np.ndarray:
    """(pixels, 3) in 0 to 1 around a place [m]."""
    x, y = renderer.camera.to_window(np.array(place))
    row, column = round(renderer.height - 1 - y), round(x)
    part = image[row - reach : row + reach + 1, column - reach : column + reach + 1, :3]
    return part.reshape(-1, 3) / 255


def closest(pixels: np.ndarray, colour: object) -> float:
    """The smallest largest-channel distance of any of the pixels to a colour."""
    return float(np.abs(pixels - np.asarray(colour)).max(axis=1).min())


def test_the_renderer_says_its_name() -> None:
    works, name = available()
    assert works and name


def test_springs_have_the_colour_of_their_strain_and_lie_where_their_masses_are() -> None:
    position = REST.copy()
    position[:, 1] *= 1.4  # vertical springs stretched by 0.4, horizontal ones at rest
    with OffscreenRenderer(SCENE, 640, 480) as renderer:
        renderer.fit(position)
        renderer.draw(position)
        image = renderer.image()
        assert image.shape == (480, 640, 4) and image.dtype == np.uint8 and (image[:, :, 3] == 255).all()
        assert renderer.strain_range == pytest.approx(0.5)
        stretched = near(image, renderer, (3.0, -3.5 * 1.4))
        resting = near(image, renderer, (3.5, -3.0 * 1.4))
        gap = near(image, renderer, (3.5, -3.5 * 1.4))
        wanted = colours.strain_colours(np.array([0.4, 0.0]), 0.5)
        # the lines are blended over white at their edges; in the middle of one their own colour must be found
        assert closest(stretched, wanted[0]) < 0.04
        assert closest(resting, wanted[1]) < 0.04
        assert (gap > 0.99).all()
        position[:, 1] *= 0.6 / 1.4  # pressed by 0.4
        renderer.draw(position)
        pressed = near(renderer.image(), renderer, (3.0, -3.5 * 0.6))
        assert closest(pressed, colours.strain_colours(np.array([-0.4]), 0.5)[0]) < 0.04


def test_a_rest_length_of_zero_has_a_colour_too() -> None:
    scene = SCENE.replace({"springs.rest_length": 0.0})
    with OffscreenRenderer(scene, 640, 480) as renderer:
        renderer.fit(REST)
        renderer.draw(REST)
        assert renderer.strain_range == 1.0
        found = near(renderer.image(), renderer, (3.5, -3.0))
        assert closest(found, colours.strain_colours(np.array([1.0]), 1.0)[0]) < 0.04


def test_pinned_masses_are_marked() -> None:
    with OffscreenRenderer(SCENE, 320, 240) as renderer:  # small enough that masses are not drawn as points
        renderer.draw(REST)
        image = renderer.image()
        for place, pinned in (((0, 0), True), ((8, 0), True), ((8, -8), False), ((4, 0), False)):
            dark = (near(image, renderer, place).max(axis=1) < 0.2).mean()
            assert dark == pinned, place  # all of it, or nothing


def test_masses_become_points_when_seen_from_near() -> None:
    with OffscreenRenderer(SCENE, 320, 240) as renderer:
        renderer.camera.zoom(6.0, *renderer.camera.to_window(np.array([4.0, -4.0])))
        renderer.draw(REST)
        image = renderer.image()
        assert closest(near(image, renderer, (4, -4), 1), colours.INK) < 0.05
        assert closest(near(image, renderer, (4.5, -4), 1), colours.INK) > 0.3


def test_the_legend_and_caption_are_there_and_can_be_left_out() -> None:
    def corner(legend: bool) -> np.ndarray:
        with OffscreenRenderer(SCENE, 800, 600, legend=legend) as renderer:
            renderer.fit(REST)
            renderer.draw(REST)
            return renderer.image()[-90:, -320:, :3]

    red, blue = colours.STOPS[-1], colours.STOPS[0]
    with_legend, without = corner(True).reshape(-1, 3) / 255, corner(False).reshape(-1, 3) / 255
    assert closest(with_legend, red) < 0.05 and closest(with_legend, blue) < 0.05
    assert closest(without, red) > 0.2 and closest(without, blue) > 0.2


def test_two_renderers_do_not_disturb_each_other() -> None:
    other = Scene({"grid": {"rows": 3, "columns": 5}})
    with OffscreenRenderer(SCENE, 320, 240) as first, OffscreenRenderer(other, 200, 100) as second:
        first.draw(REST)
        alone = first.image()
        second.draw(rest_positions(other.grid))
        first.draw(REST)
        np.testing.assert_array_equal(first.image(), alone)
        assert second.image().shape == (100, 200, 4)
        assert (second.image() < 128).any()  # no springs: masses as points
    with OffscreenRenderer(SCENE, 320, 240) as again:
        again.draw(REST)
        np.testing.assert_array_equal(again.image(), alone)


def test_a_renderer_outlives_another() -> None:
    first, second = OffscreenRenderer(SCENE, 320, 240), OffscreenRenderer(SCENE, 320, 240)
    first.draw(REST)
    alone = first.image()
    first.close()
    first.close()
    second.draw(REST)
    np.testing.assert_array_equal(second.image(), alone)
    second.close()


def test_large_grids_are_drawn_with_plain_lines() -> None:
    scene = Scene({"grid": {"rows": 330, "columns": 330}, "springs": {}})
    with OffscreenRenderer(scene, 320, 240) as renderer:
        renderer.draw(rest_positions(scene.grid).astype(np.float32))
        assert (renderer.image()[:, :, :3].min(axis=2) < 200).mean() > 0.1


def test_bad_shapes_and_sizes_are_refused() -> None:
    with OffscreenRenderer(SCENE, 64, 64) as renderer, pytest.raises(InputError, match=r"\(81, 2\)"):
        renderer.draw(REST[:-1])
    for size in ((0, 64), (64, 100_000)):
        with pytest.raises(InputError, match="pixels"):
            OffscreenRenderer(SCENE, *size)


def test_one_mass_and_diverged_positions_can_be_drawn() -> None:
    scene = Scene({"grid": {"rows": 1, "columns": 1, "pinned": "top"}})
    with OffscreenRenderer(scene, 200, 150) as renderer:
        renderer.fit(np.zeros((1, 2)))
        renderer.draw(np.zeros((1, 2)))
        assert closest(near(renderer.image(), renderer, (0, 0)), colours.PIN) < 0.05
        renderer.fit(np.full((1, 2), np.nan))
        renderer.draw(np.full((1, 2), 1e300))


def test_a_window_cannot_open_in_a_process_that_draws_without_one() -> None:
    with OffscreenRenderer(SCENE, 64, 64), pytest.raises(BackendUnavailable, match="fresh Python process"):
        opengl.load_pyglet(False)


@pytest.mark.parametrize(
    ("broken", "words"),
    [
        ("pyglet.window", 'Library "EGL" not found.'),
        ("pyglet.gl", 'Library "GL" not found.'),
        ("pyglet.text", 'Library "fontconfig" not found.'),
    ],
)
def test_missing_libraries_are_named_with_a_remedy(broken: str, words: str) -> None:
    code = f"""
import importlib.abc, json, sys
class Missing(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name == {broken!r}:
            raise ImportError({words!r})
sys.meta_path.insert(0, Missing())
from softlab.app.output.offscreen import OffscreenRenderer
from softlab.model.base.errors import BackendUnavailable
from softlab.model.scene.scene import Scene
said = []
for _ in range(2):
    try:
        OffscreenRenderer(Scene({{"grid": {{"rows": 2, "columns": 2}}, "springs": {{}}}}), 64, 64)
    except BackendUnavailable as error:
        said.append(str(error))
print(json.dumps(said))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout.splitlines()[-1])
    assert len(said) == 2 and all(words in text and "apt-get install libegl1" in text for text in said)
