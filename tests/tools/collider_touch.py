"""One mass against one collider, worked out by hand, for what both backends build of the colliders' formulas: the collider is
where its velocity has brought it, as thick as it is told, and rubs by Coulomb's law."""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.model.contact.cloth_parameters import CLOTH_PARAMETERS, collider_numbers
from softlab.model.core.parameters import record_type
from softlab.model.scene.scene import Scene

DT, STEP = 0.5, 0  # s: so that the step ends at 0.5 s, and colliders at 1 m/s have moved by half a metre
RUBS = {"velocity": (0.0, 1.0, 0.0), "thickness": 0.1, "static_friction": 0.5, "dynamic_friction": 0.4}
CAPSULE = RUBS | {"start": (0.0, 0.0, 0.0), "end": (2.0, 0.0, 0.0), "radius": 0.5}
BALL = RUBS | {"center": (1.0, 0.0, 0.0), "radius": 0.5}
BLOCK = RUBS | {"center": (1.0, 0.0, 0.0), "half_size": (1.0, 0.5, 2.0)}
FLOOR = RUBS | {"point": (5.0, 0.5, 1.0), "normal": (0.0, 2.0, 0.0)}
BOUNCY = {"restitution": 0.5}
# All are met 0.05 m over their top, at the end of their step, by a mass that comes down at 1 m/s, 2 m/s relative to them:
# what slides at no more than 1 m/s sticks, of what slides faster 0.8 m/s are taken.
ABOVE, TOP, OUT = (1.0, 1.3, 0.0), (1.0, 1.05, 0.0), (1.0, 1.1, 0.0)
CASES: dict[str, tuple[str, dict[str, Any], tuple[Any, ...], tuple[Any, ...]]] = {
    # name: kind, table, (before, position, velocity), (position, velocity)
    **{
        f"{kind} {word}": (kind, table, (ABOVE, TOP, (came, -1.0, 0.0)), (OUT, (left, 1.0, 0.0)))
        for kind, table in (("capsule", CAPSULE), ("sphere", BALL), ("box", BLOCK), ("plane", FLOOR))
        for word, came, left in (("sticks", 0.99, 0.0), ("slides", 1.01, 0.21), ("slides back", -1.5, -0.7))
    },
    "capsule's end": (
        "capsule", CAPSULE, ((3.0, 0.5, 0.0), (2.5, 0.5, 0.0), (-2.0, 1.0, 0.0)), ((2.6, 0.5, 0.0), (0.0, 1.0, 0.0)),
    ),
    "capsule not met": (
        "capsule", CAPSULE, (ABOVE, (1.0, 1.11, 0.0), (1.0, -1.0, 0.0)), ((1.0, 1.11, 0.0), (1.0, -1.0, 0.0)),
    ),
    "capsule left": ("capsule", CAPSULE, (ABOVE, TOP, (1.0, 1.5, 0.0)), (OUT, (1.0, 1.5, 0.0))),
    "capsule bounces": (  # 1 m/s comes back, so that the normal velocity changes by 3 m/s and friction takes 1.2
        "capsule", CAPSULE | BOUNCY, (ABOVE, TOP, (1.6, -1.0, 0.0)), (OUT, (0.4, 2.0, 0.0)),
    ),
    "plane bounces and holds": ("plane", FLOOR | BOUNCY, (ABOVE, TOP, (1.4, -1.0, 0.0)), (OUT, (0.0, 2.0, 0.0))),
    "ball passed": (  # it rises by 0.5 m: met 0.6 m from its middle on the way down through it
        "sphere", BALL, ((1.0, 5.0, 0.0), (1.0, -4.5, 0.0), (0.0, -19.0, 0.0)), ((1.0, 1.1, 0.0), (0.0, 1.0, 0.0)),
    ),
}  # fmt: skip


def scene_of(kind: str, table: dict[str, Any]) -> Scene:
    return Scene({"cloth": {"rows": 2, "columns": 2}, kind: table, "method": {"dt": DT}})


def numbers_of(scene: Scene, real: Any) -> np.ndarray:
    """The collider's row in the kernels' record."""
    return collider_numbers(scene, real)


def record(real: Any) -> np.ndarray:
    """What kernels read of a scene's record where it has no gravity."""
    made = np.zeros(1, record_type(CLOTH_PARAMETERS, real))
    made["dt"] = DT
    return made
