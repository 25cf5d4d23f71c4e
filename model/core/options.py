"""Run options of a scene: precision, arithmetic, kernel, and the fields that may change while it runs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.core.build import Body
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import CONSTRAINT_KINDS

PRECISIONS = {"float32": np.float32, "float64": np.float64}
MATHS = ("fast", "exact")
LIVE_PATHS = {  # names for `live=`, and the fields whose stage is then compiled even if it starts switched off
    "gravity": ("gravity.enabled", "gravity.acceleration"),
    "poke": (),
    "dt": ("method.dt",),
    "stiffness": ("springs.stiffness", *(f"{kind}.stiffness" for kind in CONSTRAINT_KINDS)),
    "damping": ("damping.coefficient",),
    "targets": (),
    "taps": (),  # the speed of each emitter, by its part's name
    "wind": ("wind.velocity", "wind.density", "wind.drag", "wind.lift"),
}


@dataclass(frozen=True)
class Options:
    """Run options of a scene, separate from its content.

    `kernel` None: the backend's own choice. Of a window of a larger scene (model/domains): `first_particle`, its number
    there, and `body`, the window's particles at the start; None: those of the scene.
    """

    precision: str = "float32"
    math: str = "fast"
    kernel: str | None = None
    live: frozenset[str] = field(default_factory=frozenset)
    first_particle: int | None = None
    body: Body | None = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        for name, value, known in (("--precision", self.precision, tuple(PRECISIONS)), ("--math", self.math, MATHS)):
            if value not in known:
                raise SceneError(name, value, f"must be one of {', '.join(known)}")
        for name in self.live:
            if name not in LIVE_PATHS:
                raise SceneError("live", name, f"must be one of {', '.join(LIVE_PATHS)}")


def check_live(scene: Scene, live: Iterable[str], path: str, value: object) -> None:
    """Raise SceneError for a field that is not `live`, or for which the scene has no code."""
    names = [name for name, paths in LIVE_PATHS.items() if path in paths]
    if path in (f"{name}.speed" for name in scene.emitters):
        names.append("taps")
    if not set(names) & set(live):
        if not names:
            scene.replace({path: value})  # a field that does not exist is refused as in a scene
        remedy = f'with live=("{names[0]}",)' if names else "with this value, since it cannot change while it runs"
        raise SceneError(path, value, f"not live; open the simulation {remedy}")
    part = path.partition(".")[0]
    if part in ("springs", *CONSTRAINT_KINDS, "wind") and part not in scene.parts:
        raise SceneError(path, value, "the scene has no such part, so no code for it was compiled")
    if path in LIVE_PATHS["stiffness"] and scene.method.solver == "pbd":
        raise SceneError(path, value, "pbd has no stiffness; set method.pbd_stiffness, or use xpbd")


def unknown_kernel(wanted: str | None, known: Iterable[str], where: str) -> SceneError:
    """Return the error for a kernel that a solver does not have; `where`: "for a mesh on the cpu"."""
    return SceneError("--kernel", wanted, f"must be one of {', '.join(known)} {where}")
