"""The registry of solver families, which names them and imports none. A new family is one entry here, a module `family.py` in
its package, and a solver in each backend's package."""

from __future__ import annotations

from functools import cache

from softlab.model.base.components import named
from softlab.model.base.errors import SceneError
from softlab.model.core.family import SolverFamily
from softlab.model.core.plan import Plan
from softlab.model.scene.scene import Scene

FAMILIES = (  # module below softlab.model:name
    "mass_spring.family:GRID", "mass_spring.family:CLOTH", "xpbd.family:SHEET", "xpbd.family:MESH",
    "shape_matching.family:WINDOWS", "shape_matching.family:BODIES", "tetrahedra.family:TETRAHEDRA",
    "tetrahedra.vbd:TETRAHEDRA_VBD", "tetrahedra.newton:TETRAHEDRA_NEWTON", "fluid.family:FLUID", "world.family:WORLD",
)  # fmt: skip


@cache
def families() -> tuple[SolverFamily, ...]:
    """Return every family, in the order of the registry."""
    return tuple(named(f"softlab.model.{place}") for place in FAMILIES)


def family_of(scene: Scene) -> SolverFamily:
    """Return the family that solves the scene. Raises SceneError for a part that it does not support."""
    (family,) = (family for family in families() if family.accepts(scene))
    for name, kind in scene.kinds.items():
        if kind not in family.knows:
            raise SceneError(f"{name}.kind", kind, f"is not supported by the solver of a {family.name}; leave it out")
    return family


def scene_plan(scene: Scene, live: frozenset[str] = frozenset()) -> Plan:
    """Return the plan of one step of a scene.

    Parameters
    ----------
    scene : Scene
    live : frozenset of str
        Parts that may be switched on while running.

    Returns
    -------
    Plan
        Stages, with bytes and operations per particle, in order.
    """
    return family_of(scene).plan(scene, live)


def stability_limit(scene: Scene, frequency: float | None = None) -> float:
    """Compute the largest step size at which the scene's method is stable for any state.

    Parameters
    ----------
    scene : Scene
    frequency : float, optional
        Largest angular frequency of the scene, rad/s, where it is known already.

    Returns
    -------
    float
        Step size, s; may be inf or 0.
    """
    return min(family_of(one).limit(one, frequency) for one in (scene, *(later for _, later in scene.phases)))
