"""Plan of a fluid's step on a GPU, for `softlab plan`."""

from __future__ import annotations

from softlab.app.plan.fluid import fluid_groups
from softlab.app.plan.passes import BackendPlan, gpu_device, merged_passes
from softlab.model.core.plan import Plan
from softlab.model.scene.scene import Scene


def fluid_on_gpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Return the plan on a GPU. Works without a GPU."""
    from softlab.gpu_backend.fluid.passes import fused_passes

    fused = fused_passes(plan.parts)
    why = "particles sorted by cells in every substep, one thread per particle and its list; "
    if fused:
        why += (
            "the first density is computed with the lists, the last correction with the velocities; captured as a graph"
        )
    else:
        why += "one launch per stage; captured"
    passes = merged_passes(fluid_groups(scene, plan, fused), plan, precision, "a launch, of sorting six")
    return BackendPlan("gpu", gpu_device()[0], "graph", None, why, passes)
