"""States that go from the solver's GPU memory into OpenGL's buffers: the order of the calls, when the host's memory is the
way instead and what is said then. The driver is a fake one (tests/tools/fake_interop.py);
tests/app/test_cuda_vertices_gpu.py asks a real one."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from fake_cloth import FakeCloth, open_fake
from fake_interop import FakeRuntime, GpuCloth, Status, alive, held
from kernel_text import entry_of
from test_view3d import REST, SCENE, available

from softlab.app.output.offscreen import OffscreenRenderer
from softlab.app.render import cuda_vertices
from softlab.app.render.cuda_vertices import STRAIGHT, CudaVertices
from softlab.app.render.sheet_view import SheetView
from softlab.app.render.vertices import HostVertices
from softlab.app.window import worlds
from softlab.app.window.demo import Demo
from softlab.app.window.viewer import Viewer
from softlab.model.scene.scene import Scene

HOST = HostVertices.transfer
RANDOM = np.random.default_rng(8)
UNKNOWN = Status.cudaErrorUnknown

Install = Callable[..., FakeRuntime]


@pytest.fixture
def renderer() -> Iterator[OffscreenRenderer]:
    works, text = available()
    if not works:
        pytest.skip(f"no off-screen OpenGL: {text}")
    with OffscreenRenderer(SCENE, 320, 240, legend=False) as opened:
        yield opened


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Install:
    """install(...) -> a FakeRuntime that is what app/render/cuda_vertices.py finds, under a driver that could share."""

    def put(**options: Any) -> FakeRuntime:
        runtime = FakeRuntime(**options)
        monkeypatch.setattr(cuda_vertices, "load_runtime", lambda: runtime)
        monkeypatch.setattr(cuda_vertices, "drawn_by", lambda: ("NVIDIA Corporation", "NVIDIA H200"))
        return runtime

    return put


def crumpled(simulation: FakeCloth) -> FakeCloth:
    simulation._position = simulation.body.position + RANDOM.normal(0, 0.03, simulation.body.position.shape)
    return simulation


def as_the_host_draws(simulation: FakeCloth, lines: bool = False) -> np.ndarray:
    """The picture of its state, without anything of CUDA."""
    with OffscreenRenderer(SCENE, 320, 240, legend=False, lines=lines) as other:
        other.draw(simulation.read("position"), normal=simulation.read("normal"))
        return other.image()


def picture(renderer: OffscreenRenderer, simulation: FakeCloth) -> np.ndarray:
    renderer._window.switch_to()
    renderer._view.upload_from(simulation)
    renderer._view.draw(renderer.camera, renderer.strain_range)
    return renderer.image()


def check_buffers(vertices: Any, simulation: FakeCloth) -> None:
    assert np.array_equal(held(vertices.position_buffer), simulation.read("position").astype(np.float32))
    assert np.array_equal(held(vertices.normal_buffer), simulation.read("normal").astype(np.float32))


# ---------------------------------------------------------------------- straight


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_gpus_state_is_written_into_the_buffers_and_the_picture_is_the_same(
    renderer: OffscreenRenderer, install: Install, precision: str
) -> None:
    """The calls in their order, on the solver's stream; a buffer is registered once, and not mapped if not drawn."""
    runtime = install()
    simulation = crumpled(GpuCloth(SCENE, runtime, precision))
    vertices = renderer._view.vertices
    assert vertices.transfer == HOST and not runtime.calls
    straight = picture(renderer, simulation)
    assert vertices.transfer == STRAIGHT
    position, normal = vertices.position_buffer, vertices.normal_buffer
    for_positions = [("map", position, 77), ("position",), ("unmap", position, 77)]
    for_normals = [("map", normal, 77), ("normal",), ("unmap", normal, 77)]
    assert runtime.calls == [("register", position), ("register", normal), *for_positions, *for_normals]
    check_buffers(vertices, simulation)
    np.testing.assert_array_equal(straight, as_the_host_draws(simulation))
    renderer._window.switch_to()
    assert renderer._view.toggle_lines()
    runtime.calls.clear()
    lines = picture(renderer, crumpled(simulation))
    assert runtime.calls == for_positions
    np.testing.assert_array_equal(lines, as_the_host_draws(simulation, lines=True))
    renderer._window.switch_to()


