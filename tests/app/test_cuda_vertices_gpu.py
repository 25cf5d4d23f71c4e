"""States that go from the solver's GPU memory into OpenGL's buffers, on a real GPU that also draws: the numbers are those
that the host reads, frame after frame, and the pictures are the same by either way."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest
from cloth_scenes import cloth_scene
from fake_interop import held, store_bytes

from softlab.app.driver import open_simulation
from softlab.app.output.offscreen import OffscreenRenderer, opengl_available
from softlab.app.render import cuda_vertices
from softlab.app.render.cuda_vertices import STRAIGHT, CudaVertices
from softlab.app.render.sheet_view import SheetView
from softlab.app.render.vertices import HostVertices
from softlab.app.window.demo import Demo
from softlab.model.core.simulation import Simulation
from softlab.model.scene.scene import Scene, load_scene

pytestmark = pytest.mark.gpu
SCENE = cloth_scene("everything", "velocity-verlet", rows=33, columns=35)  # no block or warp divides it
LARGE = load_scene("cloth-hanging").replace({"cloth.rows": 512, "cloth.columns": 512})


@cache
def unable() -> str:
    """Why nothing here can be tested, or ""."""
    from softlab.gpu_backend.core.device import gpu_available, simulated

    works, reason = gpu_available()
    if not works or simulated():
        return reason if not works else "the simulator is not a GPU"
    works, reason = opengl_available(text=False)  # a machine for computing has no fonts, perhaps
    return "" if works else f"no off-screen OpenGL: {reason}"


@pytest.fixture
def renderer() -> Iterator[OffscreenRenderer]:
    """Pictures of SCENE, drawn by NVIDIA's driver: from there on, not to share is a failure."""
    if unable():
        pytest.skip(unable())
    with OffscreenRenderer(SCENE, 640, 480, legend=False) as opened:
        vendor, name = cuda_vertices.drawn_by()
        if "nvidia" not in vendor.lower():
            pytest.skip(f"{name} draws, not the GPU")
        yield opened


def opened(scene: Scene = SCENE, **options: Any) -> Simulation:
    return open_simulation(scene, "gpu", allow_unstable=True, **options)


def check_buffers(vertices: Any, simulation: Simulation, normals: bool = True) -> None:
    """What OpenGL holds is what the host reads, rounded once where the solver has more digits."""
    assert vertices.transfer == STRAIGHT
    position = simulation.read("position").astype(np.float32)
    assert np.array_equal(held(vertices.position_buffer, position.shape[1]), position)
    if normals:
        assert np.array_equal(held(vertices.normal_buffer), simulation.read("normal").astype(np.float32))


@pytest.mark.parametrize("kernel", ["graph", "launch", "one-block", "stages"])
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_buffers_hold_what_the_host_reads(renderer: OffscreenRenderer, precision: str, kernel: str) -> None:
    scene = cloth_scene("everything", "velocity-verlet") if kernel == "one-block" else SCENE
    vertices = CudaVertices(scene)
    with opened(scene, precision=precision, kernel=kernel) as simulation:
        for _ in range(3):
            simulation.advance(17)
            vertices.upload(simulation)
            check_buffers(vertices, simulation)
        vertices.upload(simulation, normals=False)
        check_buffers(vertices, simulation, normals=False)
    vertices.delete()


@pytest.mark.parametrize("side", [33, 700])  # of one block, and of many: drawn as wide springs, and as thin ones
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_plane_is_drawn_straight_and_the_same(renderer: OffscreenRenderer, precision: str, side: int) -> None:
    scene = load_scene("lab-grid").replace({"grid.rows": side, "grid.columns": side + 2})
    renderer.close()  # two off-screen contexts do not live together
    with OffscreenRenderer(scene, 640, 480, legend=False) as plane, opened(scene, precision=precision) as simulation:
        plane._view.vertices.few = 0
        for _ in range(2):
            simulation.advance(60)
            plane.show(simulation)
            check_buffers(plane._view.vertices, simulation, normals=False)
            straight = plane.image()
            plane.draw(simulation.read("position"))
            np.testing.assert_array_equal(straight, plane.image())


