"""Fluids as they are shown: a surface, particles, colours and their legend, in space and in a plane."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from test_view3d import drawing  # noqa: F401  # a fixture

from softlab.app.output.offscreen import OffscreenRenderer
from softlab.app.render import colours
from softlab.app.render.fluid.framing import main_part, with_fluids
from softlab.app.render.fluid.outlines import SIDES, outlines, sections, triangles
from softlab.app.render.fluid.view import COLOURINGS, VIEW_OPTIONS
from softlab.app.render.framing import seen_points
from softlab.app.render.particle_colours import of_numbers
from softlab.app.render.views import check_view_options
from softlab.app.window.keys import keys_of, keys_text
from softlab.model.base.errors import InputError
from softlab.model.fluid.foam import FOAM, FoamPoints
from softlab.model.fluid.measure import density_errors
from softlab.model.scene.scene import Scene
from softlab.model.tables.fluid import Foam

pytestmark = pytest.mark.usefixtures("drawing")
METHOD = {"solver": "pbf", "dt": 0.01, "substeps": 2, "iterations": 2}


def water(**fields: Any) -> Scene:
    table = {"kind": "fluid", "size": [0.4, 0.4, 0.4], "rest_distance": 0.1} | fields
    return Scene({"water": table, "method": METHOD, "gravity": {}})


FLAT = {"dimensions": 2, "size": [0.4, 0.4], "rest_distance": 0.1}


def picture(scene: Scene, look: tuple[str, ...], position: np.ndarray | None = None) -> np.ndarray:
    """(240, 320, 3) in 0 to 1."""
    with OffscreenRenderer(scene, 320, 240, legend=False, view_options=look) as renderer:
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


def test_the_surface_of_a_fluid_in_a_plane() -> None:
    """It is level within 0.12 rest distances (RMS) over particles up to a quarter out of place, where discs leave bumps;
    it ends at the floor; a drop keeps its area; a gap of three rest distances stays open."""
    size, spacing = [3.0, 0.6], 0.1
    table = {"kind": "fluid"} | FLAT | {"size": size}
    scene = Scene({"water": table, "method": METHOD, "floor": {"kind": "plane", "thickness": 0.0}})
    position = scene.fluid_set.position.copy()
    position += np.random.default_rng(2).uniform(-0.25 * spacing, 0.25 * spacing, position.shape)
    position = position[np.abs(position[:, 0] - 2.5) > 1.5 * spacing]  # a gap
    drop = np.array([1.0, 1.0])
    position = np.concatenate([position, np.tile(drop, (scene.grid.particle_count - len(position), 1))])
    kept = np.unique(position, axis=0, return_index=True)[1]
    position[np.setdiff1d(np.arange(len(position)), kept)] = -(2.0**20)  # the drop is one particle
    colour, cover, deviation = of_numbers(np.array([1]))[0], {}, {}
    for look in ("surface", "particles"):
        with OffscreenRenderer(scene, 640, 320, legend=False, view_options=(look,)) as renderer:
            renderer.fit(position)
            renderer.draw(position)
            scale, places = renderer.camera.scale, renderer.camera.to_window(np.array([[0.0, 0.0], [2.5, 0.3], drop]))
            cover[look] = (1 - renderer.image()[..., 0] / 255) / (1 - colour[0])
        floor = round(320 - places[0, 1])
        pool = cover[look][floor - int(0.8 * scale) : floor, int(places[0, 0] + 0.3 * scale) :][:, : int(1.9 * scale)]
        top = np.argmax(pool > 0.5, axis=0)
        deviation[look] = top.std() / (spacing * scale)
    gap, (x, y) = places[1], places[2]
    assert deviation["surface"] < 0.12 < deviation["particles"], deviation
    surface = cover["surface"]
    assert not surface[floor + 2 :].any() and surface[floor - 4, 200] > 0.9
    assert not surface[int(320 - gap[1]), int(gap[0])]
    half = int(0.2 * scale)
    area = surface[int(320 - y) - half : int(320 - y) + half, int(x) - half : int(x) + half].sum()
    assert area == pytest.approx((spacing * scale) ** 2, rel=0.15)


def test_compressed_particles_are_told_apart() -> None:
    """The colours are of `density_errors`, whose largest is that of the legend's range."""
    scene = water(**FLAT)
    position = scene.fluid_set.position * (0.8, 1.0)
    level = np.maximum(density_errors(scene, position), 0)
    with OffscreenRenderer(scene, 320, 240, legend=False, view_options=("density",)) as renderer:
        renderer.fit(position)
        renderer.draw(position)
        title, most = renderer._view.level_legend()
        image, camera = renderer.image()[..., :3] / 255, renderer.camera
        places = camera.to_window(position)
    assert "%" in title and level.max() <= most / 100 < 5 * level.max()
    for (x, y), colour in zip(places, colours.level_colours(level, most / 100), strict=True):
        np.testing.assert_allclose(image[int(240 - y), int(x)], colour, atol=0.02)


