"""Small scenes whose pins let go, one for each solver that has pins, and what is asked of them on either backend."""

from __future__ import annotations

from typing import Any

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

G = 8.0  # m/s^2
LETS_GO, MORE = 3, 5  # steps: before the pins let go, and after
GRAVITY: dict[str, Any] = {"gravity": {"acceleration": G}}
GRID: dict[str, Any] = {"grid": {"rows": 3, "columns": 4, "pinned": "top"}, "springs": {}, **GRAVITY}
CLOTH: dict[str, Any] = {
    "cloth": {"rows": 3, "columns": 4, "spacing": 0.125, "pinned": "left-right"}, "structural": {}, **GRAVITY,
}  # fmt: skip
MESH: dict[str, Any] = {"mesh": {**CLOTH["cloth"], "shape": "sheet"}, "structural": {}, **GRAVITY}
BODY: dict[str, Any] = {"kind": "tetrahedral_body", "shape": {"name": "box", "sides": [0.25, 0.125, 0.125]}}
BEAM: dict[str, Any] = {
    "beam": BODY | {"edge": 0.125, "young_modulus": 1e4, "density": 64.0, "pinned": ["left"]}, **GRAVITY,
}  # fmt: skip
WATER = {"kind": "fluid", "size": [0.1, 0.1, 0.1], "rest_distance": 0.05, "origin": [0.0, -1.0, 0.0]}
XPBD: dict[str, Any] = {"solver": "xpbd", "dt": 0.0078125, "substeps": 2, "iterations": 2}
TABLES: dict[str, dict[str, Any]] = {
    "grid": GRID | {"method": {"integrator": "semi-implicit-euler", "dt": 0.0078125}},
    "cloth": CLOTH | {"method": {"integrator": "semi-implicit-euler", "dt": 0.00390625}},
    "implicit": CLOTH | {"method": {"integrator": "implicit-euler", "dt": 0.0078125}},
    "sheet": CLOTH | {"method": XPBD},
    "mesh": MESH | {"method": XPBD},
    "windows": GRID | {"method": {"solver": "shape-matching", "dt": 0.0078125}},
    "rows": BEAM | {"method": XPBD},
    "vbd": BEAM | {"method": XPBD | {"solver": "vbd"}},
    "newton": BEAM | {"method": XPBD | {"solver": "newton"}},
    "world": BEAM | {"water": WATER, "method": XPBD | {"solver": "world"}},
}


def release_scene(name: str, all_pinned: bool = False, **release: Any) -> Scene:
    """The scene, whose pins let go after LETS_GO steps; `all_pinned`: until then nothing moves but a fluid."""
    tables = TABLES[name]
    if all_pinned:
        sheet = next((kind for kind in ("grid", "cloth", "mesh") if kind in tables), "beam")
        pins: Any = [[row, column] for row in range(3) for column in range(4)] if sheet != "beam" else ["all"]
        tables = tables | {sheet: tables[sheet] | {"pinned": pins}}
    time = LETS_GO * tables["method"]["dt"]
    return Scene(tables | {"let_go": {"kind": "release", "time": time} | release})


def end_state(scene: Scene, backend: str, steps: int = LETS_GO + MORE, start: State | None = None) -> State:
    """After so many steps in one call."""
    with open_simulation(scene, backend, math="exact", precision="float64", initial=start) as simulation:
        simulation.advance(steps)
        return simulation.state()
