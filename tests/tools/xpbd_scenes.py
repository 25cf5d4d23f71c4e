"""Small scenes of the position-based solvers with every part that there is, for the tests of the kernels."""

from __future__ import annotations

from typing import Any

from cloth_scenes import AIR, BODIES

from softlab.model.scene.scene import Scene

METHOD: dict[str, Any] = {"solver": "xpbd", "dt": 0.004, "substeps": 3, "iterations": 3}
CLOTH: dict[str, Any] = {
    "cloth": {"rows": 7, "columns": 6, "spacing": 0.1, "pinned": [[0, 0], [3, 2]]},
    "structural": {"stiffness": 100.0},
    "shear": {"stiffness": 80.0},
    "bending": {"stiffness": 10.0},
    "damping": {"coefficient": 0.01},
    "gravity": {},
    "perturbation": {"amplitude": 0.005},
    "method": METHOD,
}
DAMPED = {
    "structural": {"stiffness": 100.0, "damping": 0.02},
    "shear": {"compliance": 0.0},
    "bending": {"stiffness": 10.0, "damping": 0.004},
}
LOADS = {
    "weight": {"kind": "load", "at": [4, 3], "mass": 0.05},
    "feather": {"kind": "load", "at": [6, 0], "mass": 0.004},
}
GRID: dict[str, Any] = {
    "grid": {"rows": 6, "columns": 5, "spacing": 1.0, "mass": 0.01, "pinned": "top-corners"},
    "springs": {"stiffness": 10.0, "rest_length": 1.0},
    "damping": {"coefficient": 0.03},
    "gravity": {},
    "perturbation": {"amplitude": 0.05},
    "method": METHOD | {"dt": 0.02},
}
# Published errors after 1.5 s (docs/method/cases.md, C): sheet, dt [s], iterations, RMS over all masses [m].
PUBLISHED = [
    ("S1", 0.01, 1, 7.09e-2),
    ("S1", 0.01, 4, 4.69e-3),
    ("S1", 0.01, 20, 4.70e-3),
    ("S1", 0.0025, 1, 5.37e-3),
    ("S1", 0.0025, 4, 2.39e-3),
    ("S1", 0.000625, 1, 9.9e-4),
    ("S2", 0.01, 1, 3.73e-2),
    ("S2", 0.01, 4, 2.74e-2),
    ("S2", 0.01, 20, 2.74e-2),
    ("S2", 0.0025, 1, 7.68e-3),
    ("S2", 0.000625, 1, 2.02e-3),
]
# B2, 20 links with a thousandfold mass at the end: substeps, iterations, ordering, largest stretch [%] in frames 20 to 40.
HEAVY_END = [
    (1, 20, "gauss-seidel", 191),
    (20, 1, "gauss-seidel", 26.0),
    (1, 100, "gauss-seidel", 97.6),
    (10, 10, "gauss-seidel", 9.75),
    (100, 1, "gauss-seidel", 1.01),
    (100, 1, "jacobi", 4.15),
]
PARTS: dict[str, dict[str, Any]] = {
    "springs": CLOTH,
    "rigid": CLOTH | {kind: {"compliance": 0.0} for kind in ("structural", "shear", "bending")},
    "free": CLOTH | {"cloth": CLOTH["cloth"] | {"pinned": "none"}},
    "damped": CLOTH | DAMPED,
    "stretchy": CLOTH | DAMPED | {"shear": {"stiffness": 80.0, "damping": 0.03}},
    "air": CLOTH | AIR,
    "loaded": CLOTH | AIR | LOADS,
    "bodies": CLOTH | BODIES,
    "held": CLOTH | {"attachments": {"anchors": 2, "slack": 0.001}},
    "everything": CLOTH | DAMPED | AIR | BODIES | LOADS | {"attachments": {"anchors": 3}},
    "pbd": CLOTH | {"method": METHOD | {"solver": "pbd", "pbd_stiffness": 0.7}},
    "bare": {"cloth": {"rows": 4, "columns": 3, "spacing": 0.1}, "gravity": {}, "method": METHOD},
    "grid": GRID,
    "alternating": GRID | {"springs": {"stiffness": 10.0, "rest_length": 1.0, "stiffness_ratio": 1e4}},
    "net": GRID | {"springs": {"compliance": 0.0, "rest_length": 1.0}, "attachments": {}}
    | {"external": {"magnitude": 0.05, "seed": 2**40 + 17}},
}  # fmt: skip
POKE = (8, (0.05, -0.02, 0.1))  # particle, N


def xpbd_scene(name: str, ordering: str = "gauss-seidel", **changes: Any) -> Scene:
    """A scene of PARTS in this ordering; `rows=33`, `columns=41`, `pinned=...` change its sheet, other fields its method."""
    data = PARTS[name]
    sheet = "grid" if "grid" in data else "cloth"
    of_sheet = {key: value for key, value in changes.items() if key in ("rows", "columns", "pinned", "spacing")}
    method = data["method"] | {"ordering": ordering} | {k: v for k, v in changes.items() if k not in of_sheet}
    return Scene(data | {sheet: data[sheet] | of_sheet, "method": method}, name=name)


def poke_of(scene: Scene) -> tuple[int, tuple[float, ...]]:
    return POKE[0], POKE[1][: scene.dimensions]
