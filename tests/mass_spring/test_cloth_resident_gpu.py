"""The kernel `resident` of cloths on a real GPU: the CPU's bits in `exact` math, on all kinds of tiles; bounded in `fast`."""

from __future__ import annotations

import numpy as np
import pytest
from cloth_scenes import PARTS, cloth_scene
from test_cloth_gpu import STEPS, assert_same, end_state, scene_of

from softlab.app.driver import open_simulation
from softlab.model.base.errors import SceneError
from softlab.model.scene.scene import Scene, load_scene

pytestmark = pytest.mark.gpu
TILES = ("resident:8x8x1h1", "resident:7x5x3h1", "resident:16x4x4h1", "resident:13x13x1h2", "resident:20x5x4h3")


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_every_tile_gives_the_bits_of_the_cpu(precision: str) -> None:
    """Velocity Verlet whose kicks meet, on sheets that no tile divides, one of them hardly wider than a tile."""
    for rows, columns in ((37, 45), (101, 26)):
        scene = scene_of("springs", "velocity-verlet", rows=rows, columns=columns)
        expected = end_state(scene, "cpu", precision=precision, math="exact")
        for kernel in TILES:
            found = end_state(scene, "gpu", precision=precision, math="exact", kernel=kernel)
            assert_same(found, expected, (kernel, rows, columns))


@pytest.mark.parametrize("name", ["bodies", "random", "moving"])
def test_single_parts_give_the_bits_of_the_cpu(name: str) -> None:
    scene = scene_of(name, "velocity-verlet", rows=37, columns=45)
    expected = end_state(scene, "cpu", math="exact")
    for kernel in ("resident:8x4x2h1", "resident:16x8x2h2"):
        assert_same(end_state(scene, "gpu", math="exact", kernel=kernel), expected, kernel)


@pytest.mark.parametrize(
    "integrator,precision",
    [
        ("lab", "float32"),
        ("lab", "float64"),
        ("semi-implicit-euler", "float32"),
        ("explicit-euler", "float32"),
        ("taylor", "float32"),
    ],
)
def test_all_parts_together_give_the_bits_of_the_cpu(integrator: str, precision: str) -> None:
    scene = scene_of("everything moving", integrator, rows=37, columns=45)
    expected = end_state(scene, "cpu", precision=precision, math="exact")
    for kernel in ("resident:8x4x2h1", "resident:14x7x2h2"):
        assert_same(end_state(scene, "gpu", precision=precision, math="exact", kernel=kernel), expected, kernel)


@pytest.mark.parametrize("kinds", [("structural",), ("structural", "shear"), ("bending",)])
def test_kinds_of_springs_give_the_bits_of_the_cpu(kinds: tuple[str, ...]) -> None:
    """Without bending springs a block reads one ring around what it owns, not two."""
    data = {
        name: table
        for name, table in PARTS["damped"].items()
        if name not in {"structural", "shear", "bending"} - set(kinds)
    }
    sheet = data["cloth"] | {"rows": 33, "columns": 41}
    scene = Scene(data | {"cloth": sheet, "method": data["method"] | {"integrator": "semi-implicit-euler"}})
    expected = end_state(scene, "cpu", math="exact")
    assert_same(end_state(scene, "gpu", math="exact", kernel="resident:16x4x2h2"), expected, kinds)


@pytest.mark.parametrize("side", [64, 128, 250, 512])
def test_the_tables_tiles_give_the_bits_of_the_passes(side: int) -> None:
    """Some thousand exchanges, of which one that is missed or comes late would show."""
    scene = load_scene("cloth-hanging").replace({"cloth.rows": side, "cloth.columns": side})
    expected = end_state(scene, "gpu", steps=6000, poke=False, math="exact", kernel="graph")
    assert_same(end_state(scene, "gpu", steps=6000, poke=False, math="exact", kernel="resident"), expected, side)


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("kernel", ["resident:8x8x1h1", "resident:16x4x2h2"])
def test_fast_math_stays_within_rounding(kernel: str, precision: str) -> None:
    """As in test_cloth_gpu.py: n steps of a damped cloth near its rest add up to 4 n epsilon of the scale."""
    scene = scene_of("random", "velocity-verlet", rows=20, columns=22)
    exact = end_state(scene, "cpu", precision=precision, math="exact")
    fast = end_state(scene, "gpu", precision=precision, math="fast", kernel=kernel)
    bound = 4 * STEPS * np.finfo(precision).eps * float(np.abs(exact.position).max())
    assert np.abs(fast.position - exact.position).max() < bound


def test_live_changes_reach_the_blocks() -> None:
    scene = load_scene("cloth-hanging")
    states = []
    for backend, kernel in (("cpu", None), ("gpu", "resident:8x8x1h1")):
        with open_simulation(scene, backend, math="exact", kernel=kernel, live=("gravity", "dt")) as simulation:
            simulation.advance(100)
            simulation.set("gravity.enabled", False)
            simulation.advance(100)
            simulation.set("method.dt", 0.0012)
            simulation.advance(101)
            states.append(simulation.state())
    assert_same(states[1], states[0], "resident")


def test_kernels_keep_nothing_in_local_memory() -> None:
    """The largest tile, which fills the registers, may put some of its numbers aside: 16 masses of a thread have 48
    velocities, and 128 registers."""
    for kernel, side, most in (
        ("resident:8x8x1h1", 64, 0),
        ("resident:64x8x4h1", 512, 0),
        ("resident:128x4x16h1", 1024, 512),
    ):
        scene = load_scene("cloth-hanging").replace({"cloth.rows": side, "cloth.columns": side})
        with open_simulation(scene, "gpu", kernel=kernel) as simulation:
            for compiled in simulation._tiles._kernel.overloads.values():
                assert compiled.local_mem_per_thread <= most, kernel


def test_too_many_tiles_for_the_gpu_are_refused() -> None:
    with pytest.raises(SceneError, match="at once"):
        open_simulation(cloth_scene("springs", "lab", rows=2000, columns=2000), "gpu", kernel="resident:8x8x1h1")
