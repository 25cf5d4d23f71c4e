"""Scenes for tests of CUDA kernels that every solver has, on a GPU and in the simulator: what diverges, what is refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from bodies_scenes import everything
from cloth_scenes import cloth_scene
from contact_scenes import folded
from newton_scenes import newton_scene
from test_matching import jelly
from tetrahedra_scenes import slab_scene, tetrahedra_scene
from xpbd_scenes import xpbd_scene

from softlab.app.driver import open_simulation
from softlab.model.base.errors import Diverged
from softlab.model.scene.scene import Scene, load_scene


def grid(rows: int = 4, columns: int = 4, **changes: Any) -> Scene:
    fields = {path.replace("__", "."): value for path, value in changes.items()}
    return load_scene("lab-grid").replace({"grid.rows": rows, "grid.columns": columns} | fields)


def sheet(integrator: str, part: str = "springs", **changes: Any) -> Callable[[], Scene]:
    return lambda: cloth_scene(part, integrator, **changes)


def unstable_sheet() -> Scene:
    return cloth_scene("springs", "velocity-verlet", rows=3, columns=3, pinned="none").replace({"method.dt": 1.0})


def pulled_sheet() -> Scene:
    return xpbd_scene("bare", substeps=1, iterations=1).replace({"gravity.acceleration": 1e9, "method.dt": 100.0})


DIVERGING: dict[str, tuple[Callable[[], Scene], tuple[str | None, ...]]] = {
    "grid": (lambda: grid(method__dt=0.2, perturbation__amplitude=0.1), (None,)),
    "cloth": (unstable_sheet, (None,)),
    "sheet": (pulled_sheet, ("launch", "one-block", "tiled:4x4x32d1")),
    "two springs": (lambda: load_scene("hard/b1"), (None,)),
}


def first_diverged(scene: Scene, backend: str, kernel: str | None = None) -> tuple[int, int, str]:
    """(step, particle, message); the state stays finite."""
    with open_simulation(scene, backend, math="exact", kernel=kernel, allow_unstable=True) as simulation:
        with pytest.raises(Diverged) as caught:
            simulation.advance(400)
            simulation.check()
        assert np.isfinite(simulation.state().position).all()
    return caught.value.step, caught.value.particle, str(caught.value)


def moved_sheet() -> Scene:
    return Scene(xpbd_scene("springs").as_dict() | {"motion": {"pins": [[0, 0]], "velocity": [1.0, 0.0, 0.0]}})


def alternating() -> Scene:
    return grid(springs__stiffness_ratio=7.0)


TWELVE, SPRINGS = (lambda: grid(12, 12)), sheet("lab")
NO_TILES = "supports one stiffness, not alternating springs; use graph, launch or stages"
REFUSED: list[tuple[Callable[[], Scene], str | None, str]] = [  # scene, kernel, words of the message
    (TWELVE, "graph", "simulator"),
    (TWELVE, "resident:6x2x3h1", "at once; use tiles or graph"),
    (TWELVE, "tiles:4x2x2h2", "too small for its halo"),
    (TWELVE, "tiles:4x2", "written like"),
    (TWELVE, "tiles:4x2x0h1", "written like"),
    (TWELVE, "graph:8x2x4h1", "must be one of"),
    (TWELVE, "one-block:8x2x4h0", "at most 8 x 8 masses"),
    *((alternating, kernel, NO_TILES) for kernel in ("one-block", "tiles", "resident", "tiles:8x8x1h2")),
    (SPRINGS, "graph", "simulator"),
    (SPRINGS, "blocks", "one-block"),
    (sheet("rk4"), "one-block", "rk4"),
    (sheet("lab", rows=40, columns=40), "one-block", "at most 1024"),
    (SPRINGS, "resident:8x8x1h1", "larger than the sheet"),
    (SPRINGS, "resident:2x2x1h1", "runs 1 at once"),
    (SPRINGS, "resident:2x2x1h0", "at least one step"),
    (SPRINGS, "resident:4x4x1h2", "too small for 2 steps"),
    (SPRINGS, "resident:4x4", "written like"),
    (SPRINGS, "graph:4x4x1h1", "must be one of"),
    (SPRINGS, "tiles:4x4x1h2", "runs grids only"),
    (sheet("rk4"), "resident", "not rk4"),
    (sheet("velocity-verlet", "damped"), "resident", "without forces that depend on velocities"),
    (SPRINGS, "tiles", "runs grids only; for a cloth use resident, or graph"),
    (SPRINGS, "resident", "fit none of its tiles"),
    (sheet("implicit-euler"), "graph", "cooperative"),
    (lambda: xpbd_scene("springs"), "graph", "simulator"),
    (lambda: xpbd_scene("springs"), "fused", "one of"),
    (lambda: xpbd_scene("springs"), "tiled:5x5x32d1", "multiples"),
    (lambda: xpbd_scene("springs", rows=65, columns=64), "one-block", "at most 4096"),
    (moved_sheet, None, "motion"),
    (folded, "one-block", "reaches across the sheet"),
    *((jelly, kernel, "shape-matching use graph") for kernel in ("tiled", "one-block")),
    (lambda: tetrahedra_scene("free"), "resident", "bodies of voxels"),
    (lambda: tetrahedra_scene("everything"), "resident", "colliders-in-iterations"),
    (slab_scene, "resident:3", "even"),
    (slab_scene, "resident:two", "even"),
    (slab_scene, "slabs", "resident, graph, launch, stages"),
    (lambda: newton_scene("fixed-corotated"), "graph", "cooperative"),
    (everything, "resident", "graph, launch, stages for bodies"),
]
REFUSED_BY_A_GPU: list[tuple[Callable[[], Scene], str, str]] = [
    (lambda: grid(400, 400), "one-block", "do not fit"),
    (sheet("lab", rows=2000, columns=2000), "resident:8x8x1h1", "at once"),
]
