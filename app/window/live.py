"""Fields of a scene that the demo can change while it runs, without reopening it."""

from __future__ import annotations

from softlab.model.core.options import LIVE_PATHS
from softlab.model.scene.scene import Scene
from softlab.model.tables.parts import Gravity


def stiffness_paths(scene: Scene) -> dict[str, float]:
    """Return dotted path -> current stiffness [N/m] of every elastic kind of spring; pbd has none."""
    if scene.method.solver == "pbd":
        return {}
    springs = {"springs": scene.springs} if scene.springs else scene.constraints
    return {f"{kind}.stiffness": one.stiffness for kind, one in springs.items() if not one.inextensible}


def live_parts(scene: Scene) -> tuple[str, ...]:
    """Return the names of the fields that the demo can change in this scene while it runs.

    Gravity always; stiffness of elastic springs; pokes, except of bodies, which are pulled through their state
    (app/window/mouse_constraint.py); dampers and wind if the scene has them, since their code is compiled anyway.
    """
    blows = bool(scene.wind and (scene.wind.drag > 0 or scene.wind.lift > 0))
    damped = bool(scene.damping and scene.damping.coefficient > 0)
    present = {
        "gravity": True, "poke": not scene.bodies, "dt": True, "stiffness": bool(stiffness_paths(scene)),
        "damping": damped, "wind": blows,
    }  # fmt: skip
    return tuple(name for name, is_live in present.items() if is_live)


def live_fields(scene: Scene) -> dict[str, object]:
    """Return dotted path -> value of all live fields of a scene. Gravity is one even if the scene has none."""
    values: dict[str, object] = {}
    for name in live_parts(scene):
        for path in LIVE_PATHS[name]:
            part = path.partition(".")[0]
            if part in scene.parts and name != "stiffness":
                values[path] = scene.value(path)
    if scene.gravity is None:
        values |= {"gravity.enabled": False, "gravity.acceleration": Gravity().acceleration}
    return values | stiffness_paths(scene)