def test_looks_that_are_none_are_refused() -> None:
    for name in VIEW_OPTIONS:
        check_view_options(water(), (name,))
    with pytest.raises(InputError, match="surface"):
        check_view_options(water(), ("stress",))
    with pytest.raises(InputError, match="fluids"):
        check_view_options(Scene({"grid": {"rows": 2, "columns": 2}}), ("surface",))


def test_keys_of_fluids() -> None:
    text = keys_text(1200, "fluid", True)
    assert all(meaning in text for _, meaning in keys_of("fluid", True)) and all(name in text for name in COLOURINGS)
    assert "rotate" not in keys_text(1200, "fluid", False)


def test_colliders_of_a_plane_are_outlined_where_they_are() -> None:
    """Ends of lines lie on the surfaces: of a half-plane, a circle, a rod, a block that has moved. Areas are theirs."""
    rod = {"kind": "capsule", "start": [0.0, 0.0, 0.0], "end": [1.0, 1.0, 0.0], "radius": 0.2}
    block = {"kind": "box", "center": [1.0, 2.0, 0.0], "half_size": [0.5, 0.3, 0.1], "velocity": [1.0, 0.0, 0.0]}
    shapes = {
        "floor": {"kind": "plane", "point": [0.0, -1.0, 0.0], "normal": [0.6, 0.8, 0.0]},
        "ball": {"kind": "sphere", "center": [5.0, 0.0, 0.3], "radius": 0.5}, "rod": rod, "block": block,
    }  # fmt: skip
    scene = Scene({"water": {"kind": "fluid"} | FLAT, "method": METHOD} | shapes)
    shown = sections(scene, 2.0)
    ends = outlines(shown).astype(np.float64)
    floor, ball = ends[:2], ends[8 : 8 + 2 * SIDES]
    np.testing.assert_allclose((floor - (0, -1)) @ (0.6, 0.8), 0, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(ball - (5, 0), axis=1), 0.4, atol=1e-6)
    rest = ends[8 + 2 * SIDES :]
    along = np.clip(rest[:-8] @ (0.5, 0.5), 0, 1)
    np.testing.assert_allclose(np.linalg.norm(rest[:-8] - along[:, None], axis=1), 0.2, atol=1e-6)
    assert set(map(tuple, rest[-8:].round(6))) == {(2.5, 1.7), (3.5, 1.7), (3.5, 2.3), (2.5, 2.3)}
    below = triangles(shown[:1]).astype(np.float64) @ (0.6, 0.8) + 0.8
    assert below.max() < 1e-4 and below.min() < -scene.grid.extent, "of the half-plane what lies behind its surface"
    for polygon, area in ((shown[1], np.pi * 0.4**2), (shown[2], np.pi * 0.2**2 + 0.4 * 2**0.5), (shown[3], 0.6)):
        corner, other, third = np.moveaxis(triangles([polygon]).reshape(-1, 3, 2).astype(np.float64), 1, 0)
        (ax, ay), (bx, by) = (other - corner).T, (third - corner).T
        assert np.abs(ax * by - ay * bx).sum() / 2 == pytest.approx(area, rel=2e-3)


