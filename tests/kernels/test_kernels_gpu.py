"""CUDA kernels of all solvers on a real GPU: `fast` math stays near `exact` and repeats to the bit, a divergence is found
where the CPU finds it, device arrays are filled, registers suffice, what is too large is refused."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import bodies_scenes
import numpy as np
import pytest
from bits_row import GPU, ONE, PRECISIONS, Row, different
from bits_rows import wide_grid
from bits_sheets import BUSY, DOUBLE, ORDERINGS, SINGLE, UNSTABLE, cloth, grid, sheet, with_one_force
from cloth_scenes import POKE, cloth_scene
from flow_scenes import FLOWS
from kernel_scenes import DIVERGING, REFUSED_BY_A_GPU, first_diverged
from meeting_bodies import meeting
from newton_scenes import bar, shaken
from xpbd_scenes import xpbd_scene

from softlab.app.driver import open_simulation
from softlab.model.base.errors import SceneError
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.scene.scene import Scene, load_scene

pytestmark = pytest.mark.gpu
Bound = Callable[[Scene, float, float], float]  # of a scene, its precision's epsilon and the largest coordinate [m]
STEPS = 300
FEW = (60, 100)  # steps of constraints, of windows


def summed(steps: int) -> Bound:
    """Of a contracting motion: a few roundings of a coordinate a step, which add up."""
    return lambda scene, epsilon, scale: 4 * steps * epsilon * scale


def of_lab_grids(scene: Scene, epsilon: float, scale: float) -> float:
    """Its (p' - p)/dt feeds the rounding of p back as a velocity: eps p / dt, damped at c/2m."""
    return summed(STEPS)(scene, epsilon, scale) / (scene.method.dt * 1.5)


def of_lab_cloths(scene: Scene, epsilon: float, scale: float) -> float:
    """As before, but the damping forgets little in 300 steps: n^2/2 roundings."""
    return summed(STEPS)(scene, epsilon, scale) * STEPS / 8


def of_constraints(scene: Scene, epsilon: float, scale: float) -> float:
    """A substep rounds a position some 4 times an iteration and constraint. The velocity is the difference over h: a rounding
    of the position is fed back whole, so that n substeps may add up to n^2/2 of them."""
    return (FEW[0] * scene.method.substeps) ** 2 / 2 * 4 * epsilon * scale


def of_bodies(size: float) -> Bound:
    """Approximate roots and quotients of 2^-22: 10 substeps whose errors grow with the square of their number."""
    return lambda scene, epsilon, scale: 100 * 30 * size * 2.0**-22


def fast_rows() -> Iterator[tuple[Row, Bound]]:
    """Rows and how far their positions may differ from those of exact math."""
    busy = BUSY | {"grid.pinned": "every:7", "external.seed": 2**40 + 17}
    steps: dict[str, Any] = {"steps": {GPU: STEPS}, "more": ()}
    for integrator in INTEGRATORS:
        dt, lab = 0.0003 if integrator in UNSTABLE else 0.01, integrator == "lab"
        scene = partial(grid, integrator, 37, 61, busy, dt)
        yield (
            Row(f"grid {integrator}", scene, poke=(62, (0.05, -0.02)), kernels=ONE, **steps),
            of_lab_grids if lab else summed(STEPS),
        )  # fmt: skip
        kernels = ("graph", *with_one_force(integrator, "one-block"))
        scene = partial(cloth, "air", integrator, 20, 22)
        yield (
            Row(f"cloth {integrator}", scene, poke=POKE, kernels=kernels, **steps),
            of_lab_cloths if lab else summed(STEPS),
        )  # fmt: skip
    for kernel, side in (("one-block", 30), ("tiles:32x8x4h4", 70), ("resident:32x8x4h4", 70)):
        scene = partial(grid, "lab", side, side + 1, busy, 0.01)
        yield Row(f"grid {kernel}", scene, poke=(side + 2, (0.05, -0.02)), kernels=(kernel,), **steps), of_lab_grids
    kernels, scene = ("resident:8x8x1h1", "resident:16x4x2h2"), partial(cloth, "random", "velocity-verlet", 20, 22)
    yield Row("cloth resident", scene, poke=POKE, kernels=kernels, **steps), summed(STEPS)
    for ordering in ORDERINGS:
        scene = sheet("air", ordering, rows=20, columns=22)
        kernels = ("tiled", "one-block")
        yield Row(f"sheet {ordering}", scene, {GPU: FEW[0]}, poke=POKE, kernels=kernels), of_constraints
    few: dict[str, Any] = {"kernels": ONE, "usual": {GPU: SINGLE}}
    # approximate roots, 2^-22 of a length each, in 12 steps of 10 substeps that add up at worst, of lengths of 1 m
    yield Row("garment", lambda: load_scene("cloth-mesh"), {GPU: 12}, **few), lambda *_: 3e-5
    yield Row("bodies", bodies_scenes.everything, {GPU: 5}, **few), of_bodies(2)
    yield Row("lattices", bodies_scenes.blocks, {GPU: 5}, **few), of_bodies(4)
    # some 100 operations a step, of coordinates of 70 m at most
    yield Row("windows", partial(wide_grid, 1, 2, 1), {GPU: FEW[1]}, **few), lambda *_: 1e4 * 70 * 2.0**-24


@pytest.mark.parametrize(
    "row, precision, bound",
    [
        pytest.param(row, precision, bound, id=f"{row.name}-{precision}".replace(" ", "-"))
        for row, bound in fast_rows()
        for precision in row.usual.get(GPU, PRECISIONS)
    ],
)
def test_fast_math_stays_near_exact(row: Row, precision: str, bound: Bound) -> None:
    exact, _ = row.ended(GPU, precision=precision)
    scale, epsilon = float(np.abs(exact.position).max()), float(np.finfo(precision).eps)
    for kernel in row.kernels_of(GPU):
        fast, _ = row.ended(GPU, "gpu", precision=precision, kernel=kernel, math="fast")
        assert np.abs(fast.position - exact.position).max() < bound(row.scene(), epsilon, scale), kernel


def test_implicit_steps_in_fast_math_are_solved_as_far() -> None:
    """A Newton step is solved to some part of 1e-2 in both, and what is left then differs: of velocities, by as much as the
    last residual, 1e-8 of the first, which is v + dt a < 10 m/s a mass; 70 steps, in a damped cloth, add up."""
    scene = cloth_scene("springs", "implicit-euler", rows=20, columns=22)
    row = Row("implicit", lambda: scene, {GPU: 70}, poke=POKE, later=(("dt", "method.dt", 2 * scene.method.dt),))
    (exact, _), (fast, _) = (row.ended(GPU, "gpu", precision="float64", math=math) for math in ("exact", "fast"))
    assert 0 < np.abs(fast.velocity - exact.velocity).max() < 70 * 1e-8 * 10 * (20 * 22) ** 0.5


REPEATED: dict[str, Row] = {  # buckets and cells are filled in whatever order threads come: no sum may show it
    "particles that meet": Row("", partial(meeting, 2, 1, copies=15, sweeps=1), {GPU: 30}),
    "a cloth that meets itself": Row("", lambda: load_scene("cloth-self"), {GPU: 60}),
    "fluid": Row("", lambda: load_scene("dam-break"), {GPU: 10}),
    **{f"implicit bar of {across}": Row("", partial(bar, across), {GPU: 5}, shaken) for across in (2, 4, 8)},
}


@pytest.mark.parametrize("name", REPEATED)
def test_runs_in_fast_math_repeat_to_the_bit(name: str) -> None:
    (first, done), *others = (REPEATED[name].ended(GPU, "gpu", precision="float32", math="fast") for _ in range(3))
    for state, found in others:
        assert not different(state, first) and found == done


def hanging(side: int) -> Scene:
    return load_scene("cloth-hanging").replace({"cloth.rows": side, "cloth.columns": side})


@pytest.mark.parametrize("name", DIVERGING)
def test_a_divergence_is_the_cpus(name: str) -> None:
    make, kernels = DIVERGING[name]
    expected = first_diverged(make(), "cpu")
    for kernel in ("graph", *kernels):
        assert first_diverged(make(), "gpu", kernel) == expected, kernel


AGREEING: list[Row] = [  # kernels that are compared with the first one
    # some thousand exchanges, of which one that is missed or comes late would show
    *(Row(f"cloth {side}", partial(hanging, side), {GPU: 6000}, kernels=("resident",)) for side in (64, 128, 250, 512)),
    # more tiles than the GPU runs at once, so that an order between blocks would show
    Row(
        "sheet", partial(xpbd_scene, "springs", rows=701, columns=650), {GPU: 6}, poke=POKE,
        kernels=(None, "tiled:16x16x384d1", "tiled:8x8x480d2"),
    ),
]  # fmt: skip


@pytest.mark.parametrize("row", AGREEING, ids=[row.name for row in AGREEING])
def test_tiles_and_launches_give_the_same_bits(row: Row) -> None:
    first, *others = row.kernels_of(GPU)
    wanted, _ = row.ended(GPU, "gpu", precision="float32", kernel=first)
    for kernel in others:
        state, _ = row.ended(GPU, "gpu", precision="float32", kernel=kernel)
        assert not different(state, wanted), kernel


def test_normals_of_a_mesh_are_the_cpus() -> None:
    """Sums of unit order in float32, in another order: 1e-5."""
    scene = load_scene("cloth-mesh")
    with open_simulation(scene, "gpu") as gpu, open_simulation(scene, "cpu") as cpu:
        np.testing.assert_allclose(gpu.read("normal"), cpu.read("normal"), atol=1e-5)


READ: dict[str, tuple[Callable[[], Scene], tuple[str, ...]]] = {
    "grid": (lambda: load_scene("lab-grid"), PRECISIONS),
    "cloth": (lambda: cloth_scene("springs", "velocity-verlet", rows=33, columns=35), PRECISIONS),
    "sheet": (lambda: xpbd_scene("springs", rows=33, columns=35), DOUBLE),
    "grid of constraints": (lambda: xpbd_scene("grid", rows=33, columns=35), DOUBLE),
    "fluid": (lambda: load_scene("dam-break"), SINGLE),
    **{name: (make, PRECISIONS) for name, make in FLOWS.items()},
}


@pytest.mark.parametrize(
    "name, precision", [(name, precision) for name, (_, precisions) in READ.items() for precision in precisions]
)
def test_positions_and_normals_go_into_device_arrays(name: str, precision: str) -> None:
    from numba import cuda

    scene = READ[name][0]()
    with open_simulation(scene, "gpu", precision=precision) as simulation:
        simulation.advance(20)
        target = cuda.device_array((simulation.particle_count, scene.dimensions), np.float32)
        for field in ("position", "normal") if scene.cloth else ("position",):
            simulation.read(field, into=target)
            assert np.array_equal(target.copy_to_host(), simulation.read(field).astype(np.float32)), field
        if scene.cloth:
            length = np.linalg.norm(simulation.read("normal").astype(np.float64), axis=1)
            assert np.abs(length - 1).max() < 4 * np.finfo(precision).eps


# Bytes of local memory a thread. The largest tiles fill the registers: 16 masses of a thread have 48 velocities, and 128
# registers. Of constraints a register or four may be spilled; the array of multipliers would be 48 or 96 bytes.
LOCAL: list[tuple[Callable[[], Scene], str | None, int]] = [
    *((partial(grid, "lab", side, side, {}), kernel, 0)
      for kernel, side in (("one-block", 32), ("tiles:64x8x8h4", 200), ("resident:32x8x4h8", 128))),
    *((partial(cloth_scene, part, "velocity-verlet", rows=40, columns=40), "graph", 0)
      for part in ("everything", "everything moving")),
    (partial(hanging, 64), "resident:8x8x1h1", 0),
    (partial(hanging, 512), "resident:64x8x4h1", 0),
    (partial(hanging, 1024), "resident:128x4x16h1", 512),
    *((partial(xpbd_scene, "springs", ordering, rows=32, columns=32), kernel, 16)
      for ordering in ORDERINGS[:2] for kernel in ("tiled", "one-block")),
]  # fmt: skip


@pytest.mark.parametrize("make, kernel, most", LOCAL)
def test_kernels_keep_their_numbers_in_registers(make: Callable[[], Scene], kernel: str, most: int) -> None:
    with open_simulation(make(), "gpu", kernel=kernel, allow_unstable=True) as simulation:
        launchers = [getattr(simulation, name, None) for name in ("_tiles", "_block", "_tiled")]
        kernels = [one._kernel for one in launchers if one] or list(simulation._passes.values())
        compiled = [variant for one in kernels for variant in one.overloads.values()]
        assert compiled and max(one.local_mem_per_thread for one in compiled) <= most


@pytest.mark.parametrize("make, kernel, words", REFUSED_BY_A_GPU)
def test_what_is_too_large_is_refused(make: Callable[[], Scene], kernel: str, words: str) -> None:
    with pytest.raises(SceneError, match=words):
        open_simulation(make(), "gpu", kernel=kernel)