def test_of_a_plane_positions_are_written_and_nothing_else(renderer: OffscreenRenderer, install: Install) -> None:
    runtime, scene = (
        install(),
        Scene({"grid": {"rows": 5, "columns": 4, "pinned": "top"}, "springs": {}, "gravity": {}}),
    )
    renderer.close()  # two off-screen contexts do not live together
    with OffscreenRenderer(scene, 320, 240, legend=False) as plane:
        simulation = GpuCloth(scene, runtime)
        simulation._position = simulation.body.position + RANDOM.normal(0, 0.1, simulation.body.position.shape)
        plane.show(simulation)
        assert plane.transfer == HOST and not runtime.calls  # so few are sooner there
        plane._view.vertices.few = 0
        plane.show(simulation)
        buffer = plane._view.vertices.position_buffer
        assert plane.transfer == STRAIGHT
        assert runtime.calls == [("register", buffer), ("map", buffer, 77), ("position",), ("unmap", buffer, 77)]
        assert np.array_equal(held(buffer, 2), simulation.read("position").astype(np.float32))
        straight = plane.image()
        plane.draw(simulation.read("position"))
        assert plane.transfer == HOST
        np.testing.assert_array_equal(straight, plane.image())


def test_what_the_caller_has_read_is_not_needed(renderer: OffscreenRenderer, install: Install) -> None:
    simulation = crumpled(GpuCloth(SCENE, install()))
    renderer._view.upload_from(simulation, np.zeros((63, 3), np.float32))
    check_buffers(renderer._view.vertices, simulation)


def test_buffers_are_unregistered_before_they_are_deleted(renderer: OffscreenRenderer, install: Install) -> None:
    runtime = install()
    vertices = CudaVertices(SCENE)
    buffers = vertices.position_buffer, vertices.normal_buffer
    vertices.upload(GpuCloth(SCENE, runtime))
    runtime.calls.clear()
    vertices.delete()  # the fake refuses buffers that OpenGL has no more
    assert sorted(runtime.calls) == [("unregister", buffer) for buffer in sorted(buffers)]
    assert not runtime.registered and not any(map(alive, buffers))


def test_worlds_write_into_buffers_of_their_own_on_streams_of_their_own(
    renderer: OffscreenRenderer, install: Install
) -> None:
    runtime = install()
    views = [SheetView(SCENE), SheetView(SCENE)]
    worlds = [crumpled(GpuCloth(SCENE, runtime, stream=stream)) for stream in (5, 6)]
    for view, world in zip(views, worlds, strict=True):
        view.upload_from(world)
    for view, world, stream in zip(views, worlds, (5, 6), strict=True):
        check_buffers(view.vertices, world)
        assert ("map", view.vertices.position_buffer, stream) in runtime.calls
    assert len(runtime.registered) == 4
    for view in views:
        view.delete()
    assert not runtime.registered


# ---------------------------------------------------------------------- turning from one to the other


def test_another_backend_and_saved_states_get_the_buffers_back(renderer: OffscreenRenderer, install: Install) -> None:
    """Key B: what comes through the host is a fresh store, for which the buffer may not be registered; back on the GPU it
    is registered anew. The same for states that no simulation holds."""
    runtime = install()
    gpu, cpu = crumpled(GpuCloth(SCENE, runtime)), crumpled(FakeCloth(SCENE))
    vertices = renderer._view.vertices
    for _ in range(2):
        vertices.upload(gpu)
        assert vertices.transfer == STRAIGHT and len(runtime.registered) == 2
        check_buffers(vertices, gpu)
        vertices.upload(cpu)
        assert vertices.transfer == HOST and not runtime.registered
        check_buffers(vertices, cpu)
        vertices.upload(gpu)
        vertices.upload_state(SCENE_STATE)
        assert vertices.transfer == HOST and not runtime.registered
        assert np.array_equal(held(vertices.position_buffer), SCENE_STATE)
    assert runtime.counts["register"] == 8


SCENE_STATE = FakeCloth(SCENE).read("position") * np.float32(1.1)


def test_a_cpus_state_asks_nothing_of_cuda(renderer: OffscreenRenderer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cuda_vertices, "load_runtime", lambda: pytest.fail("CUDA was asked for"))
    simulation = crumpled(FakeCloth(SCENE))
    vertices = renderer._view.vertices
    vertices.upload(simulation)
    check_buffers(vertices, simulation)
    assert vertices.transfer == HOST and not vertices.straight(simulation)


