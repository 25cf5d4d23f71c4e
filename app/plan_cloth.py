"""What each backend makes of a cloth's step, for `softlab plan`: the kernel, why, and what its passes move and compute."""

from __future__ import annotations

import numpy as np

from app.plan_report import BackendPlan, Pass, leaves
from model.cloth_plan import kicks_meet
from model.plan import Node, Plan, Stage
from model.scene import Scene
from model.simulation import PRECISIONS


def cloth_passes(plan: Plan, item: int, way: float, note: str) -> tuple[Pass, ...]:
    """The passes over the sheet of a fused kernel in a step; `way`: of the state's way through memory, what one takes.

    Velocity Verlet's kicks of neighbouring steps meet in one pass, unless a force depends on a neighbour's velocity.
    """
    children = plan.root.children
    halves = [list(leaves(child)) for child in children if isinstance(child, Node)]
    if plan.has("second half kick"):
        named = {stage.name: stage for stage in plan.root.stages()}
        moved = [named[name] for name in ("first half kick and drift", "collide", "pins") if name in named]
        if kicks_meet(plan.parts):
            groups = [[*halves[1], named["second half kick"], *moved]]
            note += "; the end of a step and the start of the next are one pass"
        else:
            groups = [[*halves[0], *moved], [*halves[1], named["second half kick"]]]
            note += "; two passes a step, because a force depends on a neighbour's velocity"
    elif halves and len(halves) == len(children):  # the stages of a Runge-Kutta method
        groups = halves
    else:
        groups = [list(plan.root.stages())]
    moved_bytes = way * plan.bytes(item) * (1 if plan.has("second half kick") else 1 / len(groups))

    def one(stages: list[Stage]) -> Pass:
        return Pass(tuple(s.name for s in stages), moved_bytes, float(sum(s.operations for s in stages)), note)

    return tuple(one(stages) for stages in groups)


def cloth_on_cpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Each spring and each triangle once, on the way down the rows."""
    from cpu_backend.cloth import choose_kernel
    from cpu_backend.mass_spring import processor_name

    passes = cloth_passes(plan, np.dtype(PRECISIONS[precision]).itemsize, 1.0, "along rows, a band of rows a thread")
    return BackendPlan("cpu", processor_name(), choose_kernel(None), None, "one pass over the sheet a force", passes)


def cloth_on_gpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Also where there is no GPU: then for the one that the choice was measured on."""
    from gpu_backend.choice import MEASURED_LIMITS, MEASURED_ON
    from gpu_backend.cloth_choice import default_cloth_kernel
    from gpu_backend.device import gpu_available, simulated

    available, device = gpu_available()
    if not available:
        device = f"none here; as on the {MEASURED_ON} that the choice was measured on"
    limits = None if available and not simulated() else MEASURED_LIMITS
    real = PRECISIONS[precision]
    kernel, why = default_cloth_kernel(scene, real, plan.parts, limits)
    note = "one thread a mass, each gathers its springs and triangles"
    way = 4 / 3  # a mass's vectors have a fourth number
    if kernel == "one-block":
        note, way = f"{note}, all on the chip", 0.0
    return BackendPlan("gpu", device, kernel, None, why, cloth_passes(plan, np.dtype(real).itemsize, way, note))
