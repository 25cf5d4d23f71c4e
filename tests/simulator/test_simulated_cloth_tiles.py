"""The cloth's kernel `resident`, in plain Python: several blocks that overlap, the same bits as the launched passes.

The simulator runs blocks one after another; this kernel, whose blocks wait for each other, is run with all blocks at once,
each a group of Python threads (test_simulated_tiles.py).
"""

from __future__ import annotations

from typing import Any

import pytest
from cloth_scenes import PARTS, POKE, cloth_scene
from test_simulated_tiles import assert_same, blocks_together  # noqa: F401  # a fixture

from softlab.app.driver import open_simulation
from softlab.model.base.errors import SceneError
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene


def end_state(scene: Scene, kernel: str, steps: int, **options: Any) -> State:
    """In two goes, the first of which leaves the buffers, the counter and the tags of messages where they are."""
    with open_simulation(
        scene, "gpu", math="exact", kernel=kernel, live=("poke",), allow_unstable=True, **options
    ) as simulation:
        simulation.poke(*POKE)
        simulation.advance(steps // 2)
        simulation.advance(steps - steps // 2)
        return simulation.state()


@pytest.mark.parametrize(
    "name,integrator,tile",
    [
        ("springs", "velocity-verlet", "4x2x2h1"),
        ("bodies", "taylor", "2x3x1h1"),  # a tile needs masses of blocks that are not next to it
        ("springs", "velocity-verlet", "2x2x1h1"),
        ("random", "velocity-verlet", "6x6x1h2"),
        ("everything moving", "lab", "3x2x2h1"),
        ("everything moving", "semi-implicit-euler", "6x3x2h2"),
    ],
)
def test_resident_blocks_do_what_passes_do(blocks_together: None, name: str, integrator: str, tile: str) -> None:  # noqa: F811
    scene = cloth_scene(name, integrator)
    assert_same(end_state(scene, f"resident:{tile}", 6), end_state(scene, "launch", 6))


@pytest.mark.parametrize("kinds", [("structural",), ("shear",), ("structural", "shear"), ("bending",)])
def test_kinds_of_springs_by_themselves(blocks_together: None, kinds: tuple[str, ...]) -> None:  # noqa: F811
    """Without bending springs a block reads one ring around what it owns, not two."""
    absent = {"structural", "shear", "bending"} - set(kinds)
    data = {name: table for name, table in PARTS["springs"].items() if name not in absent}
    scene = Scene(data | {"method": data["method"] | {"integrator": "lab"}})
    assert_same(end_state(scene, "resident:3x3x1h1", 4), end_state(scene, "launch", 4))


def test_doubles_come_in_three_words(blocks_together: None) -> None:  # noqa: F811
    scene = cloth_scene("springs", "lab")
    found = end_state(scene, "resident:3x4x1h1", 4, precision="float64")
    assert_same(found, end_state(scene, "launch", 4, precision="float64"))


def test_one_block_alone_needs_no_messages() -> None:
    scene = cloth_scene("springs", "velocity-verlet", rows=4, columns=4, pinned="top")
    assert_same(end_state(scene, "resident:4x2x2h1", 5), end_state(scene, "launch", 5))


@pytest.mark.parametrize(
    "kernel,name,integrator,what",
    [
        ("resident:8x8x1h1", "springs", "lab", "larger than the sheet"),
        ("resident:2x2x1h1", "springs", "lab", "runs 1 at once"),
        ("resident:2x2x1h0", "springs", "lab", "at least one step"),
        ("resident:4x4x1h2", "springs", "lab", "too small for 2 steps"),
        ("resident:4x4", "springs", "lab", "written like"),
        ("graph:4x4x1h1", "springs", "lab", "must be one of"),
        ("tiles:4x4x1h2", "springs", "lab", "runs grids only"),
        ("resident", "springs", "rk4", "not rk4"),
        ("resident", "damped", "velocity-verlet", "depend on velocities"),
        ("tiles", "springs", "lab", "runs grids only; for a cloth use resident, or graph"),
        ("resident", "springs", "lab", "fit none of its tiles"),
    ],
)
def test_tiles_that_cannot_be_are_refused(kernel: str, name: str, integrator: str, what: str) -> None:
    with pytest.raises(SceneError, match=what):
        open_simulation(cloth_scene(name, integrator), "gpu", kernel=kernel)