def test_sharing_can_be_left_out(renderer: OffscreenRenderer, install: Install) -> None:
    runtime = install()
    simulation = crumpled(GpuCloth(SCENE, runtime))
    vertices = renderer._view.vertices
    vertices.shared = False
    vertices.upload(simulation)
    check_buffers(vertices, simulation)
    assert vertices.transfer == HOST and not runtime.calls
    vertices.shared = True
    vertices.upload(simulation)
    assert vertices.transfer == STRAIGHT


# ---------------------------------------------------------------------- falling back


FAILURES = {
    "get_device": "asking for the GPU failed (cudaErrorUnknown)",
    "register": "sharing a buffer failed (cudaErrorUnknown)",
    "map": "mapping a buffer failed (cudaErrorUnknown)",
    "pointer": "mapping a buffer failed (cudaErrorUnknown)",
    "unmap": "unmapping a buffer failed (cudaErrorUnknown)",
}


@pytest.mark.parametrize("time", [1, 2])
@pytest.mark.parametrize("call", FAILURES)
def test_what_fails_is_said_once_and_the_host_is_the_way(
    renderer: OffscreenRenderer, install: Install, call: str, time: int
) -> None:
    """The first time, or only for the second buffer: nothing stays registered or mapped, the picture is the host's, and
    it is not tried again."""
    runtime = install(**{call: (time, UNKNOWN)})
    simulation = crumpled(GpuCloth(SCENE, runtime))
    vertices = renderer._view.vertices
    shown = picture(renderer, simulation)
    if call == "get_device" and time == 2:  # asked for once
        assert vertices.transfer == STRAIGHT
        return
    assert vertices.transfer == f"{HOST}: {FAILURES[call]}" and not vertices.straight(simulation)
    assert not runtime.registered and not runtime.memory
    check_buffers(vertices, simulation)
    np.testing.assert_array_equal(shown, as_the_host_draws(simulation))
    renderer._window.switch_to()
    before = list(runtime.calls)
    vertices.upload(simulation)
    assert runtime.calls == before and vertices.transfer.endswith(FAILURES[call])
    vertices.upload(FakeCloth(SCENE))
    assert vertices.transfer == HOST  # nothing is wrong with a CPU's way


def test_sharing_that_stops_working_is_left(renderer: OffscreenRenderer, install: Install) -> None:
    runtime = install(map=(5, UNKNOWN))
    simulation = crumpled(GpuCloth(SCENE, runtime))
    vertices = renderer._view.vertices
    for way in (STRAIGHT, STRAIGHT, f"{HOST}: {FAILURES['map']}"):
        vertices.upload(crumpled(simulation))
        assert vertices.transfer == way
        check_buffers(vertices, simulation)
    assert not runtime.registered


def test_another_gpu_that_draws_is_not_written_to(renderer: OffscreenRenderer, install: Install) -> None:
    runtime = install(devices=(1, 2))
    vertices = renderer._view.vertices
    vertices.upload(GpuCloth(SCENE, runtime))
    assert vertices.transfer == f"{HOST}: another GPU draws (NVIDIA H200)" and not runtime.calls


@pytest.mark.parametrize("devices", [(), (3, 0)])
def test_a_driver_that_cannot_tell_its_gpu_or_draws_with_several_is_tried(
    renderer: OffscreenRenderer, install: Install, devices: tuple[int, ...]
) -> None:
    runtime = install(devices=devices, **({} if devices else {"gl_devices": (1, Status.cudaErrorInvalidDevice)}))
    vertices = renderer._view.vertices
    vertices.upload(GpuCloth(SCENE, runtime))
    assert vertices.transfer == STRAIGHT


def test_a_mapped_buffer_that_is_too_small_is_not_written_to(renderer: OffscreenRenderer, install: Install) -> None:
    runtime = install(size=12 * 63 - 4)
    simulation = crumpled(GpuCloth(SCENE, runtime))
    vertices = renderer._view.vertices
    vertices.upload(simulation)
    assert "a mapped buffer has 752 bytes and not 756" in vertices.transfer
    assert ("position",) not in runtime.calls
    check_buffers(vertices, simulation)


