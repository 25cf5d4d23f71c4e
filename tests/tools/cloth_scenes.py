"""Small cloths with every part that there is, for the tests of the kernels: what the parts do shows within a few steps."""

from __future__ import annotations

from typing import Any

from softlab.model.scene.scene import Scene

SHEET = {
    "cloth": {"rows": 7, "columns": 6, "spacing": 0.1, "pinned": [[0, 0], [3, 2]]},
    "structural": {"stiffness": 100.0},
    "shear": {"stiffness": 80.0},
    "bending": {"stiffness": 10.0},
    "damping": {"coefficient": 0.01},
    "gravity": {},
    "perturbation": {"amplitude": 0.005},
    "method": {"dt": 0.0005},
}
DAMPED = {
    "structural": {"stiffness": 100.0, "damping": 0.02},
    "shear": {"stiffness": 80.0, "damping": 0.03},
    "bending": {"stiffness": 10.0, "damping": 0.004},
}
AIR = {
    "wind": {"velocity": [1.0, 0.5, 4.0], "gust": 0.5, "gust_time": 0.0007, "seed": 2**40 + 3},
    "external": {"magnitude": 0.05, "seed": 2**40 + 17},
}
# Two of a kind, still ones and moving ones, with and without friction; some masses start inside, some come in later, and
# the bullet is so fast that it passes through the sheet between two steps.
BODIES = {
    "floor": {"kind": "plane", "point": [0.0, -0.52, 0.0], "static_friction": 0.5, "dynamic_friction": 0.4},
    "wall": {"kind": "plane", "point": [-0.02, 0.0, 0.0], "normal": [1.0, 0.2, 0.3], "velocity": [0.3, 0.0, 0.0]},
    "ball": {"kind": "sphere", "center": [0.25, -0.25, 0.05], "radius": 0.1, "velocity": [0.0, 0.0, -2.0]},
    "bullet": {
        "kind": "sphere", "center": [0.42, -0.45, -0.25], "radius": 0.05, "velocity": [0.0, 0.0, 400.0],
        "static_friction": 0.3, "dynamic_friction": 0.2,
    },
    "rod": {
        "kind": "capsule", "start": [0.0, -0.4, 0.03], "end": [0.2, -0.45, 0.0], "radius": 0.03,
        "velocity": [0.0, 0.1, -1.0], "static_friction": 0.2, "dynamic_friction": 0.1,
    },
    "block": {"kind": "box", "center": [0.45, -0.1, 0.05], "half_size": [0.1, 0.04, 0.048], "velocity": [0.0, 0.0, -1.0]},
}  # fmt: skip

# Pins of the sheet: one that begins and ends to move within a few steps, one that does both all the while; a third rests.
MOTIONS = {
    "jerk": {
        "kind": "motion", "pins": [[0, 0]], "velocity": [0.3, 0.0, -2.0], "axis": [1.0, 2.0, 0.5], "angular_velocity": -7.0,
        "center": [0.05, 0.1, -0.2], "start": 0.00076, "duration": 0.0051,
    },
    "spin": {"kind": "motion", "pins": [[3, 2]], "axis": [0.0, 0.0, 2.0], "angular_velocity": 40.0},
}  # fmt: skip

PARTS: dict[str, dict[str, Any]] = {
    "springs": SHEET,
    "damped": SHEET | DAMPED,
    "random": SHEET | {"external": AIR["external"]},  # differs between two steps whose kicks meet
    "air": SHEET | AIR,
    "bodies": SHEET | BODIES,
    "everything": SHEET | DAMPED | AIR | BODIES,
    "moving": SHEET | {"cloth": SHEET["cloth"] | {"pinned": [[0, 0], [3, 2], [6, 5]]}} | MOTIONS,
    "damped moving": SHEET | DAMPED | MOTIONS | {"ball": BODIES["ball"]},
    "everything moving": SHEET | DAMPED | AIR | BODIES | MOTIONS,
    "bare": {"cloth": {"rows": 4, "columns": 3, "spacing": 0.1}, "gravity": {}, "method": {"dt": 0.0005}},
}
POKE = (8, (0.05, -0.02, 0.1))  # particle, N


def cloth_scene(name: str, integrator: str, **changes: Any) -> Scene:
    """A scene of PARTS with this integrator, some fields changed: `rows=33`, `columns=41`, ..., of the sheet."""
    data = PARTS[name]
    method = data["method"] | {"integrator": integrator}
    return Scene(data | {"cloth": data["cloth"] | changes, "method": method}, name=name)
