"""A fluid's surface in screen space: normals of a ball and of a plane, edges that do not bleed, ellipsoids at a surface, and
the light that the fluid takes away."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from test_view3d import drawing  # noqa: F401  # a fixture

from softlab.app.render.camera3d import Camera3D
from softlab.app.render.detail import FINE
from softlab.app.render.fluid.surface import FILTERS, ROUND, STEPS, FluidSurface
from softlab.app.render.opengl import open_window
from softlab.app.render.smooth_target import SmoothTarget
from softlab.app.render.vertex_arrays import static_buffer
from softlab.model.base.errors import InputError
from softlab.model.geometry.anisotropy import FLATTEST, ellipsoids

SIDE = 320  # pixels


@pytest.fixture(autouse=True)
def window(drawing: None) -> Iterator[None]:  # noqa: F811
    opened = open_window(True, SIDE, SIDE)
    yield
    opened.close()


def surface(points: np.ndarray, radius: float, filtered: str, axes: np.ndarray | None = None) -> FluidSurface:
    found = FluidSurface(static_buffer(np.ascontiguousarray(points, np.float32)), len(points), filtered)
    found.set_appearance(radius, axes=axes)
    return found


def seen(points: np.ndarray, radius: float, filtered: str, camera: Camera3D) -> np.ndarray:
    """(height, width, 4): normals and depth."""
    found = surface(points, radius, filtered)
    found.passes(camera)
    image = found.normals(camera)
    found.delete()
    return image


def rays(camera: Camera3D) -> np.ndarray:
    """(height, width, 3): unit vectors in the camera's axes, through the middle of each pixel."""
    x = np.arange(camera.width) + 0.5 - camera.width / 2
    y = camera.height / 2 - np.arange(camera.height) - 0.5
    found = np.stack(
        [*np.broadcast_arrays(x / camera.focal, (y / camera.focal)[:, None]), -np.ones((len(y), len(x)))], -1
    )
    return found / np.linalg.norm(found, axis=-1, keepdims=True)


def degrees(image: np.ndarray, exact: np.ndarray) -> np.ndarray:
    return np.degrees(np.arccos(np.clip((image[..., :3] * exact).sum(axis=-1), -1, 1)))


def test_the_normals_of_a_ball_are_the_balls() -> None:
    """Within 2 degrees over 95 % of its disc; the depth is that of the ray that meets it."""
    camera, radius = Camera3D(SIDE, SIDE, distance=6.0, yaw=0.3, pitch=0.2), 0.9
    image, ray, centre = seen(np.zeros((1, 3)), radius, "none", camera), rays(camera), np.array([0.0, 0.0, -6.0])
    along = ray @ centre
    root = along**2 - (centre @ centre - radius**2)
    there = image[..., 3] > 0
    np.testing.assert_array_equal(there[np.abs(root) > 0.05], (root > 0)[np.abs(root) > 0.05])
    far = along - np.sqrt(np.maximum(root, 0))
    np.testing.assert_allclose(image[there, 3], -(far * ray[..., 2])[there], atol=2e-3)
    exact = (far[..., None] * ray - centre) / radius
    assert np.mean(degrees(image, exact)[there] < 2) > 0.95


def test_a_ball_of_particles_is_smooth() -> None:
    """Twenty particles across: the filter takes their bumps away, and keeps the ball."""
    grid = np.stack(np.meshgrid(*[np.arange(-10, 11) * 0.09] * 3), axis=-1).reshape(-1, 3)
    ball = grid[np.linalg.norm(grid, axis=1) < 0.9]
    camera = Camera3D(SIDE, SIDE, distance=6.0, yaw=0.3, pitch=0.2)
    exact_of = {}
    for filtered in ("none", FILTERS[0]):
        image = seen(ball, 0.07, filtered, camera)
        there = image[..., 3] > 0
        place = rays(camera) * (image[..., 3] / -rays(camera)[..., 2])[..., None] - (0, 0, -6.0)
        disc = there & (np.linalg.norm(place[..., :2], axis=-1) < 0.7)
        exact_of[filtered] = np.median(degrees(image, place / np.linalg.norm(place, axis=-1, keepdims=True))[disc])
    assert exact_of["none"] > 25 > 10 > exact_of[FILTERS[0]]


@pytest.mark.parametrize("pitch", [1.2, 0.6])
def test_a_plane_of_particles_is_a_plane(pitch: float) -> None:
    """Within 5 degrees, away from the edges of the picture, over 95 % of it."""
    along = np.arange(-20, 21) * 0.1
    plane = np.stack(np.meshgrid(along, [0.0, -0.1, -0.2], along), axis=-1).reshape(-1, 3)
    camera = Camera3D(SIDE, SIDE, distance=2.6, yaw=0.3, pitch=pitch)
    image = seen(plane, 0.07, "narrow-range", camera)[50:-50, 50:-50]
    assert (image[..., 3] > 0).all()
    assert np.mean(degrees(image, camera.axes @ (0.0, 1.0, 0.0)) < 5) > 0.95


