"""What each backend makes of a step of the lab's grid: its kernel, and what that moves and computes in a pass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from app.plan.passes import BackendPlan, Pass, leaves
from model.core.plan import Node, Plan, Stage
from model.core.simulation import PRECISIONS
from model.formulas.springs import OPERATIONS_SPRING_2D
from model.scene.scene import Scene

EACH_ONCE = 2.0  # springs a mass, each computed once: a grid's interior has as many right and below as masses
SPRINGS_OF_A_MASS = 4.0


def _merged(plan: Plan) -> list[list[Stage]]:
    """The stages of each pass that a fused kernel makes over the grid in a step, in order.

    Velocity Verlet's force at the end of a step is the next one's at its start, so that one pass does the end of one and
    the start of the next; its random force is taken for both.
    """
    children = plan.root.children
    if plan.has("second half kick"):
        first, last = (list(leaves(child)) for child in children if isinstance(child, Node))
        again = [stage for stage in first if stage.name == "external force"]
        kicks = {stage.name: stage for stage in plan.root.stages()}
        pins = [kicks["pins"]] if "pins" in kicks else []
        return [[*last, *again, kicks["second half kick"], kicks["first half kick and drift"], *pins]]
    if all(isinstance(child, Node) for child in children):  # the stages of a Runge-Kutta method
        return [list(leaves(child)) for child in children]
    return [list(plan.root.stages())]


def _passes(plan: Plan, item: int, springs: float, way: float, note: str) -> tuple[Pass, ...]:
    """`springs` computed a mass; `way`: of the bytes of a whole pass through memory, what one pass takes."""
    merged = _merged(plan)
    more_springs = (springs - EACH_ONCE) * OPERATIONS_SPRING_2D
    moved = way * plan.bytes(item) / len(merged)
    found = []
    for stages in merged:
        operations = float(sum(stage.operations for stage in stages))
        operations += more_springs * any(stage.name == "spring forces" for stage in stages)
        found.append(Pass(tuple(stage.name for stage in stages), moved, operations, note))
    if plan.has("second half kick"):
        found[0] = replace(found[0], note=note + "; the end of a step and the start of the next are one pass")
    return tuple(found)


def grid_on_cpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """What a CPU makes of a step of the lab's grid of springs."""
    from cpu_backend.core.processor import processor_name
    from cpu_backend.mass_spring.grid.choice import LEVELS, default_kernel

    real = PRECISIONS[precision]
    kernel, why = default_kernel(scene, real)
    sums = scene.method.integrator == "rk4" or plan.parts & {"external", "manufactured", "poke", "alternating"}
    loops = "through rows of sums" if sums else "one loop along a row"
    note = {"tiled": f"{loops}, {LEVELS} steps in flight"}.get(kernel, f"{loops}, a band of rows a thread")
    way = 1 / LEVELS if kernel == "tiled" else 1.0
    passes = _passes(plan, np.dtype(real).itemsize, EACH_ONCE, way, note)
    return BackendPlan("cpu", processor_name(), kernel, None, why, passes)


def grid_on_gpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """The same of a GPU; where there is none, of the one that the table of kernels was measured on."""
    from gpu_backend.core.device import gpu_available, simulated
    from gpu_backend.mass_spring.grid.choice import MEASURED_LIMITS, MEASURED_ON, default_kernel

    real = PRECISIONS[precision]
    available, device = gpu_available()
    if not available:
        device = f"none here; as on the {MEASURED_ON} of the table"
    limits = None if available and not simulated() else MEASURED_LIMITS
    kernel, tile, why = default_kernel(scene, real, limits)
    springs, way, note = SPRINGS_OF_A_MASS, 1.0, "one thread a mass"
    if tile is not None:
        from gpu_backend.mass_spring.grid.tile_launch import blocks_of

        across, down = blocks_of(scene.grid.rows, scene.grid.columns, tile)
        springs = 3 + 1 / tile.strip
        note = f"{tile.strip} masses a thread" if tile.strip > 1 else "one thread a mass"
        halos = across * down * tile.masses / scene.grid.particle_count if across * down > 1 else 1.0
        if kernel == "one-block":
            way, note = 0.0, f"{note}, all on the chip"
        elif kernel == "resident":
            way = (halos - 1) / max(tile.halo, 1)
            note += f", {across} x {down} tiles on the chip, borders exchanged every {tile.halo} steps"
        else:
            way = (halos + 1) / 2 / tile.halo
            note += f", {tile.halo} steps for one way through memory"
        if halos > 1:
            note += f"; with the halos {halos:.2f} x the masses"
    passes = _passes(plan, np.dtype(real).itemsize, springs, way, note)
    return BackendPlan("gpu", device, kernel, tile.name if tile else None, why, passes)