@pytest.mark.parametrize("lines", [False, True], ids=["surface", "springs"])
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_pictures_are_the_same_pixel_by_pixel(renderer: OffscreenRenderer, precision: str, lines: bool) -> None:
    """Straight, through the host, and as a state that no simulation holds."""
    view, vertices = renderer._view, renderer._view.vertices
    if lines:
        assert view.toggle_lines()
    with opened(precision=precision) as simulation:
        for _ in range(2):
            simulation.advance(40)
            renderer.fit(simulation.read("position"))
            images = []
            for shared in (True, False, True):
                vertices.shared = shared
                view.upload_from(simulation)
                assert vertices.transfer == (STRAIGHT if shared else HostVertices.transfer)
                view.draw(renderer.camera, renderer.strain_range, time=simulation.time)
                images.append(renderer.image())
            renderer.draw(simulation.read("position"), simulation.time, simulation.read("normal"))
            images.append(renderer.image())
            assert len(np.unique(images[0].reshape(-1, 4), axis=0)) > 20  # something is seen
            for image in images[1:]:
                np.testing.assert_array_equal(image, images[0])


@pytest.mark.parametrize("name", ["dam-break", "two-fluids"])
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_fluid_is_drawn_straight_and_the_same(renderer: OffscreenRenderer, precision: str, name: str) -> None:
    """Its particles change places in every substep, and are written in the scene's order; colours go with them."""
    scene = load_scene(name)
    renderer.close()  # two off-screen contexts do not live together
    with (
        OffscreenRenderer(scene, 320, 240, legend=False, view_options=("particles",)) as shown,
        opened(scene, precision=precision) as simulation,
    ):
        view, vertices = shown._view, shown._view.vertices
        for _ in range(2):
            simulation.advance(20)
            shown.fit(simulation.read("position"))
            images = []
            for shared in (True, False, True):
                vertices.shared = shared
                view.upload_from(simulation)
                assert vertices.transfer == (STRAIGHT if shared else HostVertices.transfer)
                if shared:
                    check_buffers(vertices, simulation, normals=False)
                view.draw(shown.camera, shown.strain_range, time=simulation.time)
                images.append(shown.image())
            assert len(np.unique(images[0].reshape(-1, 4), axis=0)) > 20
            for image in images[1:]:
                np.testing.assert_array_equal(image, images[0])


def test_drawing_and_stepping_wait_for_each_other(renderer: OffscreenRenderer) -> None:
    """Frames without a pause, of a cloth large enough that drawing it overlaps what comes next: every picture is that of its
    own state, drawn alone afterwards."""
    with OffscreenRenderer(LARGE, 640, 480, legend=False) as large, opened(LARGE) as simulation:
        view, images, states = large._view, [], []
        for _ in range(12):
            simulation.advance(200)
            view.upload_from(simulation)
            view.draw(large.camera, 0.5)
            simulation.advance(1)  # asked for while the picture may still be drawn
            view.upload_from(simulation)
            check_buffers(view.vertices, simulation)
            view.draw(large.camera, 0.5)
            images.append(large.image())
            states.append((simulation.read("position"), simulation.read("normal")))
        for image, (position, normal) in zip(images, states, strict=True):
            large.draw(position, normal=normal)
            np.testing.assert_array_equal(large.image(), image)
        assert not np.array_equal(images[0], images[-1])


def test_several_worlds(renderer: OffscreenRenderer) -> None:
    views = [SheetView(SCENE), SheetView(SCENE)]
    with opened() as one, opened(precision="float64") as other:
        for steps in (10, 5):
            one.advance(steps)
            other.advance(2 * steps)
            for view, simulation in zip(views, (one, other), strict=True):
                view.upload_from(simulation)
            for view, simulation in zip(views, (one, other), strict=True):
                check_buffers(view.vertices, simulation)
    for view in views:
        view.delete()


def test_the_demo_changes_backends_at_run_time(renderer: OffscreenRenderer) -> None:
    """Key B, to the CPU and back, twice: each time the buffers change hands."""
    view = renderer._view
    with Demo([SCENE], backend="gpu") as demo:
        for turn in range(5):
            demo.frame()
            assert not demo.frozen, demo.failure
            view.upload_from(demo.world)
            if turn % 2 == 0:
                check_buffers(view.vertices, demo.world)
            else:
                assert demo.backend == "cpu" and view.vertices.transfer == HostVertices.transfer
                assert np.array_equal(held(view.vertices.position_buffer), demo.world.read("position"))
            demo.switch_backend()


def test_a_simulation_outlives_the_buffers_and_buffers_the_simulation(renderer: OffscreenRenderer) -> None:
    from pyglet import gl

    vertices = CudaVertices(SCENE)
    with opened() as first:
        vertices.upload(first)
    with opened() as second:
        second.advance(3)
        vertices.upload(second)
        check_buffers(vertices, second)
        vertices.delete()
        assert not gl.glIsBuffer(vertices.position_buffer)
        second.advance(3)
        assert np.isfinite(second.state().position).all()
    assert store_bytes(renderer._view.vertices.position_buffer) == 12 * 33 * 35