@pytest.mark.parametrize("fields", [{}, FLAT], ids=["space", "plane"])
def test_foam_is_drawn_over_the_fluid_and_dimmed_within_it(fields: dict[str, Any]) -> None:
    """A point before the fluid changes the pixel it is at most, one behind the surface less, one behind the whole of it
    hardly; none, nothing."""
    scene = water(**fields)
    middle = scene.fluid_set.position.mean(axis=0) if scene.dimensions == 3 else scene.fluid_set.position[5]
    pictures = []
    with OffscreenRenderer(scene, 320, 240, legend=False, view_options=("foam",)) as renderer:
        position, points = scene.fluid_set.position, FoamPoints(scene, Foam())
        renderer.show_foam(points)
        renderer.fit(position)
        toward = renderer.camera.axes[2] if scene.dimensions == 3 else np.zeros(2)
        for depth in (None, 0.5, 0.0, -0.5):
            if depth is not None:
                points.position, points.kind = (middle + depth * toward)[None], np.array([FOAM], np.int8)
            renderer.draw(position)
            pictures.append(renderer.image()[..., :3].astype(float))
        place = renderer.camera.to_window(middle)
    x, y = int(place[0]), int(240 - place[1])
    changed = [np.abs(image - pictures[0])[y - 3 : y + 4, x - 3 : x + 4].max() for image in pictures[1:]]
    if scene.dimensions == 3:
        assert changed[0] > 100 and changed[0] > 2 * changed[1] > 4 * changed[2]
    else:
        assert min(changed) > 100


def test_speeds_are_seen_in_pictures_of_a_run() -> None:
    """What no simulation holds is coloured by speed where the velocities come with it."""
    scene = water(**FLAT)
    position = scene.fluid_set.position
    velocity = np.zeros_like(position)
    velocity[:, 0] = np.linspace(0, 2, len(position))
    with OffscreenRenderer(scene, 320, 240, legend=False, view_options=("speed",)) as renderer:
        renderer.fit(position)
        renderer.draw(position, velocity=velocity)
        title, most = renderer._view.level_legend()
        image, places = renderer.image()[..., :3] / 255, renderer.camera.to_window(position)
    assert "m/s" in title and most == 2
    for (x, y), colour in zip(places, colours.level_colours(velocity[:, 0], most), strict=True):
        np.testing.assert_allclose(image[int(240 - y), int(x)], colour, atol=0.02)


def test_several_fluids_have_a_legend_of_names_and_water_is_blue() -> None:
    oil = {"kind": "fluid", "density": 600.0, "origin": [0.0, 1.0]} | FLAT
    scene = Scene({"oil": oil, "water": {"kind": "fluid"} | FLAT, "method": METHOD})
    with OffscreenRenderer(scene, 320, 240) as renderer:
        names = dict(renderer._view.name_legend())
        renderer.fit(scene.fluid_set.position)
        renderer.draw(scene.fluid_set.position)
        image = renderer.image()[..., :3] / 255
        places = renderer.camera.to_window(scene.fluid_set.position)
    assert list(names) == ["oil", "water"]
    for name, (x, y) in (("oil", places[0]), ("water", places[-1])):
        np.testing.assert_allclose(image[int(240 - y), int(x)], names[name], atol=0.02)
        chip = np.abs(image[160:, 200:] - names[name]).max(axis=-1) < 0.02
        assert 60 <= chip.sum() <= 144, "its chip, ten pixels wide"
    assert names["water"][2] > names["water"][0] and names["oil"][0] > names["oil"][2]


def test_a_few_drops_that_fly_far_are_out_of_sight_and_the_tank_is_in_sight() -> None:
    walls = {
        "floor": {"kind": "plane", "point": [0.0, -0.3, 0.0]},
        "right": {"kind": "plane", "point": [0.9, 0.0, 0.0], "normal": [-1.0, 0.0, 0.0]},
        "roof": {"kind": "plane", "point": [0.0, 0.5, 0.0], "normal": [0.0, -1.0, 0.0]},
        "far": {"kind": "plane", "point": [-5.0, 0.0, 0.0], "normal": [1.0, 0.0, 0.0]},
    }
    scene = Scene(
        {"water": {"kind": "fluid"} | FLAT | {"size": [0.4, 0.4], "rest_distance": 0.02}, "method": METHOD} | walls
    )
    position = scene.fluid_set.position.copy()
    position[7] = 50.0
    kept = main_part(scene, position)
    assert len(kept) == len(position) - 1 and kept.max() < 1
    (left, bottom), (right, top) = seen_points(scene, position, 0.0)
    assert (left, bottom, right) == pytest.approx((0.01, -0.3, 0.9)) and top == pytest.approx(0.39)


