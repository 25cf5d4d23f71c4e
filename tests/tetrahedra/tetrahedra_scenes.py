"""Small scenes of tetrahedral bodies with every part that there is, for the tests of the kernels."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from softlab.model.core.build import build
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

METHOD = {"solver": "xpbd", "dt": 0.01, "substeps": 3, "iterations": 2}
BODY: dict[str, Any] = {
    "kind": "tetrahedral_body", "shape": {"name": "box", "sides": [0.2, 0.1, 0.1], "resolution": 10}, "edge": 0.1,
    "young_modulus": 2e4, "poisson_ratio": 0.35, "pinned": ["left"],
}  # fmt: skip
FREE = BODY | {"pinned": [], "origin": [0.0, 0.3, 0.0], "velocity": [0.2, -0.1, 0.3], "spin": [3.0, 1.0, -2.0]}
AIR: dict[str, Any] = {
    "gravity": {}, "damping": {"coefficient": 0.01}, "external": {"magnitude": 0.02, "seed": 5},
    "plane": {"point": [0.0, -0.04, 0.0], "static_friction": 0.4, "dynamic_friction": 0.3},
}  # fmt: skip
PARTS: dict[str, dict[str, Any]] = {
    "fixed-corotated": {"body": BODY, "gravity": {}},
    "corotated": {"body": BODY | {"material": "corotated", "tetrahedra": 6}, "gravity": {}},
    "neo-hookean": {"body": BODY | {"material": "neo-hookean"}, "gravity": {}},
    "no Poisson": {"body": BODY | {"poisson_ratio": 0.0}, "gravity": {}},
    "damped": {"body": BODY | {"damping": 0.02}, "gravity": {}},
    "once": {"body": BODY, "gravity": {}, "method": METHOD | {"iterations": 1}},
    "blocks": {"body": BODY, "gravity": {}, "method": METHOD | {"rows": "blocks"}},
    "damped blocks": {
        "body": BODY | {"damping": 0.02, "material": "corotated"}, "gravity": {},
        "method": METHOD | {"rows": "blocks", "iterations": 3},
    },
    "voxels": {"body": BODY | {"volume": "voxels", "damping": 0.01, "poisson_ratio": 0.499}, "gravity": {}},
    "damped hookean": {"body": BODY | {"material": "neo-hookean", "damping": 0.02}, "gravity": {}},
    "hookean once": {
        "body": BODY | {"material": "neo-hookean", "damping": 0.02}, "gravity": {}, "method": METHOD | {"iterations": 1},
    },
    "hookean voxels": {"body": BODY | {"volume": "voxels", "material": "neo-hookean"}, "gravity": {}},
    "free": {"gravity": {}},  # and a body of no voxels
    "everything": {
        "body": BODY | {"damping": 0.02}, "second": FREE | {"material": "neo-hookean", "young_modulus": 5e4},
        "third": FREE | {"material": "corotated", "origin": [0.5, 0.2, 0.0], "angle": 30.0},
    } | AIR,
}  # fmt: skip
PARTS["everything once"] = PARTS["everything"] | {"method": METHOD | {"iterations": 1}}


LAUNCHED = ("free", "voxels", "hookean voxels", "everything")  # whose kernel is not `resident`


def tetrahedra_scene(name: str, **changes: Any) -> Scene:
    """A scene of PARTS."""
    bodies = {"body": BODY | {"file": str(free_file())}} if name == "free" else {}
    for field in ("shape", "edge") if bodies else ():
        del bodies["body"][field]
    return Scene({"method": METHOD} | bodies | PARTS[name] | changes, "bodies")


def slab_scene(**changes: Any) -> Scene:
    """A body of five layers: slabs of 2, 2 and 1."""
    bar = BODY | {"shape": {"name": "box", "sides": [0.1, 0.5, 0.2], "resolution": 10}, "pinned": ["bottom"]}
    return Scene({"body": bar | changes, "gravity": {}, "method": METHOD | {"substeps": 2}})


def cantilever(layers: int, across: int, iterations: int = 1, **changes: Any) -> Scene:
    """Small Steps' cantilever, in such voxels."""
    beam = {
        "kind": "tetrahedral_body", "shape": {"name": "box", "sides": [layers / across, 1.0, 1.0]}, "edge": 1 / across,
        "young_modulus": 1e5, "poisson_ratio": 0.4, "pinned": ["left"],
    }  # fmt: skip
    method = {"solver": "xpbd", "dt": 1 / 60, "substeps": 100 // iterations, "iterations": iterations}
    return Scene({"beam": beam | changes, "gravity": {}, "method": method})


def through(scene: Scene) -> Scene:
    """The same bodies, which pass through each other."""
    return Scene({name: table for name, table in scene.as_dict().items() if name != "contact"}, scene.name)


@cache
def folder() -> tempfile.TemporaryDirectory[str]:
    """Gone when the tests are."""
    return tempfile.TemporaryDirectory(prefix="softlab-test-")


@cache
def free_file() -> Path:
    """BODY's tetrahedra in a file that says nothing of voxels."""
    found = Scene({"body": BODY}).tetrahedra_set
    points, cells = found.position.tolist(), found.tetrahedra.tolist()
    text = ["# vtk DataFile Version 3.0", "body", "ASCII", "DATASET UNSTRUCTURED_GRID", f"POINTS {len(points)} double"]
    text += [" ".join(map(repr, point)) for point in points]
    text += [f"CELLS {len(cells)} {5 * len(cells)}", *(" ".join(map(str, [4, *cell])) for cell in cells)]
    text += [f"CELL_TYPES {len(cells)}", *["10"] * len(cells)]
    file = Path(folder().name) / "body.vtk"
    file.write_text("\n".join(text) + "\n")
    return file


def moving(scene: Scene, apart: float = 0.01) -> State:
    """Its beginning, out of shape and moving: differently at every particle."""
    body, random = build(scene), np.random.default_rng(3)
    free = (body.inverse_mass > 0)[:, None]
    position = body.position + free * random.normal(0, apart, body.position.shape)
    velocity = body.velocity + free * random.normal(0, 0.1, body.position.shape)
    return State(position, velocity, body.inverse_mass, 0.0, 0)
