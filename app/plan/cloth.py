"""Plan of a cloth's step on each backend, for `softlab plan`: the kernel, the reason, and the bytes and operations of
its passes."""

from __future__ import annotations

from softlab.app.plan.passes import BackendPlan, Pass, cpu_plan, fused_passes, gpu_device, merged_passes
from softlab.model.core.plan import Plan
from softlab.model.core.simulation import PRECISIONS
from softlab.model.mass_spring.cloth_plan import PRODUCT_STAGE, kicks_coupled
from softlab.model.scene.scene import Scene


def cloth_passes(plan: Plan, precision: str, memory_fraction: float, note: str) -> tuple[Pass, ...]:
    """Return the passes over the sheet of a fused kernel in a step.

    `memory_fraction`: fraction of the state's bytes that one pass moves through memory. Velocity Verlet's kicks of
    neighbouring steps are combined in one pass, unless a force depends on a neighbour's velocity.
    """
    if plan.has(PRODUCT_STAGE):
        return implicit_passes(plan, precision, memory_fraction, note)
    return fused_passes(plan, precision, memory_fraction, note, combine_kicks=kicks_coupled(plan.parts))


def implicit_passes(plan: Plan, precision: str, memory_fraction: float, note: str) -> tuple[Pass, ...]:
    """Return the passes of implicit Euler, for one matrix and one iteration.

    Forces at the start, and stages that move no data of their own (colliders, pins), belong to the pass of their
    neighbours.
    """
    stages = list(plan.root.stages())
    begin = next(n for n, stage in enumerate(stages) if stage.name == "begin")
    end = next(n for n, stage in enumerate(stages) if stage.name == "take over")
    groups = [stages[: begin + 1], *([stage] for stage in stages[begin + 1 : end]), stages[end:]]
    note += "; the number of matrices and iterations of a step depends on the residuals"
    return merged_passes(groups, plan, precision, note, memory_fraction)


def cloth_on_cpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Return the plan on a CPU: each spring and each triangle once, along a walk down the rows."""
    from softlab.cpu_backend.mass_spring.cloth.solver import choose_kernel

    passes = cloth_passes(plan, precision, 1.0, "along rows, one band of rows per thread")
    why = "repeats until residuals are small" if plan.has(PRODUCT_STAGE) else "one pass over the sheet per force"
    return cpu_plan(choose_kernel(None), why, passes)


def cloth_on_gpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Return the plan on a GPU. Works without a GPU, then for the one that the choice was measured on."""
    from softlab.gpu_backend.mass_spring.cloth.choice import choose_cloth

    device, limits = gpu_device("that the choice was measured on")
    kernel, tile, why = choose_cloth(scene, PRECISIONS[precision], plan.parts, limits)
    if plan.has(PRODUCT_STAGE):
        kernel, tile, why = "cooperative", None, "whole steps in one launch; residuals are checked on the device"
    note = "one thread per mass, which gathers its springs and triangles"
    memory_fraction = 4 / 3  # a mass's vectors have a fourth number
    if kernel == "one-block":
        note, memory_fraction = f"{note}, all on the chip", 0.0
    elif kernel == "resident" and tile:
        note, memory_fraction = (
            f"{tile.strip} masses per thread, all on the chip, borders sent every {tile.halo} steps",
            0.0,
        )
    passes = cloth_passes(plan, precision, memory_fraction, note)
    return BackendPlan("gpu", device, kernel, tile.name if tile else None, why, passes)
