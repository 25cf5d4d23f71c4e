"""CUDA on a real GPU: the same bits as the CPU in `exact` math, and a bounded difference in `fast`.

The tolerance of `fast`: a step's arithmetic commits a relative rounding of a few epsilon (fused and approximate
operations: 2 ulp for the reciprocal root) in accelerations of at most a_max, so after n steps of dt a damped, hence
contracting, motion (docs/method/cases.md, fact 5) is off by at most about n * (epsilon * position scale), summed linearly.
"""

from __future__ import annotations

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.base.errors import Diverged, SceneError
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene, load_scene

pytestmark = pytest.mark.gpu


def busy_scene(integrator: str, rows: int = 37, columns: int = 61) -> Scene:
    """Every part that the lab grid can have, on a grid that no block divides."""
    return load_scene("lab-grid").replace(
        {
            "grid.rows": rows,
            "grid.columns": columns,
            "grid.pinned": "every:7",
            "external.magnitude": 0.05,
            "external.seed": 2**40 + 17,
            "perturbation.amplitude": 0.05,
            "method.integrator": integrator,
            "method.dt": 0.0003 if integrator in ("explicit-euler", "taylor") else 0.01,
        }
    )


def end_state(scene: Scene, backend: str, steps: int, **options: object) -> State:
    with open_simulation(scene, backend, live=("poke",), **options) as simulation:  # type: ignore[arg-type]
        simulation.poke(scene.grid.columns + 1, (0.05, -0.02))
        simulation.advance(steps // 3)
        simulation.advance(steps - steps // 3)
        return simulation.state()


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_exact_math_gives_the_bits_of_the_cpu(integrator: str, precision: str) -> None:
    scene = busy_scene(integrator)
    expected = end_state(scene, "cpu", 1000, precision=precision, math="exact")
    for kernel in ("graph", "launch"):
        state = end_state(scene, "gpu", 1000, precision=precision, math="exact", kernel=kernel)
        assert np.array_equal(state.position, expected.position), kernel
        assert np.array_equal(state.velocity, expected.velocity), kernel


ONE_FORCE = [name for name in INTEGRATORS if name != "rk4"]


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("integrator", ONE_FORCE)
def test_one_block_gives_the_bits_of_the_cpu(integrator: str, precision: str) -> None:
    for rows, columns in ((29, 31), (32, 32), (3, 2)):
        scene = busy_scene(integrator, rows, columns)
        expected = end_state(scene, "cpu", 1000, precision=precision, math="exact")
        state = end_state(scene, "gpu", 1000, precision=precision, math="exact", kernel="one-block")
        assert np.array_equal(state.position, expected.position), (rows, columns)
        assert np.array_equal(state.velocity, expected.velocity), (rows, columns)


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("integrator", ONE_FORCE)
def test_tiles_give_the_bits_of_the_cpu(integrator: str, precision: str) -> None:
    """Several tiles each way, an edge that cuts strips, a number of steps that does not fill the last pass."""
    scene = busy_scene(integrator, 101, 93)
    expected = end_state(scene, "cpu", 1001, precision=precision, math="exact")
    for kernel in ("tiles:32x8x4h4", "resident:32x8x4h4", "resident:24x7x3h1"):
        state = end_state(scene, "gpu", 1001, precision=precision, math="exact", kernel=kernel)
        assert np.array_equal(state.position, expected.position), kernel
        assert np.array_equal(state.velocity, expected.velocity), kernel


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_every_tile_of_the_table_gives_the_bits_of_a_launch_a_step(precision: str) -> None:
    """Also where two blocks share a multiprocessor, and where tiles are as large as shared memory."""
    from softlab.gpu_backend.core.tiling import parsed_tile
    from softlab.gpu_backend.mass_spring.grid.choice import RESIDENT, TILES
    from softlab.gpu_backend.mass_spring.grid.tile_launch import why_no_tile

    real = np.float32 if precision == "float32" else np.float64
    for name in [*RESIDENT[real], TILES[real][0]]:
        rung = "resident" if name in RESIDENT[real] else "tiles"
        tile = parsed_tile(name)
        sizes = [n for n in (1000, 500, 250, 120) if rung == "tiles" or not why_no_tile(rung, n, n, real, tile)]
        scene = load_scene("lab-grid").replace({"grid.rows": sizes[0], "grid.columns": sizes[0] + 1})
        states = []
        for kernel in ("launch", f"{rung}:{name}"):
            with open_simulation(scene, "gpu", precision=precision, math="exact", kernel=kernel) as simulation:
                simulation.advance(150)
                states.append(simulation.state())
        assert np.array_equal(states[0].position, states[1].position), name
        assert np.array_equal(states[0].velocity, states[1].velocity), name


@pytest.mark.parametrize("kernel", ["one-block", "tiles:32x8x4h4", "resident:32x8x4h4"])
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_tiles_in_fast_math_stay_within_rounding(kernel: str, precision: str) -> None:
    """Beside test_fast_math_stays_within_rounding, whose bound this is."""
    side = 30 if kernel == "one-block" else 70
    scene = busy_scene("lab", side, side + 1)
    exact = end_state(scene, "cpu", 300, precision=precision, math="exact")
    fast = end_state(scene, "gpu", 300, precision=precision, math="fast", kernel=kernel)
    scale = float(np.abs(exact.position).max())
    bound = 4 * 300 * np.finfo(precision).eps * scale / (scene.method.dt * 1.5)
    assert np.abs(fast.position - exact.position).max() < bound


def test_tiles_spill_nothing_into_local_memory() -> None:
    """float32 `tiles` and small `resident` tiles; the largest, which fill the registers, may put a few numbers aside."""
    for kernel, side, most in (("one-block", 32, 0), ("tiles:64x8x8h4", 200, 0), ("resident:32x8x4h8", 128, 0)):
        scene = load_scene("lab-grid").replace({"grid.rows": side, "grid.columns": side})
        with open_simulation(scene, "gpu", kernel=kernel) as simulation:
            (compiled,) = simulation._tiles._kernel.overloads.values()
            assert compiled.local_mem_per_thread <= most, kernel


def test_a_grid_too_large_for_one_block_is_refused() -> None:
    scene = load_scene("lab-grid").replace({"grid.rows": 400, "grid.columns": 400})
    with pytest.raises(SceneError, match="do not fit"):
        open_simulation(scene, "gpu", kernel="one-block")


@pytest.mark.parametrize("integrator", ["lab", "velocity-verlet", "rk4"])
def test_stage_by_stage_gives_the_same_bits(integrator: str) -> None:
    scene = busy_scene(integrator, 9, 13)
    expected = end_state(scene, "cpu", 60, math="exact")
    state = end_state(scene, "gpu", 60, math="exact", kernel="stages")
    assert np.array_equal(state.position, expected.position)
    assert np.array_equal(state.velocity, expected.velocity)


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_fast_math_stays_within_rounding(integrator: str, precision: str) -> None:
    scene = busy_scene(integrator)
    steps = 300
    exact = end_state(scene, "cpu", steps, precision=precision, math="exact")
    fast = end_state(scene, "gpu", steps, precision=precision, math="fast")
    scale = float(np.abs(exact.position).max())
    bound = 4 * steps * np.finfo(precision).eps * scale
    if integrator == "lab":  # its (p' - p)/dt feeds the rounding of p back as a velocity: eps p / dt, damped at c/2m
        bound *= 1 / (scene.method.dt * 1.5)
    assert np.abs(fast.position - exact.position).max() < bound


def test_a_divergence_is_found_at_the_same_step_and_particle() -> None:
    scene = load_scene("lab-grid").replace({"method.dt": 0.04, "external.magnitude": 0.1})
    found = []
    for backend in ("cpu", "gpu"):
        with open_simulation(scene, backend, math="exact", allow_unstable=True) as simulation:
            with pytest.raises(Diverged) as caught:
                simulation.advance(2000)
                simulation.check()
            assert np.isfinite(simulation.state().position).all()
            found.append((caught.value.step, caught.value.particle))
    assert found[0] == found[1]


def test_positions_go_into_a_device_array() -> None:
    from numba import cuda

    with open_simulation(load_scene("lab-grid"), "gpu") as simulation:
        simulation.advance(10)
        target = cuda.device_array((1024, 2), np.float32)
        simulation.read("position", into=target)
        assert np.array_equal(target.copy_to_host(), simulation.read("position"))


def test_live_changes_reach_captured_graphs() -> None:
    scene = load_scene("lab-grid")
    states = []
    for backend in ("cpu", "gpu"):
        with open_simulation(scene, backend, math="exact", live=("gravity", "dt", "stiffness")) as simulation:
            simulation.advance(100)
            simulation.set("gravity.enabled", False)
            simulation.advance(100)
            simulation.set("method.dt", 0.012)
            simulation.set("springs.stiffness", 12.0)
            simulation.advance(100)
            states.append(simulation.state())
    assert np.array_equal(states[0].position, states[1].position)
    assert states[0].time == pytest.approx(3.2)


def test_a_state_moves_between_backends_without_a_trace() -> None:
    scene = busy_scene("velocity-verlet")
    whole = end_state(scene, "cpu", 0, math="exact")
    with open_simulation(scene, "cpu", math="exact") as cpu:
        cpu.advance(200)
        whole = cpu.state()
    with open_simulation(scene, "cpu", math="exact") as cpu, open_simulation(scene, "gpu", math="exact") as gpu:
        cpu.advance(77)
        gpu.load(cpu.state())
        gpu.advance(123)
        assert np.array_equal(gpu.state().position, whole.position)
        assert gpu.step == 200
