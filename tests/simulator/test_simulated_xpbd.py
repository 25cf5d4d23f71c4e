"""The position-based solvers' CUDA kernels, in plain Python: stage by stage, pass by pass, on tiles and in one block to the
same bits, and to the independent NumPy reference within rounding."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from xpbd_scenes import PARTS, poke_of, xpbd_scene

from softlab.app.driver import open_simulation
from softlab.bench.reference import xpbd as reference
from softlab.gpu_backend.core.sheet import BLOCK
from softlab.model.base.errors import Diverged, SceneError
from softlab.model.core.build import build, rest_positions
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

ORDERINGS = {"gauss-seidel": "gauss-seidel", "jacobi": "weighted-jacobi", "averaged-jacobi": "averaged-jacobi"}
SHARED = ("one-block", "tiled:4x4x32d1", "tiled:8x4x64d2")  # kernels: several tiles, some iterations left over
STEPS = 2


def end_state(scene: Scene, kernel: str, live: tuple[str, ...] = (), **options: Any) -> State:
    with open_simulation(
        scene, "gpu", math="exact", kernel=kernel, live=live, allow_unstable=True, **options
    ) as simulation:
        if live:
            simulation.poke(*poke_of(scene))
        simulation.advance(STEPS - 1)
        simulation.advance(1)
        return simulation.state()


def same(one: State, other: State) -> bool:
    return np.array_equal(one.position, other.position) and np.array_equal(one.velocity, other.velocity)


def judged(scene: Scene, **changes: Any) -> tuple[np.ndarray, np.ndarray]:
    """The reference's (position, velocity) after STEPS."""
    method = scene.method
    inverse = build(scene).inverse_mass
    masses = np.where(inverse > 0, 1 / np.where(inverse > 0, inverse, 1), scene.grid.mass)
    return reference.simulate(
        scene, STEPS, substeps=method.substeps, iterations=method.iterations, ordering=ORDERINGS[method.ordering],
        masses=masses, **changes,
    )  # fmt: skip


@pytest.mark.parametrize("ordering", ORDERINGS)
def test_all_kernels_give_the_same_bits(ordering: str) -> None:
    """Of a scene with every part, a step being an odd number of substeps."""
    scene = xpbd_scene("everything", ordering, substeps=1, iterations=3)
    state = end_state(scene, "launch", ("poke",), precision="float64")
    for kernel in ("stages", *SHARED):
        assert same(state, end_state(scene, kernel, ("poke",), precision="float64")), kernel


@pytest.mark.parametrize("name,ordering", [("net", "gauss-seidel"), ("alternating", "jacobi"), ("pbd", "jacobi")])
def test_other_kinds_of_constraints_give_the_same_bits(name: str, ordering: str) -> None:
    """Two axes, two stiffnesses, PBD; a step being an even number of substeps, in float32."""
    scene = xpbd_scene(name, ordering, substeps=2, iterations=2)
    state = end_state(scene, "launch")
    for kernel in ("stages", "one-block", "tiled:4x4x32d1"):
        assert same(state, end_state(scene, kernel)), kernel


@pytest.mark.parametrize(
    "name,ordering",
    [
        *(("loaded", ordering) for ordering in ORDERINGS),
        *(("alternating", ordering) for ordering in ORDERINGS),
        ("rigid", "gauss-seidel"),
        ("free", "jacobi"),
        ("stretchy", "gauss-seidel"),
        ("stretchy", "jacobi"),
        ("bodies", "averaged-jacobi"),
    ],
)
def test_the_reference_is_met_within_rounding(name: str, ordering: str) -> None:
    """An iteration's twelve projections round a mass's position some four times each; velocities are positions over h."""
    scene = xpbd_scene(name, ordering, substeps=2, iterations=2)
    position, velocity = judged(scene, inextensible=name == "rigid")
    state = end_state(scene, "one-block", precision="float64")
    bound = STEPS * 4 * 48 * np.finfo(np.float64).eps * max(1.0, float(np.abs(position).max()))
    assert np.abs(state.position - position).max() < bound
    bound = max(bound, STEPS * np.finfo(np.float64).eps * float(np.abs(velocity).max()))
    assert np.abs(state.velocity - velocity).max() < bound * scene.method.substeps / scene.method.dt


@pytest.mark.parametrize("rows,columns", [(1, 5), (4, 1), (2, 2), (3, 3), (2, BLOCK[0] + 1)])
@pytest.mark.parametrize("ordering", ["gauss-seidel", "averaged-jacobi"])
def test_the_smallest_sheets(ordering: str, rows: int, columns: int) -> None:
    scene = xpbd_scene("air", ordering, rows=rows, columns=columns, pinned="none", substeps=1, iterations=2)
    state = end_state(scene, "one-block", precision="float64")
    position, _ = judged(scene)
    assert np.abs(state.position - position).max() < STEPS * 4 * 48 * np.finfo(np.float64).eps
    for kernel in ("launch", "tiled:4x4x32d1"):
        assert same(state, end_state(scene, kernel, precision="float64")), kernel


