"""The step size of methods that project constraints, which only masses with dampers limit."""

from __future__ import annotations

from math import inf

from softlab.model.core.integrators import fastest_damping
from softlab.model.scene.scene import Scene


def projection_limit(scene: Scene, frequency: float | None = None) -> float:
    """Return the largest stable step size [s]: infinite, unless masses have dampers, which are explicit.

    h c/m < 2, h the substep, m the lightest mass; for tetrahedral bodies also h times their own rate.
    """
    fastest = max(fastest_damping(scene), *(part.mass_damping for part in scene.tetrahedra.values()), 0.0)
    return 2 * scene.method.substeps / fastest if fastest else inf


def projection_note(scene: Scene) -> str:
    """Return a line on the effect of projections on a motion, and on the limit of the step size, if there is one."""
    return with_limit(scene, "constraints are projected, at any step size; first order, and damped by it")


def with_limit(scene: Scene, text: str) -> str:
    """Return `text` on a method without a limit, with the limit of the masses' damper, if there is one."""
    return text + ("; the limit is that of the masses' damper" if projection_limit(scene) < inf else "")