@pytest.mark.parametrize("shaped", [False, True], ids=["balls", "ellipsoids"])
def test_a_rough_plane_seen_at_seven_degrees_has_no_stripes(shaped: bool) -> None:
    """Rows of particles are far behind one another there: 98 % of the normals stay within 30 degrees of the vertical."""
    along = np.arange(-16, 17) * 0.08
    places = np.stack(np.meshgrid(along, -0.08 * np.arange(5), along), axis=-1).reshape(-1, 3)
    places += np.random.default_rng(4).uniform(-0.02, 0.02, places.shape)
    camera = Camera3D(SIDE, SIDE, distance=3.0, yaw=0.2, pitch=0.12)
    middles, axes = ellipsoids(places, 0.072, 0.16) if shaped else (places, None)
    water = surface(middles, 0.072, "narrow-range", axes)
    water.passes(camera)
    image = water.normals(camera)
    water.delete()
    first = int(np.argmax((image[..., 3] > 0).any(axis=1))) + 4
    rows = int(0.7 * np.ptp(along) * np.sin(camera.pitch) * camera.scale)  # of its upper side
    tilt = degrees(image, camera.axes @ (0.0, 1.0, 0.0))[first : first + rows, 80:-80]
    assert rows > 30 and np.mean(tilt > 30) < 0.02


def test_a_silhouette_does_not_bleed() -> None:
    """What is covered stays so, and no more; what lies in front pulls nothing behind it along, nor the other way round."""
    along = np.arange(-12, 13) * 0.1
    wall = np.stack(np.meshgrid(along, along, [-1.5]), axis=-1).reshape(-1, 3)
    disc = wall[np.linalg.norm(wall[:, :2], axis=1) < 0.5] + (0, 0, 1.5)
    both, camera = np.concatenate([wall, disc]), Camera3D(SIDE, SIDE, distance=4.0, yaw=0.0, pitch=0.0)
    rough, smooth = seen(both, 0.08, "none", camera)[..., 3], seen(both, 0.08, "narrow-range", camera)[..., 3]
    np.testing.assert_array_equal(smooth > 0, rough > 0)
    assert np.abs(smooth - rough).max() < 0.16  # m: what lies in front is 1.5 m before the wall


def test_the_outline_of_a_row_of_particles_is_a_line() -> None:
    """Balls 0.16 m apart with a radius of 0.09 m leave scallops of 5 pixels; the edge is level within a pixel."""
    camera, along = Camera3D(SIDE, SIDE, distance=3.0, yaw=0.0, pitch=0.0), np.arange(-12, 13) * 0.16
    wall = np.stack(np.meshgrid(along, [0.0, -0.12, -0.24], [0.0]), axis=-1).reshape(-1, 3)
    image = seen(wall, 0.09, "narrow-range", camera)
    top = np.argmax(image[:, 40:-40, 3] > 0, axis=0)
    scallop = (0.09 - np.sqrt(0.09**2 - 0.08**2)) * camera.scale
    assert scallop > 4.5 and np.ptp(top) <= 1


def test_particles_that_stick_out_of_a_body_leave_its_outline_smooth() -> None:
    """Every third ball of the top row is 0.6 radii higher, over 6 pixels: less than a third of that is left."""
    camera, along = Camera3D(SIDE, SIDE, distance=3.0, yaw=0.0, pitch=0.0), np.arange(-24, 25) * 0.08
    wall = np.stack(np.meshgrid(along, [0.0, -0.08, -0.16, -0.24, -0.32], [0.0]), axis=-1).reshape(-1, 3)
    wall[wall[:, 1] == 0.0, 1] += np.where(np.arange(len(along)) % 3 == 0, 0.6 * 0.09, 0.0)
    image = seen(wall, 0.09, "none", camera)
    top = np.argmax(image[:, 40:-40, 3] > 0, axis=0)
    assert 0.6 * 0.09 * camera.scale > 6.0 and np.ptp(top) <= 0.6 * 0.09 * camera.scale / 3


def pool(rows: int, seed: int = 5) -> np.ndarray:
    """Particles (n, 3) [m] of a pool, 0.08 m apart, each up to a quarter of that out of its place, as they come to rest; of
    the uppermost, one in six is higher by 0.06 m."""
    random, along = np.random.default_rng(seed), np.arange(-24, 25) * 0.08
    places = np.stack(np.meshgrid(along, -0.08 * np.arange(rows), along[23:26]), axis=-1).reshape(-1, 3)
    higher = (places[:, 1] == 0.0) & (random.random(len(places)) < 1 / 6)
    return places + random.uniform(-0.02, 0.02, places.shape) + higher[:, None] * (0.0, 0.06, 0.0)


