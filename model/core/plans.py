"""The plan of any scene: of its solver, whichever that is."""

from __future__ import annotations

from model.core.plan import Plan, mass_spring_plan
from model.mass_spring.cloth_plan import cloth_plan
from model.scene.scene import Scene
from model.xpbd.mesh_plan import xpbd_mesh_plan
from model.xpbd.plan import xpbd_plan


def scene_plan(scene: Scene, live: frozenset[str] = frozenset()) -> Plan:
    """What one step of the scene consists of; `live`: parts that may be switched on while running."""
    if scene.mesh:
        return xpbd_mesh_plan(scene, live)
    if scene.method.position_based:
        return xpbd_plan(scene, live)
    return (cloth_plan if scene.cloth else mass_spring_plan)(scene, live)
