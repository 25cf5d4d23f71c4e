"""Plan of a fluid's step on a GPU, for `softlab plan`."""

from __future__ import annotations

from softlab.app.plan.passes import BackendPlan, gpu_device, merged_passes, stages_of
from softlab.model.core.plan import Plan, Stage
from softlab.model.scene.scene import Scene

ALONE = ("sort into cells", "density", "correct", "normals and vorticity")


def fluid_on_gpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Return the plan on a GPU. Works without a GPU."""
    if "divergence-free" in plan.parts:
        why = (
            "particles sorted by cells in every substep, one thread per particle and its list; one launch per stage; "
            "captured"
        )
        return _launches(why, [[stage] for stage in stages_of(plan)], plan, precision)
    groups: list[list[Stage]] = [[]]
    for stage in stages_of(plan):
        if stage.name in ALONE:
            groups += [[stage], []]
        else:
            groups[-1].append(stage)
    why = (
        "particles sorted by cells in every substep, one thread per particle and its list; the first density is computed "
        "with the lists, the last correction with the velocities; captured as a graph"
    )
    return _launches(why, [group for group in groups if group], plan, precision)


def _launches(why: str, groups: list[list[Stage]], plan: Plan, precision: str) -> BackendPlan:
    passes = merged_passes(groups, plan, precision, "a launch, of sorting six")
    return BackendPlan("gpu", gpu_device()[0], "graph", None, why, passes)