@pytest.mark.parametrize("pitch", [0.0, 0.6], ids=["from the side", "from above"])
@pytest.mark.parametrize(("shaped", "largest"), [(False, 0.17), (True, 0.12)], ids=["balls", "ellipsoids"])
def test_the_outline_of_a_pool_is_level(
    pitch: float, shaped: bool, largest: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The upper edge of a rough pool deviates from a straight line by less than `largest` radii (RMS), and by a sixth less
    than where the bell has a standard deviation of 0.7 radii."""
    camera, radius, deviation = Camera3D(SIDE, SIDE, distance=3.0, yaw=0.0, pitch=pitch), 0.072, []
    for width in (ROUND, 0.7):
        monkeypatch.setattr("softlab.app.render.fluid.surface.ROUND", width)
        squares = []
        for seed in (5, 6, 7):
            places = pool(6, seed)
            middles, axes = ellipsoids(places, radius, 0.16) if shaped else (places, None)
            water = surface(middles, radius, "narrow-range", axes)
            water.passes(camera)
            top = np.argmax(water.normals(camera)[:, 60:-60, 3] > 0, axis=0)
            water.delete()
            across = np.arange(len(top))
            squares.append((top - np.polyval(np.polyfit(across, top, 1), across)).var())
        deviation.append(np.sqrt(np.mean(squares)) / (radius * camera.scale))
    assert deviation[0] < largest and deviation[0] < deviation[1] * 5 / 6, deviation


@pytest.mark.parametrize("gap", [2.0, 3.0])
def test_a_drop_near_a_pool_stays_a_drop(gap: float) -> None:
    """`gap` radii above a rough pool it covers its disc, within a tenth, and nothing joins it to the pool."""
    camera, radius = Camera3D(SIDE, SIDE, distance=3.0, yaw=0.0, pitch=0.0), 0.072
    water = pool(6)
    water = water[water[:, 1] < 0.03]  # none of those that are higher
    drop = np.array([[0.0, 0.02 + (2.0 + gap) * radius, 0.0]])
    without, both = (
        seen(points, radius, "narrow-range", camera)[..., 3] > 0 for points in (water, np.concatenate([water, drop]))
    )
    disc = np.pi * (radius * camera.scale) ** 2
    assert np.count_nonzero(both & ~without) == pytest.approx(disc, rel=0.1)
    assert (~both[:, SIDE // 2 - 3 : SIDE // 2 + 3].any(axis=1)[np.argmax(both.any(axis=1)) :]).any()


def test_drops_holes_and_gaps_in_depth_stay() -> None:
    """A ball alone covers its disc; a hole of five radii stays open; what is far behind one another is not joined."""
    camera, radius = Camera3D(SIDE, SIDE, distance=3.0, yaw=0.0, pitch=0.0), 0.08
    area = np.pi * (radius * camera.scale) ** 2
    assert np.count_nonzero(seen(np.zeros((1, 3)), radius, "none", camera)[..., 3]) == pytest.approx(area, rel=0.02)
    along = np.arange(-12, 13) * 0.08
    sheet = np.stack(np.meshgrid(along, along, [0.0]), axis=-1).reshape(-1, 3)
    holed = sheet[np.linalg.norm(sheet, axis=1) > 3.5 * radius]
    assert seen(holed, radius, "narrow-range", camera)[SIDE // 2, SIDE // 2, 3] == 0.0
    side = SIDE // 2
    for behind, joined in ((0.0, True), (1.5, False)):  # two sheets with a gap of 0.75 radii between them
        halves = [sheet[sheet[:, 0] < -0.04] - (0.03, 0, 0), sheet[sheet[:, 0] > 0.04] + (0.03, 0, -behind)]
        image = seen(np.concatenate(halves), radius, "none", camera)[side, side - 8 : side + 8, 3]
        assert image.all() == joined


def test_particles_at_a_surface_are_flat() -> None:
    along = np.arange(8) * 0.1
    block = np.stack(np.meshgrid(along, along, along, indexing="ij"), axis=-1).reshape(-1, 3)
    middle, axes = ellipsoids(np.concatenate([block, [[3.0, 0, 0]]]), 0.05, 0.21)
    length = np.linalg.svd(axes, compute_uv=False)
    inside = np.flatnonzero(((block > 0.19) & (block < 0.51)).all(axis=1))
    top = np.flatnonzero((block[:, 1] > 0.69) & ((block > 0.19) & (block < 0.51))[:, [0, 2]].all(axis=1))
    np.testing.assert_allclose(length[inside], 0.05, rtol=1e-6)
    np.testing.assert_allclose(middle[inside], block[inside], atol=1e-12)
    assert (length[top, 0] > 1.15 * length[top, 2]).all() and (
        length[:, 0] <= FLATTEST * length[:, 2] * (1 + 1e-9)
    ).all()
    short = np.linalg.svd(axes[top])[0][:, :, 2]
    np.testing.assert_allclose(np.abs(short), np.broadcast_to([0.0, 1.0, 0.0], short.shape), atol=1e-6)
    np.testing.assert_allclose(np.prod(length[:-1], axis=1)[top], 0.05**3, rtol=1e-6)
    assert length[-1] == pytest.approx([0.03] * 3)


@pytest.fixture
def target() -> Iterator[SmoothTarget]:
    found = SmoothTarget(FINE)
    yield found
    found.delete()


def picture(
    water: FluidSurface, target: SmoothTarget, camera: Camera3D, grey: float = 1.0, depth: float = 1.0
) -> np.ndarray:
    """(height, width, 3): water drawn over a grey picture of this depth, as OpenGL keeps it."""
    from pyglet import gl

    target.begin(SIDE, SIDE)
    gl.glClearColor(grey, grey, grey, 1.0)
    gl.glClearDepth(depth)
    gl.glDepthMask(gl.GL_TRUE)
    gl.glClear(gl.GL_COLOR_BUFFER_BIT | gl.GL_DEPTH_BUFFER_BIT)
    gl.glClearDepth(1.0)
    water.passes(camera, target.frame)
    water.shade(camera, target.frame)
    target.finish()
    image = np.empty((SIDE, SIDE, 4), np.uint8)
    gl.glReadPixels(0, 0, SIDE, SIDE, gl.GL_RGBA, gl.GL_UNSIGNED_BYTE, image.ctypes.data_as(ctypes.c_void_p))
    return image[::-1, :, :3].astype(int)


def test_light_goes_through_and_what_is_in_front_stays_in_front(target: SmoothTarget) -> None:
    """A white picture behind water is blue, more so where there is more of it; nothing is drawn over what is nearer. The thin
    edge has no halo: it is nowhere brighter than what lies behind it, in no colour."""
    along = np.arange(-10, 11) * 0.1
    wedge = np.stack(np.meshgrid(along, along, np.arange(11) * 0.1), axis=-1).reshape(-1, 3)
    wedge = wedge[wedge[:, 2] <= (wedge[:, 0] + 1) / 2 + 1e-9]  # thin at the left
    camera = Camera3D(SIDE, SIDE, distance=6.0, yaw=0.0, pitch=0.0)
    water = surface(wedge, 0.07, "narrow-range")
    image = picture(water, target, camera)
    row = image[SIDE // 2]
    assert (row[2] == 255).all()  # beside it
    thin, thick = row[SIDE // 2 - 60], row[SIDE // 2 + 50]
    assert thick[2] > thick[0] + 60 and thin[0] > thick[0] + 40
    assert (picture(water, target, camera, depth=0.0) == 255).all()
    before_grey = picture(water, target, camera, grey=0.8)[SIDE // 2, SIDE // 2 - 75 : SIDE // 2 + 50]
    assert before_grey.max() <= 0.8 * 255 + 3
    water.delete()


def test_no_streaks_are_left_along_the_axes_of_the_picture() -> None:
    """A rough heap of balls: normals of neighbouring pixels differ by a quarter less than after the passes along the axes
    alone, by their 90 % quantile over all that is covered."""
    places = np.random.default_rng(3).uniform(-0.6, 0.6, (400, 3))
    camera = Camera3D(SIDE, SIDE, distance=2.5, yaw=0.4, pitch=0.5)

    def bends(steps: list[Any]) -> float:
        with pytest.MonkeyPatch.context() as patch:
            patch.setitem(STEPS, "narrow-range", steps)
            image = seen(places, 0.09, "narrow-range", camera)
        both = (image[:-1, :, 3] > 0) & (image[1:, :, 3] > 0)
        return float(np.quantile(np.linalg.norm(np.diff(image[..., :3], axis=0), axis=-1)[both], 0.9))

    with_last, without = bends(STEPS["narrow-range"]), bends(STEPS["narrow-range"][:-1])
    assert with_last < 0.75 * without, (with_last, without)


def test_an_unknown_filter_is_refused() -> None:
    with pytest.raises(InputError, match="narrow-range"):
        FluidSurface(0, 1, "gaussian")
