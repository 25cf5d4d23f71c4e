"""Plan of the grid's step on each backend, for `softlab plan`: its kernel, and the bytes and operations of a pass."""

from __future__ import annotations

from softlab.app.plan.passes import BackendPlan, cpu_plan, fused_passes, gpu_device
from softlab.model.core.own_forces import particle_forces
from softlab.model.core.plan import Plan
from softlab.model.core.simulation import PRECISIONS
from softlab.model.formulas.springs import OPERATIONS_SPRING_2D
from softlab.model.scene.scene import Scene

EACH_ONCE = 2.0  # springs per mass, each computed once: inner masses have one to the right and one below
SPRINGS_OF_A_MASS = 4.0


def grid_on_cpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Return the plan of a step of the lab's grid of springs on a CPU."""
    from softlab.cpu_backend.mass_spring.grid.choice import LEVELS, default_kernel

    kernel, why = default_kernel(scene, PRECISIONS[precision])
    sums = scene.method.integrator == "rk4" or particle_forces(plan.parts) or "alternating" in plan.parts
    loops = "through rows of sums" if sums else "one loop along a row"
    note = {"tiled": f"{loops}, {LEVELS} steps in flight"}.get(kernel, f"{loops}, a band of rows per thread")
    memory_fraction = 1 / LEVELS if kernel == "tiled" else 1.0
    passes = fused_passes(plan, precision, memory_fraction, note)
    return cpu_plan(kernel, why, passes)


def grid_on_gpu(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Return the plan on a GPU; without one, for the GPU that the table of kernels was measured on."""
    from softlab.gpu_backend.mass_spring.grid.choice import default_kernel

    device, limits = gpu_device("of the table")
    kernel, tile, why = default_kernel(scene, PRECISIONS[precision], limits)
    springs, memory_fraction, note = SPRINGS_OF_A_MASS, 1.0, "one thread per mass"
    if tile is not None:
        from softlab.gpu_backend.mass_spring.grid.tile_launch import blocks_of

        across, down = blocks_of(scene.grid.rows, scene.grid.columns, tile)
        springs = 3 + 1 / tile.strip
        note = f"{tile.strip} masses per thread" if tile.strip > 1 else "one thread per mass"
        halos = across * down * tile.masses / scene.grid.particle_count if across * down > 1 else 1.0
        if kernel == "one-block":
            memory_fraction, note = 0.0, f"{note}, all on the chip"
        elif kernel == "resident":
            memory_fraction = (halos - 1) / max(tile.halo, 1)
            note += f", {across} x {down} tiles on the chip, borders exchanged every {tile.halo} steps"
        else:
            memory_fraction = (halos + 1) / 2 / tile.halo
            note += f", {tile.halo} steps per pass through memory"
        if halos > 1:
            note += f"; with the halos {halos:.2f} x the masses"
    more = (springs - EACH_ONCE) * OPERATIONS_SPRING_2D
    passes = fused_passes(plan, precision, memory_fraction, note, more=more)
    return BackendPlan("gpu", device, kernel, tile.name if tile else None, why, passes)
