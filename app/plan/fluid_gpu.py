"""What the GPU makes of a fluid's step, for `softlab plan`."""

from __future__ import annotations

from app.plan.passes import BackendPlan, gpu_device, merged_passes, stages_of
from model.core.plan import Plan, Stage
from model.scene.scene import Scene

ALONE = ("sort into cells", "density", "correct", "normals and vorticity")


def fluid_on_gpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Also where there is no GPU."""
    groups: list[list[Stage]] = [[]]
    for stage in stages_of(plan):
        if stage.name in ALONE:
            groups += [[stage], []]
        else:
            groups[-1].append(stage)
    why = (
        "particles sorted by cells in every substep, a thread each walks its list; the first density goes with the "
        "lists, the last correction with the velocities; captured"
    )
    passes = merged_passes([group for group in groups if group], plan, precision, "a launch, of sorting six")
    return BackendPlan("gpu", gpu_device()[0], "graph", None, why, passes)
