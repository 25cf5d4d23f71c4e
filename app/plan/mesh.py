"""Plan of a step on a mesh on each backend, for `softlab plan`: one pass per colour."""

from __future__ import annotations

from softlab.app.plan.passes import BackendPlan, Pass, cpu_plan, gpu_device, merged_passes, stages_of
from softlab.model.core.options import PRECISIONS
from softlab.model.core.plan import Plan
from softlab.model.position_based.mesh_plan import COLLIDE, UPDATE
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.constraints import SLEEP, SLEEPING

ONE_KERNEL = "all substeps of a call in one kernel"


def _passes(plan: Plan, precision: str, note: str) -> tuple[Pass, ...]:
    """Return the stages of an iteration in the order of the plan, each as a pass; velocities and colliders are one."""
    stages = stages_of(plan)
    last = [stage for stage in stages if stage.name in (UPDATE, COLLIDE)]
    after = [[stage] for stage in stages if stage.name == SLEEP]
    first = [[stage] for stage in stages if stage not in last and [stage] not in after]
    return merged_passes([*first, last, *after], plan, precision, note)


def mesh_on_cpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Return the plan on a CPU: constraints in index arrays, one parallel loop per colour."""
    from softlab.cpu_backend.position_based.mesh import choose_kernel

    why = "index arrays sorted by colour, " + ONE_KERNEL
    if scene.contact is not None:
        why = "index arrays sorted by colour; one call per pass, contacts of surfaces between them"
    elif SLEEPING in plan.parts:
        why = "index arrays sorted by colour; one call per pass"
    return cpu_plan(choose_kernel(None), why, _passes(plan, precision, "a loop over the threads"))


def vertices_on_cpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Return the plan on a CPU: vertices with lists of their tetrahedra, one parallel loop per colour."""
    from softlab.cpu_backend.position_based.mesh import choose_kernel

    why = "vertices sorted by colour, each with its tetrahedra, " + ONE_KERNEL
    if scene.contact is not None:
        why = (
            "vertices sorted by colour, each with its tetrahedra; one call per pass, contacts of surfaces between them"
        )
    return cpu_plan(choose_kernel(None), why, _passes(plan, precision, "a loop over the threads"))


def vertices_on_gpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Return the plan of vertex block descent on a GPU. Works without a GPU."""
    why = "one thread per vertex, one launch per colour, captured as a graph"
    return BackendPlan("gpu", gpu_device()[0], "graph", None, why, _passes(plan, precision, "a launch"))


def mesh_on_gpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Return the plan on a GPU. Works without a GPU."""
    why = "one thread per constraint or voxel, one launch per colour, captured as a graph"
    return BackendPlan("gpu", gpu_device()[0], "graph", None, why, _passes(plan, precision, "a launch"))


def tetrahedra_on_gpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Return the plan of tetrahedra on a GPU. Works without a GPU."""
    from softlab.gpu_backend.tetrahedra.resident_launch import default_slabs, launched_only

    if launched_only(scene, plan.parts):
        return mesh_on_gpu(scene, precision, plan)
    device, limits = gpu_device("that slabs are cut for")
    slabs = default_slabs(scene, PRECISIONS[precision], limits)
    if not slabs:
        return mesh_on_gpu(scene, precision, plan)
    blocks = sum(one.count for one in slabs)
    slabs_text = "1 slab" if blocks == 1 else f"{blocks} slabs"
    why = f"stays on the chip in {slabs_text}, one block each; neighbours synchronize twice per sweep"
    return BackendPlan("gpu", device, "resident", None, why, _passes(plan, precision, "on the chip"))


def newton_on_cpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Return the plan on a CPU: tetrahedra and particles alternate; the number of inner passes is decided at run
    time."""
    stages = [*dict.fromkeys(stages_of(plan))]
    why = "matrix blocks in rows, each summed by its own particle; all substeps of a call in one kernel"
    passes = merged_passes([[stage] for stage in stages], plan, precision, "a loop over the threads")
    return cpu_plan("fused", why, passes)


def newton_on_gpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Return the plan on a GPU: all passes in one kernel, whose blocks synchronise after each. Works without a GPU."""
    stages = [*dict.fromkeys(stages_of(plan))]
    why = "whole steps per launch; thread blocks synchronize after every pass, and the device decides what follows"
    passes = merged_passes([[stage] for stage in stages], plan, precision, "all blocks")
    return BackendPlan("gpu", gpu_device()[0], "cooperative", None, why, passes)
