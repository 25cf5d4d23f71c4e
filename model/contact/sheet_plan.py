"""Features and stages that the plans of all sheets have in common (see model/core/plan.py)."""

from __future__ import annotations

from softlab.model.core.own_forces import force_features, particle_forces
from softlab.model.core.plan import Stage
from softlab.model.formulas import wind
from softlab.model.scene.scene import Scene
from softlab.model.tables.motion import motions_of_pins

TRIANGLES_EACH = 6  # of a cloth, around a mass
FRICTION_IN_PLACE = "friction-in-place"  # a part: friction of colliders acts on positions, too
WIND = TRIANGLES_EACH * (wind.OPERATIONS_TRIANGLE + 18)  # including the mean velocity of a triangle's corners
Stages = tuple[Stage, ...]


def sheet_parts(scene: Scene, live: frozenset[str] = frozenset()) -> set[str]:
    """Return the parts of a sheet that need a stage: those that have an effect, and those that may be switched on
    during the run."""
    damping, gravity = scene.damping, scene.gravity
    needed = {
        "damping": (damping and damping.coefficient > 0) or "damping" in live,
        "gravity": (gravity and gravity.enabled and gravity.acceleration > 0) or "gravity" in live,
        "pins": scene.grid.pinned not in ("none", []),
    }
    return {name for name, does in needed.items() if does} | force_features(scene, live)


def present_parts(scene: Scene, live: frozenset[str] = frozenset()) -> frozenset[str]:
    """Return the parts of a grid that need a stage, see `sheet_parts`.

    `alternating` has no stage: it selects the stiffness of a spring.
    """
    needed = {"springs": scene.springs or "stiffness" in live, "alternating": scene.springs and scene.springs.alternate}
    return frozenset(sheet_parts(scene, live) | {name for name, does in needed.items() if does})


def particle_force_stages(parts: frozenset[str], memory: int = 1) -> Stages:
    """Return the stages of the forces on single particles; `memory` 0 if they cost none, as a part of the
    prediction."""
    return tuple(
        Stage(force.stage, force.traffic * memory, force.traffic * memory, force.operations)
        for force in particle_forces(parts)
    )


def cloth_parts(scene: Scene, live: frozenset[str] = frozenset()) -> frozenset[str]:
    """Return the parts of a cloth that need code: those of any sheet (`sheet_parts`), springs, wind, motions and
    colliders."""
    parts = sheet_parts(scene, live)
    for kind, springs in scene.cloth_springs.items():
        parts.add(kind)
        if springs.damping > 0:
            parts.add(f"{kind}-damping")
    if scene.wind and (scene.wind.drag > 0 or scene.wind.lift > 0):
        parts.add("wind")
        if scene.wind.gust > 0:
            parts.add("gust")
    if scene.motions:
        motions_of_pins(scene.grid, scene.motions)  # refuses motions of masses that are not pinned
        if any(part.moves for part in scene.motions.values()):
            parts.add("motion")
    for kind, collider in scene.colliders:
        parts.add(kind)
        if collider.static_friction > 0:
            parts.add("friction")
        if collider.restitution > 0:
            parts.add("restitution")
    return frozenset(parts)
