"""The position-based solvers on a real GPU: the CPU's bits in `exact` math, for every ordering and kernel, and a bounded
`fast`."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from xpbd_scenes import poke_of, xpbd_scene

from softlab.app.driver import open_simulation
from softlab.model.base.errors import Diverged, SceneError
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

pytestmark = pytest.mark.gpu
STEPS = 60
ORDERINGS = ("gauss-seidel", "jacobi", "averaged-jacobi")


def end_state(scene: Scene, backend: str, steps: int = STEPS, poke: bool = True, **options: Any) -> State:
    live = ("poke",) if poke else ()
    with open_simulation(scene, backend, live=live, allow_unstable=True, **options) as simulation:
        if poke:
            simulation.poke(*poke_of(scene))
        simulation.advance(steps // 3)
        simulation.advance(steps - steps // 3)
        return simulation.state()


def assert_same(state: State, expected: State, what: object) -> None:
    assert np.array_equal(state.position, expected.position), what
    assert np.array_equal(state.velocity, expected.velocity), what


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("ordering", ORDERINGS)
@pytest.mark.parametrize("name", ["springs", "everything"])
def test_exact_math_gives_the_bits_of_the_cpu(name: str, ordering: str, precision: str) -> None:
    """Every kernel, on a sheet that neither a block nor a warp divides, and on ones that a block holds."""
    for rows, columns, kernels in (
        (37, 45, ("graph", "launch", "tiled:8x8x160d2", "tiled:24x16x512d1")),
        (29, 31, ("one-block", "tiled:8x16x256d3")),
        (7, 6, ("stages", "one-block")),
    ):
        scene = xpbd_scene(name, ordering, rows=rows, columns=columns)
        expected = end_state(scene, "cpu", precision=precision, math="exact")
        for kernel in kernels:
            state = end_state(scene, "gpu", precision=precision, math="exact", kernel=kernel)
            assert_same(state, expected, (kernel, rows, columns))


@pytest.mark.parametrize("ordering", ORDERINGS)
@pytest.mark.parametrize(
    "name", ["rigid", "free", "damped", "air", "loaded", "bodies", "held", "pbd", "bare", "grid", "alternating", "net"]
)
def test_single_parts_give_the_bits_of_the_cpu(name: str, ordering: str) -> None:
    scene = xpbd_scene(name, ordering)
    expected = end_state(scene, "cpu", math="exact")
    for kernel in ("graph", "tiled", "one-block"):
        assert_same(end_state(scene, "gpu", math="exact", kernel=kernel), expected, kernel)


@pytest.mark.parametrize("rows,columns", [(1, 1), (1, 7), (7, 1), (2, 2), (1, 33), (64, 64), (1, 300)])
@pytest.mark.parametrize("ordering", ["gauss-seidel", "jacobi"])
def test_sheets_of_every_shape(ordering: str, rows: int, columns: int) -> None:
    scene = xpbd_scene("air", ordering, rows=rows, columns=columns, pinned="none")
    expected = end_state(scene, "cpu", poke=False, math="exact")
    for kernel in ("graph", "tiled", "one-block", None):
        assert_same(end_state(scene, "gpu", poke=False, math="exact", kernel=kernel), expected, kernel)


def test_tiles_and_colours_agree_on_a_large_sheet() -> None:
    """More tiles than the GPU runs at once, so that an order between blocks would show."""
    scene = xpbd_scene("springs", rows=701, columns=650)
    expected = end_state(scene, "gpu", steps=6, math="exact", kernel="graph")
    for kernel in (None, "tiled:16x16x384d1", "tiled:8x8x480d2"):
        assert_same(end_state(scene, "gpu", steps=6, math="exact", kernel=kernel), expected, kernel)


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("ordering", ORDERINGS)
@pytest.mark.parametrize("kernel", ["graph", "tiled", "one-block"])
def test_fast_math_stays_within_rounding(kernel: str, ordering: str, precision: str) -> None:
    """A substep rounds each position some 4 times an iteration and constraint, 12 of them, by an epsilon of the scale, the
    approximate root included. The velocity is the difference over h: a rounding of the position is fed back whole, so that n
    substeps may add up to n^2/2 such errors; the sheet's own damping and the constraints' take most of that away."""
    scene = xpbd_scene("air", ordering, rows=20, columns=22)
    exact = end_state(scene, "cpu", precision=precision, math="exact")
    fast = end_state(scene, "gpu", precision=precision, math="fast", kernel=kernel)
    substeps = STEPS * scene.method.substeps
    bound = substeps**2 / 2 * 4 * np.finfo(precision).eps * float(np.abs(exact.position).max())
    assert np.abs(fast.position - exact.position).max() < bound


@pytest.mark.parametrize("kernel", ["tiled", "one-block"])
@pytest.mark.parametrize("ordering", ["gauss-seidel", "jacobi"])
def test_multipliers_stay_in_registers(ordering: str, kernel: str) -> None:
    """A register or four may be spilled; the array of multipliers is 48 (tiles of one a thread) or 96 bytes."""
    with open_simulation(xpbd_scene("springs", ordering, rows=32, columns=32), "gpu", kernel=kernel) as simulation:
        launcher = simulation._block or simulation._tiled
        for compiled in launcher._kernel.overloads.values():
            assert compiled.local_mem_per_thread <= 16


def test_a_divergence_is_found_at_the_same_step_and_particle() -> None:
    scene = xpbd_scene("bare", substeps=1).replace({"gravity.acceleration": 1e7, "method.dt": 1.0})
    found = []
    for backend, kernel in (("cpu", None), ("gpu", "graph"), ("gpu", "one-block"), ("gpu", "tiled")):
        with open_simulation(scene, backend, math="exact", kernel=kernel, allow_unstable=True) as simulation:
            with pytest.raises(Diverged) as caught:
                simulation.advance(2000)
                simulation.check()
            assert np.isfinite(simulation.state().position).all()
            found.append((caught.value.step, caught.value.particle))
    assert len(set(found)) == 1


@pytest.mark.parametrize("name", ["springs", "grid"])
def test_positions_go_into_device_arrays(name: str) -> None:
    from numba import cuda

    scene = xpbd_scene(name, rows=33, columns=35)
    with open_simulation(scene, "gpu", precision="float64") as simulation:
        simulation.advance(30)
        target = cuda.device_array((33 * 35, scene.dimensions), np.float32)
        simulation.read("position", into=target)
        assert np.array_equal(target.copy_to_host(), simulation.read("position").astype(np.float32))
        if scene.cloth:
            simulation.read("normal", into=target)
            assert np.array_equal(target.copy_to_host(), simulation.read("normal").astype(np.float32))


def test_live_changes_reach_captured_graphs() -> None:
    scene = xpbd_scene("springs", rows=20, columns=20)
    states = []
    for backend, kernel in (("cpu", None), ("gpu", "graph"), ("gpu", "tiled"), ("gpu", "one-block")):
        with open_simulation(scene, backend, math="exact", kernel=kernel, live=("gravity", "dt")) as simulation:
            simulation.advance(10)
            simulation.set("gravity.enabled", False)
            simulation.advance(11)
            simulation.set("method.dt", 0.003)
            simulation.advance(12)
            states.append(simulation.state())
    for state in states[1:]:
        assert_same(state, states[0], "live")


def test_a_state_moves_between_backends_without_a_trace() -> None:
    scene = xpbd_scene("everything", iterations=5)
    with open_simulation(scene, "cpu", math="exact", allow_unstable=True) as cpu:
        cpu.advance(7)
        half = cpu.state()
        cpu.advance(12)
        whole = cpu.state()
    with open_simulation(scene, "gpu", math="exact", allow_unstable=True) as gpu:
        gpu.load(half)
        gpu.advance(12)
        assert_same(gpu.state(), whole, "from the CPU")


def test_a_sheet_too_large_for_one_block_is_refused() -> None:
    with pytest.raises(SceneError, match="at most 4096"):
        open_simulation(xpbd_scene("springs", rows=65, columns=64), "gpu", kernel="one-block")
