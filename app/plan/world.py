"""Plan of a world's step on each backend, for `softlab plan`: one pass per stage, of members and between them."""

from __future__ import annotations

from softlab.app.plan.passes import BackendPlan, cpu_plan, gpu_device, merged_passes, stages_of
from softlab.model.core.plan import Plan
from softlab.model.scene.scene import Scene


def world_on_cpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Return the plan on a CPU: one call per stage."""
    passes = merged_passes([[stage] for stage in stages_of(plan)], plan, precision, "a loop over the threads")
    return cpu_plan("stages", "one call per stage: of each member, and of contacts between them", passes)


def world_on_gpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Return the plan on a GPU. Works without a GPU."""
    passes = merged_passes([[stage] for stage in stages_of(plan)], plan, precision, "a launch")
    why = "the launches of each member and of the contacts between them on one stream, captured as a graph"
    return BackendPlan("gpu", gpu_device()[0], "graph", None, why, passes)
