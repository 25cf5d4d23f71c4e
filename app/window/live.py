"""What the demo can change in a scene while it runs, without opening it anew."""

from __future__ import annotations

from typing import Any

from softlab.model.core.options import LIVE_PATHS
from softlab.model.scene.scene import Scene
from softlab.model.tables.parts import Gravity


def stiffness_paths(scene: Scene) -> dict[str, float]:
    """Dotted path -> stiffness [N/m] of every kind of spring in the scene that gives, as it is now; pbd asks for none."""
    if scene.method.solver == "pbd":
        return {}
    springs = {"springs": scene.springs} if scene.springs else scene.constraints
    return {f"{kind}.stiffness": one.stiffness for kind, one in springs.items() if not one.inextensible}


def live_parts(scene: Scene) -> tuple[str, ...]:
    """What the demo can change in this scene while it runs: gravity always, stiffness where springs give, pokes but of
    bodies, which are pulled through their state (app/window/grip.py); dampers and wind where there are any, which compiles
    nothing that is not there anyway."""
    blows = bool(scene.wind and (scene.wind.drag > 0 or scene.wind.lift > 0))
    damped = bool(scene.damping and scene.damping.coefficient > 0)
    present = {
        "gravity": True, "poke": not scene.bodies, "dt": True, "stiffness": bool(stiffness_paths(scene)),
        "damping": damped, "wind": blows,
    }  # fmt: skip
    return tuple(name for name, there in present.items() if there)


def live_fields(scene: Scene) -> dict[str, Any]:
    """Dotted path -> value of all that is live in a scene; gravity is, where there is none too."""
    found: dict[str, Any] = {}
    for name in live_parts(scene):
        for path in LIVE_PATHS[name]:
            part, _, field = path.partition(".")
            if part in scene.parts and name != "stiffness":
                found[path] = getattr(scene.parts[part], field)
    if scene.gravity is None:
        found |= {"gravity.enabled": False, "gravity.acceleration": Gravity().acceleration}
    return found | stiffness_paths(scene)
