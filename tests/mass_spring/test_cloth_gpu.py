"""The cloth on a real GPU: the CPU's bits in `exact` math, for every integrator and kernel, and a bounded `fast`."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from cloth_scenes import POKE, cloth_scene

from softlab.app.driver import open_simulation
from softlab.model.base.errors import Diverged, SceneError
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene, load_scene

pytestmark = pytest.mark.gpu
STEPS = 300
ONE_FORCE = [name for name in INTEGRATORS if name != "rk4"]


def scene_of(name: str, integrator: str, **changes: Any) -> Scene:
    """Explicit Euler and the compute shader's step are unstable from small steps on: 300 of these stay finite."""
    scene = cloth_scene(name, integrator, **changes)
    return scene.replace({"method.dt": 1e-5}) if integrator in ("explicit-euler", "taylor") else scene


def end_state(scene: Scene, backend: str, steps: int = STEPS, poke: bool = True, **options: Any) -> State:
    live = ("poke",) if poke else ()
    with open_simulation(scene, backend, live=live, allow_unstable=True, **options) as simulation:
        if poke:
            simulation.poke(*POKE)
        simulation.advance(steps // 3)
        simulation.advance(steps - steps // 3)
        return simulation.state()


def assert_same(state: State, expected: State, what: object) -> None:
    assert np.array_equal(state.position, expected.position), what
    assert np.array_equal(state.velocity, expected.velocity), what


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("name", ["springs", "everything"])
def test_exact_math_gives_the_bits_of_the_cpu(name: str, integrator: str, precision: str) -> None:
    """Every kernel, on a sheet that neither a block nor a warp divides, and on one that one block holds."""
    for rows, columns, kernels in ((37, 45, ("graph", "launch")), (29, 31, ("one-block",)), (7, 6, ("stages",))):
        scene = scene_of(name, integrator, rows=rows, columns=columns)
        expected = end_state(scene, "cpu", precision=precision, math="exact")
        for kernel in kernels:
            if kernel == "one-block" and integrator == "rk4":
                continue
            state = end_state(scene, "gpu", precision=precision, math="exact", kernel=kernel)
            assert_same(state, expected, (kernel, rows, columns))


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("name", ["damped", "random", "air", "bodies", "bare"])
def test_single_parts_give_the_bits_of_the_cpu(name: str, precision: str) -> None:
    scene = scene_of(name, "velocity-verlet")
    expected = end_state(scene, "cpu", precision=precision, math="exact")
    for kernel in ("graph", "launch", "one-block", "stages"):
        assert_same(end_state(scene, "gpu", precision=precision, math="exact", kernel=kernel), expected, kernel)


@pytest.mark.parametrize("name", ["cloth-hanging", "cloth-wind", "cloth-sphere"])
def test_the_catalogues_cloths_give_the_bits_of_the_cpu(name: str) -> None:
    scene = load_scene(name)
    expected = end_state(scene, "cpu", steps=600, poke=False, math="exact")
    for kernel in ("graph", "one-block"):
        assert_same(end_state(scene, "gpu", steps=600, poke=False, math="exact", kernel=kernel), expected, kernel)


@pytest.mark.parametrize("rows,columns", [(1, 1), (1, 7), (7, 1), (2, 2), (1, 33), (32, 32)])
def test_sheets_of_every_shape(rows: int, columns: int) -> None:
    scene = scene_of("air", "velocity-verlet", rows=rows, columns=columns, pinned="none")
    expected = end_state(scene, "cpu", poke=False, math="exact")
    for kernel in ("graph", "one-block"):
        assert_same(end_state(scene, "gpu", poke=False, math="exact", kernel=kernel), expected, kernel)


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("kernel", ["graph", "one-block"])
def test_fast_math_stays_within_rounding(kernel: str, integrator: str, precision: str) -> None:
    """A step rounds a position of that scale, its forces a few epsilon each; a damped cloth with its springs near their
    rest length is contracting over so short a time, so that n steps add up to 4 n epsilon of the scale. The velocity of
    the hand-out's step is (p' - p)/dt: it feeds the rounding of p back as eps p/dt, from which every later step moves on
    by eps p: n^2/2 of them, since its damping forgets little in 300 steps."""
    if kernel == "one-block" and integrator == "rk4":
        pytest.skip("one-block supports integrators with one force evaluation per step")
    scene = scene_of("air", integrator, rows=20, columns=22)
    exact = end_state(scene, "cpu", precision=precision, math="exact")
    fast = end_state(scene, "gpu", precision=precision, math="fast", kernel=kernel)
    bound = 4 * STEPS * np.finfo(precision).eps * float(np.abs(exact.position).max())
    if integrator == "lab":
        bound *= STEPS / 8
    assert np.abs(fast.position - exact.position).max() < bound


def test_colliders_hold_in_fast_math() -> None:
    """What masses may not enter they do not, whichever way a rounding went: no nearer than the thickness less a few
    epsilon of a coordinate, and the sheet has come down on the ball by then."""
    scene = load_scene("cloth-sphere")
    with open_simulation(scene, "gpu", math="fast") as simulation:
        simulation.advance(2000)
        position = simulation.state().position.astype(np.float64)
    ball, thickness = scene.colliders[1][1], scene.colliders[1][1].thickness
    gap = np.linalg.norm(position - ball.center, axis=1) - ball.radius
    least = thickness - 8 * np.finfo(np.float32).eps
    assert least < gap.min() < thickness + 0.01


def test_passes_spill_nothing_and_keep_no_local_memory() -> None:
    with open_simulation(scene_of("everything", "velocity-verlet", rows=40, columns=40), "gpu") as simulation:
        for kernel in simulation._passes.values():
            for compiled in kernel.overloads.values():
                assert compiled.local_mem_per_thread == 0


def test_a_divergence_is_found_at_the_same_step_and_particle() -> None:
    scene = cloth_scene("springs", "velocity-verlet").replace({"method.dt": 0.05})
    found = []
    for backend in ("cpu", "gpu"):
        with open_simulation(scene, backend, math="exact", allow_unstable=True) as simulation:
            with pytest.raises(Diverged) as caught:
                simulation.advance(2000)
                simulation.check()
            assert np.isfinite(simulation.state().position).all()
            found.append((caught.value.step, caught.value.particle))
    assert found[0] == found[1]


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_positions_and_normals_go_into_device_arrays(precision: str) -> None:
    from numba import cuda

    scene = scene_of("springs", "velocity-verlet", rows=33, columns=35)
    with open_simulation(scene, "gpu", precision=precision) as simulation:
        simulation.advance(30)
        target = cuda.device_array((33 * 35, 3), np.float32)
        simulation.read("position", into=target)
        assert np.array_equal(target.copy_to_host(), simulation.read("position").astype(np.float32))
        simulation.read("normal", into=target)
        normal = simulation.read("normal")
        assert np.array_equal(target.copy_to_host(), normal.astype(np.float32))
        length = np.linalg.norm(normal.astype(np.float64), axis=1)
        assert np.abs(length - 1).max() < 4 * np.finfo(precision).eps


def test_live_changes_reach_captured_graphs() -> None:
    scene = load_scene("cloth-hanging")
    states = []
    for backend, kernel in (("cpu", None), ("gpu", "graph"), ("gpu", "one-block")):
        with open_simulation(scene, backend, math="exact", kernel=kernel, live=("gravity", "dt")) as simulation:
            simulation.advance(100)
            simulation.set("gravity.enabled", False)
            simulation.advance(100)
            simulation.set("method.dt", 0.0012)
            simulation.advance(100)
            states.append(simulation.state())
    assert_same(states[1], states[0], "graph")
    assert_same(states[2], states[0], "one-block")


def test_a_state_moves_between_backends_without_a_trace() -> None:
    scene = scene_of("everything", "velocity-verlet")
    with open_simulation(scene, "cpu", math="exact", allow_unstable=True) as cpu:
        cpu.advance(77)
        half = cpu.state()
        cpu.advance(123)
        whole = cpu.state()
    with open_simulation(scene, "gpu", math="exact", allow_unstable=True) as gpu:
        gpu.load(half)
        gpu.advance(123)
        assert_same(gpu.state(), whole, "from the CPU")


def test_a_sheet_too_large_for_one_block_is_refused() -> None:
    with pytest.raises(SceneError, match="at most 1024"):
        open_simulation(scene_of("springs", "lab", rows=33, columns=32), "gpu", kernel="one-block")