def test_a_sheet_of_many_tiles() -> None:
    """Sixteen of them, odd sides, of three iterations a launch does two."""
    scene = xpbd_scene("damped", "jacobi", rows=13, columns=15, substeps=1, iterations=3)
    assert same(end_state(scene, "one-block"), end_state(scene, "tiled:4x4x64d2"))


def test_attachments_hold_and_pull_no_further() -> None:
    """The last of an iteration is the tether: no mass is farther from its nearest pinned mass than the cloth between
    them, and without them some would be. One rounding each in reach, way and product."""
    scene = xpbd_scene("held", substeps=1, iterations=2)
    bare = Scene({name: table for name, table in scene.as_dict().items() if name != "attachments"})
    rest, pinned = rest_positions(scene.grid), [0, 3 * 6 + 2]
    length = np.linalg.norm(rest[:, None] - rest[pinned], axis=2)
    reach = length.min(axis=1) * (1 + scene.attachments.slack)
    stretch = []
    for one in (scene, bare):
        position = end_state(one, "one-block", precision="float64").position
        way = np.linalg.norm(position - position[pinned][length.argmin(axis=1)], axis=1)
        stretch.append(np.max(way - reach))
    assert stretch[0] < 8 * np.finfo(np.float64).eps < stretch[1]


@pytest.mark.parametrize("body", ["floor", "ball", "rod", "block"])
def test_every_body_is_met(body: str) -> None:
    """Else the tests above would say nothing about it."""
    tables = {name: table for name, table in PARTS["springs"].items()}
    method = tables["method"] | {"ordering": "jacobi", "iterations": 1}
    alone = Scene(tables | {"method": method})
    with_body = Scene(tables | {"method": method, body: PARTS["bodies"][body]})
    assert not same(end_state(alone, "one-block"), end_state(with_body, "one-block"))


def test_a_divergence_is_named_and_the_state_stays_finite() -> None:
    scene = xpbd_scene("bare", substeps=1, iterations=1).replace({"gravity.acceleration": 1e9, "method.dt": 100.0})
    with open_simulation(scene, "gpu", math="exact", kernel="one-block") as simulation:
        with pytest.raises(Diverged) as caught:
            simulation.advance(3)
            simulation.check()
        assert caught.value.step == 1 and np.isfinite(simulation.state().position).all()


@pytest.mark.parametrize("kernel", ["stages", "one-block", "tiled:4x4x32d1"])
def test_live_changes_and_a_rewind(kernel: str) -> None:
    scene = xpbd_scene("air", "jacobi", rows=4, columns=4, pinned="top")
    with open_simulation(scene, "gpu", math="exact", kernel=kernel, live=("gravity",)) as simulation:
        simulation.advance(1)
        before = simulation.state()
        simulation.set("gravity.enabled", False)
        simulation.advance(1)
        still = simulation.state()
        simulation.load(before)
        simulation.set("gravity.enabled", True)
        simulation.advance(1)
        falling = simulation.state()
        simulation.rewind()
        simulation.load(before)
        simulation.advance(1)
        assert same(simulation.state(), falling)
    change = (falling.velocity - still.velocity).reshape(4, 4, 3)
    assert change[3, 1, 1] < 0 and falling.velocity[:4].max() == 0


def test_what_is_read_is_the_state() -> None:
    with open_simulation(xpbd_scene("grid", "jacobi"), "gpu", math="exact") as simulation:
        simulation.advance(1)
        assert simulation.kernel == "launch"
        assert np.array_equal(simulation.read("position"), simulation.state().position)
        assert simulation.read("velocity").shape == (30, 2)
    with open_simulation(xpbd_scene("springs", "jacobi"), "gpu", math="exact", precision="float64") as simulation:
        normal = simulation.read("normal")
        assert normal.shape == (42, 3) and np.abs(np.linalg.norm(normal, axis=1) - 1).max() < 1e-15


@pytest.mark.parametrize("kernel,what", [("graph", "simulator"), ("fused", "one of"), ("tiled:5x5x32d1", "multiples")])
def test_a_kernel_that_cannot_run_is_refused_with_the_reason(kernel: str, what: str) -> None:
    with pytest.raises(SceneError, match=what):
        open_simulation(xpbd_scene("springs"), "gpu", kernel=kernel)


def test_what_is_not_known_is_refused() -> None:
    scene = Scene(PARTS["springs"] | {"motion": {"pins": [[0, 0]], "velocity": [1.0, 0.0, 0.0]}})
    with pytest.raises(SceneError, match="motion"):
        open_simulation(scene, "gpu")