def test_a_splash_stays_in_sight() -> None:
    """One particle in fifty, three quarters of the fluid's own height above it."""
    scene = Scene({"water": {"kind": "fluid"} | FLAT | {"size": [0.4, 0.4], "rest_distance": 0.02}, "method": METHOD})
    position = scene.fluid_set.position.copy()
    position[::50, 1] = 0.69
    assert len(main_part(scene, position)) == len(position)
    assert seen_points(scene, position, 0.0)[:, 1].max() == pytest.approx(0.69)


def test_a_legend_that_is_to_come_has_its_place_from_the_first_picture_on() -> None:
    """The fluid lies above it."""
    scene = water(**FLAT)
    position = scene.fluid_set.position
    with OffscreenRenderer(scene, 640, 480, view_options=("density",)) as renderer:
        renderer.fit(position)
        renderer.draw(position)
        assert renderer.camera.to_window(position)[:, 1].min() > 100
    with OffscreenRenderer(scene, 640, 480) as renderer:
        renderer.fit(position)
        assert renderer.camera.to_window(position)[:, 1].min() < 100


def test_what_is_nowhere_is_neither_framed_nor_foams() -> None:
    """Particles that wait for an emitter are told to be a thousand kilometres away."""
    scene = water(**FLAT)
    position = scene.fluid_set.position.copy()
    position[3:] = -(2.0**20)
    assert len(main_part(scene, position)) == 3 and len(main_part(scene, position[3:])) == 0
    assert np.abs(seen_points(scene, position, 0.0)).max() < 1
    assert len(seen_points(scene, position[3:], 0.0)) == 0
    velocity = np.zeros_like(position)
    velocity[:3, 0] = 1, -1, 1
    some, all_of_them = FoamPoints(scene, Foam(speed=0.5, rate=500.0)), FoamPoints(scene, Foam(speed=0.5, rate=500.0))
    for step in range(3):
        some.follow(position[:3], velocity[:3], step / 60)
        all_of_them.follow(position, velocity, step / 60)
    assert len(some) and some.position.tobytes() == all_of_them.position.tobytes()


def test_a_fluid_in_a_world_is_drawn_into_the_worlds_picture() -> None:
    """Its surface, and its foam, before what is white; drops of it that fly off are out of the frame there, too."""
    brick = {
        "kind": "rigid_body", "shape": {"name": "box", "sides": [0.2, 0.1, 0.2]}, "particle_spacing": 0.05,
        "volume_sampling": 1.0, "surface_sampling": 0.0, "origin": [0.2, 0.7, 0.2],
    }  # fmt: skip
    table = {"kind": "fluid", "size": [0.4, 0.4, 0.4], "rest_distance": 0.05}
    scene = Scene({"water": table, "brick": brick, "gravity": {}})
    assert scene.is_world and with_fluids(scene) and not with_fluids(Scene({"grid": {"rows": 2, "columns": 2}}))
    position = scene.world_set.position
    found = scene.world_set.slices()["fluid"]
    middle = position[found].mean(axis=0)
    with OffscreenRenderer(scene, 320, 240, legend=False) as renderer:
        renderer.fit(position)
        camera = renderer.camera
        flown = position.copy()
        flown[found.start] += 90.0
        renderer.fit(flown)
        assert renderer.camera.distance == pytest.approx(camera.distance, rel=0.1)
        assert renderer._view.toggle_foam() is True and renderer.wants_velocity
        renderer.draw(position, velocity=np.zeros_like(position))
        image = renderer.image()[..., :3] / 255
        x, y = renderer.camera.to_window(middle)
    pixel = image[int(240 - y), int(x)]
    assert pixel[2] > pixel[0] + 0.15
