"""The methods that are held against each other: integrators of the springs' forces, and position-based solvers.

A method's name is `Method.name`: an integrator's, or `xpbd jacobi`. A position-based one is a way to solve a scene only with
its substeps and iterations; what it is held against is the motion of the same scene by Newton's law.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from model.core.errors import SceneError
from model.core.families import family_of
from model.core.integrators import IMPLICIT, INTEGRATORS
from model.scene.scene import Scene

XPBD = ("xpbd gauss-seidel", "xpbd jacobi", "xpbd averaged-jacobi")
WRONG = {"xpbd averaged-jacobi": "another stiffness"}  # what a method converges to that is not the scene's
METHODS = (*INTEGRATORS, *XPBD)  # of every sheet
MATCHING = "shape-matching"  # of bodies
TETRAHEDRAL = (XPBD[0], "vbd", "newton")  # of tetrahedral ones
FLUIDS = ("pbf macklin", "pbf averaged", "pbf divergence-free")  # of fluids
OF_CLOTHS = tuple(IMPLICIT)
XPBD_ORDER = 1  # of the error at a fixed time: converged, it is implicit Euler


def position_based(name: str) -> bool:
    """Whether a method of that name has iterations."""
    return name in XPBD


QUICK_FLOAT32 = ("lab", "velocity-verlet", "rk4")  # if quick; in float64 all: each more is machine code of its own


def fits(scene: Scene, name: str) -> bool:
    """Whether the scene's sheet can be stepped by a method of that name: implicit Euler takes a cloth, a load xpbd."""
    if scene.loads and not position_based(name):
        return False
    return name not in OF_CLOTHS or scene.cloth is not None


def changes(name: str, iterations: int = 1, substeps: int = 1) -> dict[str, Any]:
    """The fields of a scene, by dotted path, that make it be solved so, whichever solver it names itself."""
    if not position_based(name):
        return {"method.solver": "mass-spring", "method.integrator": name}
    solver, ordering = name.split()
    fields = {"solver": solver, "ordering": ordering, "iterations": iterations, "substeps": substeps}
    return {f"method.{field}": value for field, value in fields.items()}


def name_of(method: Mapping[str, Any]) -> str:
    """The name of a method from its table, as stores hold it."""
    ordering = method.get("scheme") or method.get("ordering")
    return str(method.get("integrator") or (f"{method['solver']} {ordering}" if ordering else method["solver"]))


def efforts(method: Mapping[str, Any]) -> tuple[int | None, int | None]:
    """(iterations, substeps) of a method's table; None each where it has none."""
    return method.get("iterations"), method.get("substeps")


def why_unknown(scene: Scene) -> str | None:
    """Why there is no converged reference of the scene's motion, and what to do; None where there is one, because Newton's
    law tells that motion, and bench/reference/ knows all of its parts. What any command says of an error hangs on it.

    Constraints must be springs: what does not give has no force by a law, a pbd's stiffness is that of its step size and
    iterations, and clusters are another material."""
    family = family_of(scene)
    if family.unknown is not None:
        return family.unknown
    if scene.self_collision:
        return "a cloth that meets itself has no converged reference; leave out [self_collision], or see softlab run"
    if scene.attachments:
        return "no converged reference knows long-range attachments; leave out [attachments]"
    if scene.method.solver == "pbd":
        return (
            "pbd has no converged reference: its stiffness is that of its step size and iterations; "
            "--set method.solver=xpbd has the springs'"
        )
    if any(springs.inextensible for springs in (scene.springs, *scene.cloth_springs.values()) if springs):
        return "springs that do not give (compliance 0) have no converged reference; give them a compliance"
    return None


def newton(scene: Scene) -> Scene:
    """The same scene for the solver mass-spring: what references are made for. Raises SceneError, with what to ask instead,
    by `why_unknown`; also for loads, which references know, but not that solver."""
    why = why_unknown(scene)
    if why is None and scene.loads:
        why = (
            "no converged reference can be had by mass-spring where masses differ; leave out loads, or see softlab run"
        )
    if why is not None:
        raise SceneError("method.solver", scene.method.solver, why)
    return scene.replace({"method.solver": "mass-spring"}) if scene.method.position_based else scene


def sweeps(name: str, iterations: int = 1, substeps: int = 1) -> int:
    """What a step costs in sweeps over all springs: force evaluations, or iterations."""
    return substeps * iterations if position_based(name) else INTEGRATORS[name].forces


def order_of(name: str) -> int:
    """Of the error at a fixed time, as far as iterations leave none over."""
    return XPBD_ORDER if position_based(name) else INTEGRATORS[name].order
