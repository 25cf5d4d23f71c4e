"""What each backend makes of a step on a mesh, for `softlab plan`: a pass for each colour."""

from __future__ import annotations

from app.plan.passes import BackendPlan, Pass, gpu_device, item_bytes, merged_pass
from model.core.plan import Plan
from model.scene.scene import Scene


def _passes(plan: Plan, precision: str, note: str) -> tuple[Pass, ...]:
    """The stages of an iteration in the order of the plan, each a pass of its own; velocities and colliders are one."""
    item = item_bytes(precision)
    stages = list({stage.name: stage for stage in plan.root.stages()}.values())
    last = [stage for stage in stages if stage.name in ("update velocity", "collide")]
    found = [
        Pass((stage.name,), stage.bytes(item, plan.dimensions), float(stage.operations), note)
        for stage in stages
        if stage not in last
    ]
    end = merged_pass(last, item, plan.dimensions, note)
    return (*found, end)


def mesh_on_cpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Constraints through index arrays, a parallel loop a colour."""
    from cpu_backend.core.processor import processor_name
    from cpu_backend.xpbd.mesh import choose_kernel

    why = "index arrays sorted by colour, all substeps of a call in one kernel"
    passes = _passes(plan, precision, "a loop over the threads")
    return BackendPlan("cpu", processor_name(), choose_kernel(None), None, why, passes)


def mesh_on_gpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Also where there is no GPU."""
    why = "a thread a constraint, a launch a colour, captured"
    passes = _passes(plan, precision, "a launch")
    return BackendPlan("gpu", gpu_device()[0], "graph", None, why, passes)
