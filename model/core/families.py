"""The registry of solver families. A new family is one entry here, a module `family.py` in its package, and a solver in
each backend's package."""

from __future__ import annotations

from softlab.model.core.errors import SceneError
from softlab.model.core.family import SolverFamily
from softlab.model.core.plan import Plan
from softlab.model.fluid.family import FLUID
from softlab.model.mass_spring.family import CLOTH, GRID
from softlab.model.scene.scene import Scene
from softlab.model.shape_matching.family import BODIES, WINDOWS
from softlab.model.tetrahedra.family import TETRAHEDRA
from softlab.model.tetrahedra.newton import TETRAHEDRA_NEWTON
from softlab.model.tetrahedra.vbd import TETRAHEDRA_VBD
from softlab.model.world.family import WORLD
from softlab.model.xpbd.family import MESH, SHEET

FAMILIES = (GRID, CLOTH, SHEET, MESH, WINDOWS, BODIES, TETRAHEDRA, TETRAHEDRA_VBD, TETRAHEDRA_NEWTON, FLUID, WORLD)


def family_of(scene: Scene) -> SolverFamily:
    """Return the family that solves the scene. Raises SceneError for a part that it does not support."""
    (found,) = (family for family in FAMILIES if family.accepts(scene))
    for name, kind in scene.kinds.items():
        if kind not in found.knows:
            raise SceneError(f"{name}.kind", kind, f"is not supported by the solver of a {found.name}; leave it out")
    return found


def scene_plan(scene: Scene, live: frozenset[str] = frozenset()) -> Plan:
    """List what one step of a scene consists of.

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