def test_a_simulation_that_cannot_write_by_itself_goes_through_the_host(
    renderer: OffscreenRenderer, install: Install, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As one without a kernel for normals: the target is no host array. What is wrong with the simulation is still raised."""
    runtime = install()
    simulation = crumpled(GpuCloth(SCENE, runtime))
    monkeypatch.setattr(simulation, "_read_normal", lambda into: FakeCloth._read_normal(simulation, into))
    vertices = renderer._view.vertices
    vertices.upload(simulation)
    assert vertices.transfer.startswith(f"{HOST}: TypeError") and not runtime.registered
    check_buffers(vertices, simulation)
    monkeypatch.setattr(simulation, "_read_position", lambda into: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        CudaVertices(SCENE).upload(simulation)


def test_software_that_draws_is_named(renderer: OffscreenRenderer, monkeypatch: pytest.MonkeyPatch) -> None:
    """This driver as it is, unless it is one that can share."""
    vendor, name = cuda_vertices.drawn_by()
    if "nvidia" in vendor.lower():
        pytest.skip("an NVIDIA GPU draws here")
    runtime = FakeRuntime()
    monkeypatch.setattr(cuda_vertices, "load_runtime", lambda: runtime)
    vertices = renderer._view.vertices
    vertices.upload(GpuCloth(SCENE, runtime))
    assert vertices.transfer == f"{HOST}: {name} draws, not the GPU that computes" and not runtime.counts


def test_a_missing_package_and_the_simulator_are_named(
    renderer: OffscreenRenderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "cuda.bindings", None)
    vertices = renderer._view.vertices
    vertices.upload(GpuCloth(SCENE, FakeRuntime()))
    assert vertices.transfer == f"{HOST}: cuda.bindings is missing (pip install cuda-bindings)"
    monkeypatch.setenv("NUMBA_ENABLE_CUDASIM", "1")
    vertices = CudaVertices(SCENE)
    vertices.upload(GpuCloth(SCENE, FakeRuntime()))
    assert vertices.transfer == f"{HOST}: the CUDA simulator has no GPU memory"
    vertices.delete()


# ---------------------------------------------------------------------- the window


def test_the_window_reads_a_state_only_for_the_host() -> None:
    """What is straight is read by nobody else, several worlds each by its own way; a frozen picture is no world's state."""
    asked: list[Any] = []

    def view(name: str, straight: bool) -> Any:
        return SimpleNamespace(
            vertices=SimpleNamespace(straight=lambda world: straight),
            upload_from=lambda world, position=None: asked.append((name, world, position)),
            upload=lambda position: asked.append((name, position)),
        )

    demo = SimpleNamespace(worlds=["first", "second"], positions=["p1", "p2"], frozen=False)
    window: Any = SimpleNamespace(demo=demo, space=True, views=[view("a", True), view("b", False)])
    Viewer._upload(window)
    assert asked == [("a", "first", None), ("b", "second", "p2")]
    asked.clear()
    demo.frozen = True
    Viewer._upload(window)
    assert asked == [("a", "p1"), ("b", "p2")]


# ---------------------------------------------------------------------- the kernels


@pytest.mark.usefixtures("ptx_compiler")
def test_kernels_of_float64_write_float32() -> None:
    """Every number is rounded once, on its way out."""
    from numba import types

    from softlab.gpu_backend.core.sheet import make_cloth_tools

    tools = make_cloth_tools(np.float64)
    out, shape = types.float32[:, ::1], (types.int32, types.int32)
    for kernel, more in ((tools.write_position, ()), (tools.write_normal, shape)):
        text = entry_of(kernel.py_func, (types.float64[::1], out, *more), "exact")
        assert text.count("cvt.rn.f32.f64") == 3 and text.count("st.global.f32") == 3
        assert "st.global.f64" not in text and ".local" not in text


def test_a_large_cloth_is_read_only_when_somebody_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    """For the statistics, for the hand, for a picture by the host; small ones are kept for the case of a divergence."""
    monkeypatch.setattr(worlds, "MAX_SNAPSHOT_MASSES", 10)
    with Demo([SCENE.replace({"gravity.enabled": True})], open_world=open_fake) as demo:
        demo._statistics_due = float("inf")
        demo.world.asked.clear()
        for _ in range(3):
            demo.frame()
        assert demo.world.asked == []
        assert demo.positions[0][40, 1] < REST[40, 1] and demo.world.asked == ["position"]
        assert demo.positions[0] is demo.positions[0] and demo.world.asked == ["position"]
        demo.take(31, REST[31])
        demo.world.asked.clear()
        demo.frame()
        assert demo.world.asked == ["position"] * (demo._batches() - 1)
        demo.release()
        demo._statistics_due = 0.0
        demo.world.asked.clear()
        demo.frame()
        assert demo.world.asked == ["position"]
        assert demo.statistics.bounds[1] == pytest.approx(float(demo.positions[0][:, 1].min()))
