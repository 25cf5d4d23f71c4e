"""Fluids as they are shown: a surface, particles, colours and their legend, in space and in a plane."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from test_view3d import drawing  # noqa: F401  # a fixture

from app.output.offscreen import OffscreenRenderer, check_look
from app.render import colours
from app.render.fluid.outlines import SIDES, outlines
from app.render.fluid.view import COLOURINGS, LOOKS
from app.render.particle_colours import of_numbers
from app.window.controls import FLUID_KEYS, keys_text
from model.core.errors import InputError
from model.fluid.measure import density_errors
from model.scene.scene import Scene

pytestmark = pytest.mark.usefixtures("drawing")
METHOD = {"solver": "pbf", "dt": 0.01, "substeps": 2, "iterations": 2}


def water(**fields: Any) -> Scene:
    table = {"kind": "fluid", "size": [0.4, 0.4, 0.4], "rest_distance": 0.1} | fields
    return Scene({"water": table, "method": METHOD, "gravity": {}})


FLAT = {"dimensions": 2, "size": [0.4, 0.4], "rest_distance": 0.1}


def picture(scene: Scene, look: tuple[str, ...], position: np.ndarray | None = None) -> np.ndarray:
    """(240, 320, 3) in 0 to 1."""
    with OffscreenRenderer(scene, 320, 240, legend=False, look=look) as renderer:
        position = scene.fluid_set.position if position is None else position
        renderer.fit(position)
        renderer.draw(position)
        return np.asarray(renderer.image()[..., :3] / 255)


@pytest.mark.parametrize("fields", [{}, FLAT], ids=["space", "plane"])
def test_a_fluid_is_seen(fields: dict[str, Any]) -> None:
    """Blue in the middle, nothing in the corners; as particles there are gaps between them."""
    scene = water(**fields)
    image = picture(scene, ())
    middle = image[100:140, 140:180].reshape(-1, 3).mean(axis=0)
    assert middle[2] > middle[0] + 0.15
    if scene.dimensions == 3:  # a plane's is the same as its particles
        particles = picture(scene, ("particles",))
        assert np.abs(image - particles).mean() > 0.005
        sharp = [np.abs(np.diff(one[100:140, 140:180], axis=1)).mean() for one in (image, particles)]
        assert sharp[0] < sharp[1] / 3
    else:
        colour = of_numbers(np.array([1]))[0]
        np.testing.assert_allclose(
            image[np.abs(image - colour).sum(axis=-1).argmin() // 320].min(axis=0), colour, atol=0.01
        )


def test_compressed_particles_are_told_apart() -> None:
    """The colours are of `density_errors`, whose largest is that of the legend's range."""
    scene = water(**FLAT)
    position = scene.fluid_set.position * (0.8, 1.0)
    level = np.maximum(density_errors(scene, position), 0)
    with OffscreenRenderer(scene, 320, 240, legend=False, look=("density",)) as renderer:
        renderer.fit(position)
        renderer.draw(position)
        title, most = renderer._view.level_legend()
        image, camera = renderer.image()[..., :3] / 255, renderer.camera
        places = camera.to_window(position)
    assert "%" in title and level.max() <= most / 100 < 5 * level.max()
    for (x, y), colour in zip(places, colours.level_colours(level, most / 100), strict=True):
        np.testing.assert_allclose(image[int(240 - y), int(x)], colour, atol=0.02)


def test_looks_that_are_none_are_refused() -> None:
    for name in LOOKS:
        check_look(water(), (name,))
    with pytest.raises(InputError, match="surface"):
        check_look(water(), ("stress",))
    with pytest.raises(InputError, match="fluids"):
        check_look(Scene({"grid": {"rows": 2, "columns": 2}}), ("surface",))


def test_keys_of_fluids() -> None:
    text = keys_text(1200, "fluid", True)
    assert all(meaning in text for _, meaning in FLUID_KEYS) and all(name in text for name in COLOURINGS)
    assert "turn" not in keys_text(1200, "fluid", False)


def test_colliders_of_a_plane_are_outlined_where_they_are() -> None:
    """Ends of lines lie on the surfaces: of a half-plane, a circle, a rod, a block that has moved."""
    rod = {"kind": "capsule", "start": [0.0, 0.0, 0.0], "end": [1.0, 1.0, 0.0], "radius": 0.2}
    block = {"kind": "box", "center": [1.0, 2.0, 0.0], "half_size": [0.5, 0.3, 0.1], "velocity": [1.0, 0.0, 0.0]}
    shapes = {
        "floor": {"kind": "plane", "point": [0.0, -1.0, 0.0], "normal": [0.6, 0.8, 0.0]},
        "ball": {"kind": "sphere", "center": [5.0, 0.0, 0.3], "radius": 0.5}, "rod": rod, "block": block,
    }  # fmt: skip
    scene = Scene({"water": {"kind": "fluid"} | FLAT, "method": METHOD} | shapes)
    lines = outlines(scene, 2.0).reshape(-1, 2, 2)
    ends = lines.reshape(-1, 2).astype(np.float64)
    floor, ball = ends[:2], ends[2 : 2 + 2 * SIDES]
    np.testing.assert_allclose((floor - (0, -1)) @ (0.6, 0.8), 0, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(ball - (5, 0), axis=1), 0.4, atol=1e-6)
    rest = ends[2 + 2 * SIDES :]
    along = np.clip(rest[:-8] @ (0.5, 0.5), 0, 1)
    np.testing.assert_allclose(np.linalg.norm(rest[:-8] - along[:, None], axis=1), 0.2, atol=1e-6)
    assert set(map(tuple, rest[-8:].round(6))) == {(2.5, 1.7), (3.5, 1.7), (3.5, 2.3), (2.5, 2.3)}
