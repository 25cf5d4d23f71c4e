"""Methods that are compared with each other: integrators of the springs' forces, and position-based solvers.

A method's name is `Method.name`: that of an integrator, or e.g. `xpbd jacobi`. A position-based method is defined only
together with its substeps and iterations; it is compared with the motion of the same scene by Newton's law.
"""

from __future__ import annotations

from softlab.model.base.errors import SceneError
from softlab.model.base.table import Tables
from softlab.model.core.families import family_of
from softlab.model.core.integrators import IMPLICIT, INTEGRATORS, integrators_for
from softlab.model.scene.scene import Scene

XPBD = ("xpbd gauss-seidel", "xpbd jacobi", "xpbd averaged-jacobi")
WRONG = {"xpbd averaged-jacobi": "another stiffness"}  # method -> what it converges to instead of the scene's motion
METHODS = (*INTEGRATORS, *XPBD)  # for every sheet
MATCHING = "shape-matching"  # for bodies
TETRAHEDRAL = (XPBD[0], "vbd", "newton")  # for tetrahedral bodies
FLUIDS = ("pbf macklin", "pbf averaged", "pbf divergence-free")  # for fluids
OF_CLOTHS = tuple(IMPLICIT)
XPBD_ORDER = 1  # order of the error at a fixed time: with converged iterations xpbd is implicit Euler


def position_based(name: str) -> bool:
    """True if the method of that name has iterations."""
    return name in XPBD


# if quick; float64 has all: each further one is machine code of its own
QUICK_FLOAT32 = ("lab", "velocity-verlet", "rk4")


def fits(scene: Scene, name: str) -> bool:
    """True if the method can step the scene's sheet: implicit Euler needs a cloth, a load needs xpbd."""
    if scene.loads and not position_based(name):
        return False
    return position_based(name) or name in integrators_for(scene)


def admitted(scene: Scene) -> str:
    """Return which methods can step the scene's sheet, where these are not all, as words; else an empty string."""
    return "" if fits(scene, METHODS[0]) else "only position-based solvers, since no other supports loads"


def changes(name: str, iterations: int = 1, substeps: int = 1) -> dict[str, object]:
    """Return the fields of a scene, by dotted path, that select this method, whatever solver the scene names."""
    if not position_based(name):
        return {"method.solver": "mass-spring", "method.integrator": name}
    solver, ordering = name.split()
    fields = {"solver": solver, "ordering": ordering, "iterations": iterations, "substeps": substeps}
    return {f"method.{field}": value for field, value in fields.items()}


def efforts(method: Tables) -> tuple[int | None, int | None]:
    """Return (iterations, substeps) of a method's table; None for one that it does not have."""
    return method.get("iterations"), method.get("substeps")


def why_unknown(scene: Scene) -> str | None:
    """Return the reason why the scene's motion has no converged reference, with a remedy; None if it has one.

    A reference exists if Newton's law determines the motion and bench/reference/ supports all parts of the scene. Every
    command that reports an error depends on this function. Constraints must be springs: an inextensible constraint has
    no force law, the stiffness of pbd depends on its step size and iterations, and clusters are another material.
    """
    family = family_of(scene)
    if family.unknown is not None:
        return family.unknown
    if scene.whole.phases:
        return "no converged reference supports released pins; leave out [release]"
    if scene.self_collision:
        return (
            "a cloth in contact with itself has no converged reference; leave out [self_collision], or see softlab run"
        )
    if scene.attachments:
        return "no converged reference supports long-range attachments; leave out [attachments]"
    if scene.method.solver == "pbd":
        return (
            "pbd has no converged reference: its stiffness is that of its step size and iterations; "
            "--set method.solver=xpbd has the springs'"
        )
    if any(springs.inextensible for springs in (scene.springs, *scene.cloth_springs.values()) if springs):
        return "inextensible springs (compliance 0) have no converged reference; give them a compliance"
    return None


def newton(scene: Scene) -> Scene:
    """Return the same scene for the solver mass-spring, from which references are made.

    Raises SceneError, with what to request instead, where `why_unknown` gives a reason; also for loads, which the
    references support but that solver does not.
    """
    why = why_unknown(scene)
    if why is None and scene.loads:
        why = "mass-spring has no converged reference for different masses; leave out loads, or see softlab run"
    if why is not None:
        raise SceneError("method.solver", scene.method.solver, why)
    return scene.replace({"method.solver": "mass-spring"}) if scene.method.position_based else scene


def sweeps(name: str, iterations: int = 1, substeps: int = 1) -> int:
    """Return the cost of a step in sweeps over all springs: force evaluations, or iterations."""
    return substeps * iterations if position_based(name) else INTEGRATORS[name].forces


def order_of(name: str) -> int:
    """Return the order of the error at a fixed time, if the iterations are converged."""
    return XPBD_ORDER if position_based(name) else INTEGRATORS[name].order
