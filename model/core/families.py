"""The registry of solver families. A new family is one entry here, a module `family.py` in its package, and a solver in
each backend's package."""

from __future__ import annotations

from model.core.errors import SceneError
from model.core.family import SolverFamily
from model.core.plan import Plan
from model.fluid.family import FLUID
from model.mass_spring.family import CLOTH, GRID
from model.scene.scene import Scene
from model.shape_matching.family import BODIES, WINDOWS
from model.tetrahedra.family import TETRAHEDRA
from model.tetrahedra.newton import TETRAHEDRA_NEWTON
from model.tetrahedra.vbd import TETRAHEDRA_VBD
from model.world.family import WORLD
from model.xpbd.family import MESH, SHEET

FAMILIES = (GRID, CLOTH, SHEET, MESH, WINDOWS, BODIES, TETRAHEDRA, TETRAHEDRA_VBD, TETRAHEDRA_NEWTON, FLUID, WORLD)


def family_of(scene: Scene) -> SolverFamily:
    """Return the family that solves the scene. Raises SceneError for a part that it does not support."""
    (found,) = (family for family in FAMILIES if family.accepts(scene))
    for name, kind in scene.kinds.items():
        if kind not in found.knows:
            raise SceneError(f"{name}.kind", kind, f"is not supported by the solver of a {found.name}; leave it out")
    return found


def scene_plan(scene: Scene, live: frozenset[str] = frozenset()) -> Plan:
    """What one step of the scene consists of; `live`: parts that may be switched on while running."""
    return family_of(scene).plan(scene, live)


def stability_limit(scene: Scene, frequency: float | None = None) -> float:
    """The largest step size [s] at which the scene's method is stable for any state (may be inf or 0), also once its pins
    have let go; `frequency`: see SolverFamily."""
    return min(family_of(one).limit(one, frequency) for one in (scene, *(later for _, later in scene.phases)))
