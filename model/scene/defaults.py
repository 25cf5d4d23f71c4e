"""The default `[method]` of a scene, filled in before anything is checked."""

from __future__ import annotations

from softlab.model.scene.members import members_of
from softlab.model.scene.scene_parts import SceneParts
from softlab.model.tables.method import OF_FLUIDS, OF_WORLDS, Method

OF_A_FLUID: dict[str, float] = {"dt": 1 / 60, "substeps": 4, "iterations": 10}
SOLVERS = {"world": OF_WORLDS, "fluids": OF_FLUIDS, "tetrahedra": "xpbd", "bodies": "shape-matching"}  # by content


def take_method_defaults(scene: SceneParts) -> None:
    """Give the scene a method, if it states none, and one for fluids the fields that it does not state."""
    has_fluid = scene.content == "fluids" or "fluid" in members_of(scene.kinds)
    usual, method = OF_A_FLUID if has_fluid else {}, scene.one(Method)
    solver = SOLVERS.get(scene.content)
    if method is None:
        stated = Method() if solver is None else Method(solver=solver)
        scene.parts["method"], scene.kinds["method"] = stated.model_copy(update=usual), "method"
    elif method.solver == solver:
        missing = {field: value for field, value in usual.items() if field not in method.model_fields_set}
        scene.parts[scene.name_of("method")] = method.model_copy(update=missing)
