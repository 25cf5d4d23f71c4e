"""Plan of a position-based step on each backend, for `softlab plan`."""

from __future__ import annotations

from softlab.app.plan.passes import BackendPlan, Pass, cpu_plan, gpu_device, item_bytes, merged_passes, stages_of
from softlab.model.core.plan import Node, Plan
from softlab.model.core.simulation import PRECISIONS
from softlab.model.scene.scene import Scene


def _substep(plan: Plan, precision: str, note: str, memory_fraction: float = 1.0) -> tuple[Pass, ...]:
    """Return the single pass that a fused kernel makes of a substep: it reads and writes only the state."""
    substep = plan.root.children[0]
    assert isinstance(substep, Node)
    substeps = substep.times
    stages = list(plan.root.stages())
    each = stages[: len(stages) // substeps]
    names = tuple(dict.fromkeys(stage.name for stage in each))
    moved = memory_fraction * plan.bytes(item_bytes(precision)) / substeps
    return (Pass(names, moved, float(sum(s.operations for s in each)), note),)


def xpbd_on_cpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Return the plan on a CPU: constraints without index arrays, colours one after another along a walk down the
    rows."""
    from softlab.cpu_backend.xpbd.solver import choose_kernel

    why = "colours, iterations and prediction in one pass over the rows"
    if scene.method.matches_shapes:
        why = "prediction, clusters and goals in one pass over the rows per iteration"
    passes = _substep(plan, precision, "a substep; along rows, one band of rows per thread")
    return cpu_plan(choose_kernel(None), why, passes)


def bodies_passes(plan: Plan, precision: str, note: str) -> tuple[Pass, ...]:
    """Return the passes of a substep: forces and prediction; clusters; particles; velocities and colliders."""
    stages = stages_of(plan)
    middle = next(n for n, stage in enumerate(stages) if stage.name == "match clusters")
    groups = [stages[:middle], [stages[middle]], [stages[middle + 1]], stages[middle + 2 :]]
    return merged_passes(groups, plan, precision, note)


def bodies_on_cpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Return the plan on a CPU: clusters in compressed form, whole bodies per thread if there are enough of them."""
    from softlab.cpu_backend.shape_matching.solver import choose_kernel

    why = "index arrays, all substeps of a call in one kernel; a thread computes whole bodies where they divide evenly"
    passes = bodies_passes(plan, precision, "a loop over blocks of particles or clusters")
    return cpu_plan(choose_kernel(None), why, passes)


def bodies_on_gpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Return the plan of bodies on a GPU. Works without a GPU."""
    why = "clusters gather their particles, then particles their clusters; one launch each, captured as a graph"
    passes = bodies_passes(plan, precision, "a launch")
    return BackendPlan("gpu", gpu_device()[0], "graph", None, why, passes)


def xpbd_on_gpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Return the plan on a GPU. Works without a GPU, then for the one that the choice was measured on."""
    from softlab.gpu_backend.xpbd.choice import default_xpbd_kernel

    device, limits = gpu_device("that the choice was measured on")
    kernel, why = default_xpbd_kernel(scene, PRECISIONS[precision], plan.parts, limits)
    note, memory_fraction = "per substep; one thread per mass", 4 / plan.dimensions
    if kernel == "one-block":
        note, memory_fraction = f"{note}, all on the chip", 0.0
    return BackendPlan("gpu", device, kernel, None, why, _substep(plan, precision, note, memory_fraction))
