"""The demo: its actions without a window, and the real window, with keys and mouse, on a virtual screen."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.app.render.camera import Camera2D, finite_bounds, pick
from softlab.app.render.colours import STOPS, strain_colours, strain_range
from softlab.app.window.demo import Demo
from softlab.model.base.errors import BackendUnavailable
from softlab.model.scene.scene import Scene

GRID = {"rows": 8, "columns": 8, "pinned": "top-corners"}
TABLES: dict[str, Any] = {
    "grid": GRID,
    "springs": {},
    "damping": {},
    "gravity": {"enabled": False},
    "method": {"integrator": "lab"},
}


def open_without_gpu(scene: Scene, backend: str, **options: Any) -> Any:
    if backend == "gpu":
        raise BackendUnavailable("no GPU here", "get one")
    return open_simulation(scene, backend, **options)


@pytest.fixture
def demo() -> Iterator[Demo]:
    with Demo([Scene(TABLES)], open_world=open_without_gpu) as running:
        yield running


# ---------------------------------------------------------------------- without a window


def test_importing_the_drawing_loads_no_pyglet() -> None:
    drawing = (
        "softlab.app.window.viewer, softlab.app.output.offscreen, softlab.app.output.video, softlab.app.window.demo"
    )
    code = f"import sys, {drawing}; sys.exit('pyglet' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_frame_does_so_many_steps_of_every_world() -> None:
    scenes = [Scene(TABLES), Scene(TABLES | {"grid": GRID | {"rows": 4}})]
    with Demo(scenes) as demo:
        demo.frame()
        demo.change_steps(1)
        demo.frame()
        assert [world.step for world in demo.worlds] == [30, 30]
        assert [len(position) for position in demo.positions] == [64, 32]


def test_gravity_goes_on_and_off(demo: Demo) -> None:
    demo.frame()
    rest = demo.positions[0].copy()
    np.testing.assert_allclose(
        rest, demo.world.body.position, atol=1e-6
    )  # fast math: roots are estimated on some processors
    demo.toggle_gravity()
    demo.frame()
    assert demo.gravity and "gravity on" in demo.message
    assert demo.positions[0][:, 1].mean() < rest[:, 1].mean()
    demo.toggle_gravity()
    assert not demo.gravity


def test_gravity_works_in_a_scene_that_has_none() -> None:
    with Demo([Scene({"grid": GRID, "springs": {}})]) as demo:
        demo.toggle_gravity()
        demo.frame()
        assert demo.gravity
        assert demo.positions[0][-1, 1] < -7
        demo.restart()
        assert not demo.gravity


def test_a_scene_without_springs_says_so() -> None:
    with Demo([Scene({"grid": GRID, "gravity": {}})]) as demo:
        demo.change_stiffness(1)
        demo.frame()
        assert demo.message == "this scene has no elastic springs" and demo.world.step == 10


def test_pause_holds_the_state(demo: Demo) -> None:
    demo.toggle_gravity()
    demo.toggle_pause()
    demo.frame()
    assert demo.world.step == 0
    demo.toggle_pause()
    demo.frame()
    assert demo.world.step == 10


def test_steps_per_frame_stay_on_their_ladder(demo: Demo) -> None:
    for presses, expected in ((-1, 5), (-1, 2), (-1, 1), (-1, 1), (1, 2), (100, 10000)):
        demo.change_steps(presses)
        assert demo.steps_per_frame == expected


def test_step_size_and_stiffness_change_by_a_factor_and_move_the_limit(demo: Demo) -> None:
    limit = demo.world.limit
    demo.change_dt(1)
    assert demo.world.scene.method.dt == pytest.approx(0.0125)
    demo.change_dt(-1)
    assert demo.world.scene.method.dt == pytest.approx(0.01)
    demo.change_stiffness(1)
    assert demo.world.scene.springs is not None
    assert demo.world.scene.springs.stiffness == pytest.approx(12.5)
    assert demo.world.limit < limit  # a stiffer spring swings faster
    assert "12.5 N/m" in demo.message


def test_over_the_limit_it_diverges_freezes_and_restarts(demo: Demo) -> None:
    demo.toggle_gravity()
    for _ in range(8):
        demo.change_dt(1)
    assert demo.over_limit and "OVER" in demo.message
    for _ in range(2000):
        demo.frame()
        if demo.frozen:
            break
    assert demo.frozen and "diverged at step" in demo.failure and "use dt <=" in demo.failure
    picture, step = demo.positions[0].copy(), demo.world.step
    assert np.isfinite(picture).all()
    assert np.abs(picture).max() <= 3 * 8  # what is shown still fits the window
    for action in (demo.toggle_gravity, demo.switch_backend, demo.cycle_threads, demo.press_key):
        action()
        assert "R" in demo.message
    demo.change_dt(-20)
    demo.frame()
    assert demo.world.step == step
    np.testing.assert_array_equal(demo.positions[0], picture)
    demo.restart()
    demo.frame()
    assert not demo.frozen and demo.failure == "" and demo.world.step == 10
    assert demo.world.scene.method.dt == 0.01 and not demo.gravity  # as the scene says


def test_an_impossible_setting_is_a_message(demo: Demo) -> None:
    demo.change_dt(-2000)  # float32 cannot hold it
    assert "method.dt" in demo.message and demo.world.scene.method.dt == 0.01
    demo.frame()
    assert demo.world.step == 10


def test_dragging_pulls_a_mass_to_the_pointer_and_lets_go(demo: Demo) -> None:
    particle = 6 * 8 + 4
    x, y = demo.positions[0][particle].astype(float)
    camera = Camera2D(800, 600, x, y, 30.0)
    assert pick(camera, demo.position, *camera.to_window(np.array([x + 50, y])), 15.0) is None  # nothing there
    assert pick(camera, demo.position, *camera.to_window(np.array([x + 0.1, y])), 15.0) == particle
    assert demo.take(particle, (x + 0.1, y))
    assert demo.picker.selected == particle
    demo.drag(x + 3, y - 2)
    demo.frame()
    assert demo.force()[0] > 0 > demo.force()[1]
    places = []
    for _ in range(60):  # the net swings about where it is pulled to, and where it is after so many frames is chance
        demo.frame()
        places.append(demo.positions[0][particle].copy())
    pulled = np.mean(places, axis=0)
    assert pulled[0] > x + 0.3 and pulled[1] < y - 0.2
    assert not demo.frozen
    demo.release()
    assert demo.force() == (0.0, 0.0)
    for _ in range(300):
        demo.frame()
    assert demo.world.energies()["kinetic"] < 1e-3  # nothing pushes any more, and the dampers have worked for 30 s


def test_a_drag_brings_no_energy_explosion_where_no_spring_holds() -> None:
    with Demo([Scene({"grid": {"rows": 1, "columns": 1}, "damping": {}})]) as demo:
        demo.take(0, (0.0, 0.0))
        demo.drag(5.0, 0.0)
        for _ in range(400):
            demo.frame()
        np.testing.assert_allclose(demo.positions[0], [[5, 0]], atol=0.05)


def test_arrows_select_and_enter_pokes_the_last_arrows_way(demo: Demo) -> None:
    demo.press_key()  # with nothing selected: the middle mass, downward
    assert demo.picker.selected == 4 * 8 + 4
    assert demo.force()[0] == 0 > demo.force()[1]
    demo.release()
    demo.move_selection(1, 0)
    assert demo.picker.selected == 4 * 8 + 5
    demo.press_key()
    assert demo.force()[0] > 0 == demo.force()[1]
    before = demo.positions[0][37, 0]
    demo.frame()
    assert demo.positions[0][37, 0] > before
    demo.release()
    for _ in range(20):
        demo.move_selection(0, 1)
    assert demo.picker.selected == 5  # stops at the top row
    for _ in range(20):
        demo.move_selection(1, 0)
    assert demo.picker.selected == 7 and "pinned" in demo.message


def test_threads_change_and_the_state_goes_on(demo: Demo) -> None:
    demo.toggle_gravity()
    demo.frame()
    before = demo.positions[0].copy()
    threads = demo.world.threads
    demo.cycle_threads()
    assert demo.threads == "2x" and demo.world.threads == 2 * threads and demo.world.step == 10 and demo.gravity
    np.testing.assert_array_equal(demo.world.read("position"), before)
    demo.cycle_threads()
    demo.cycle_threads()
    assert demo.threads == "1x"


def test_a_held_poke_survives_a_reopening(demo: Demo) -> None:
    demo.press_key()
    demo.cycle_threads()
    before = demo.positions[0][36, 1]
    demo.frame()
    assert demo.positions[0][36, 1] < before


def test_without_a_gpu_the_remedy_is_shown_and_the_cpu_goes_on(demo: Demo) -> None:
    demo.switch_backend()
    assert demo.message == "no GPU here; get one"
    demo.frame()
    assert demo.backend == "cpu" and demo.world.step == 10


def test_a_backend_that_is_there_takes_the_state() -> None:
    asked: list[str] = []

    def open_any(scene: Scene, backend: str, **options: Any) -> Any:
        asked.append(backend)
        return open_simulation(scene, "cpu", **options)

    with Demo([Scene(TABLES)], open_world=open_any) as demo:
        demo.toggle_gravity()
        demo.frame()
        state = demo.world.state()
        demo.switch_backend()
        assert asked == ["cpu", "gpu"] and demo.backend == "gpu" and demo.gravity
        np.testing.assert_array_equal(demo.world.state().velocity, state.velocity)
        demo.cycle_threads()
        assert "threads apply to the cpu" in demo.message
        demo.switch_backend()
        assert demo.backend == "cpu"


def test_the_camera_goes_there_and_back() -> None:
    camera = Camera2D(800, 600, 3.0, -4.0, 25.0)
    assert camera.on_plane(*camera.to_window(np.array([1.5, 2.5])), camera.target) == pytest.approx((1.5, 2.5))
    place = camera.on_plane(100, 500, camera.target)
    camera.zoom(3.0, 100, 500)
    assert camera.on_plane(100, 500, camera.target) == pytest.approx(place)  # the place under the pointer stays
    camera.pan(40, -20)
    assert camera.on_plane(140, 480, camera.target) == pytest.approx(place)
    clip = camera.matrix() @ (*place, 0.0, 1.0)  # the shaders see it where the pointer does
    np.testing.assert_allclose((clip[:2] + 1) / 2 * (800, 600), (140, 480), atol=1e-9)
    framed = camera.framing((-1, -2, 9, 30), (50, 60, 70, 80), 1.0)
    corners = framed.to_window(np.array([[-1, -2], [9, 30]]))
    assert (corners[0] >= (49.9, 59.9)).all() and (corners[1] <= (730.1, 520.1)).all()


def test_bounds_and_picking_skip_what_is_not_finite() -> None:
    position = np.array([[np.nan, 0], [1, 2], [3, -4], [np.inf, 0]], dtype=np.float32)
    assert finite_bounds(position) == (1, -4, 3, 2)
    assert finite_bounds(position[:1]) is None
    camera = Camera2D(400, 300, scale=10.0)
    assert pick(camera, position, *camera.to_window(np.array([1.2, 2])), 5.0) == 1
    assert pick(camera, position, *camera.to_window(np.array([1.2, 3])), 5.0) is None


def test_colours_run_from_blue_over_grey_to_red_and_the_range_is_round() -> None:
    np.testing.assert_allclose(strain_colours(np.array([-2, -1, -0.5, 0, 0.5, 1, 2]), 1.0)[1:-1], STOPS)
    assert strain_range(np.linspace(-0.3, 0.31, 1000)) == pytest.approx(0.5)
    assert strain_range(np.zeros(5)) == pytest.approx(0.01)
    assert strain_range(np.array([np.nan])) == pytest.approx(0.01)
    assert strain_range(np.full(9, 0.2)) == pytest.approx(0.2)
