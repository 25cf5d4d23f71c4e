"""Passes of a backend over the stages of a step; each does several stages at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from softlab.model.core.own_forces import particle_forces
from softlab.model.core.plan import Node, Plan, Stage
from softlab.model.core.simulation import PRECISIONS


@dataclass(frozen=True)
class Pass:
    """One pass of a kernel: `stages` by name, in order; `bytes` through memory and `operations` per mass and pass;
    `note`: a description."""

    stages: tuple[str, ...]
    bytes: float
    operations: float
    note: str


def merged_pass(stages: Sequence[Stage], item: int, dimensions: int, note: str, memory_fraction: float = 1.0) -> Pass:
    """Return one pass that does all `stages`.

    Values are `item` bytes; results that one stage passes to the next are not counted. `memory_fraction`: fraction of
    the bytes that go through memory.
    """
    moved = memory_fraction * max(stage.bytes(item, dimensions) for stage in stages)
    operations = sum(stage.operations for stage in stages)
    return Pass(tuple(stage.name for stage in stages), float(moved), float(operations), note)


@dataclass(frozen=True)
class BackendPlan:
    """Plan of a step on a backend: on `device`, by `kernel` (with its `tile`, if any) for the reason `why`.

    If stages were to be measured: `unmeasured`, why they could not be; `empty`, seconds of an empty stage; `step`, of a
    whole step by `kernel`.
    """

    name: str
    device: str
    kernel: str
    tile: str | None
    why: str
    passes: tuple[Pass, ...]
    unmeasured: str | None = None
    empty: float | None = None
    step: float | None = None


def cpu_plan(kernel: str, why: str, passes: tuple[Pass, ...]) -> BackendPlan:
    """Return the plan on this machine's processor."""
    from softlab.cpu_backend.core.processor import processor_name

    return BackendPlan("cpu", processor_name(), kernel, None, why, passes)


def item_bytes(precision: str) -> int:
    """Return the bytes of a scalar."""
    return np.dtype(PRECISIONS[precision]).itemsize


def gpu_device(choice: str = "") -> tuple[str, tuple[int, int] | None]:
    """Return (description of the GPU, its limits for the choice of kernels, None for the present GPU).

    Without a GPU, `choice` describes the GPU on which the choice was measured.
    """
    from softlab.gpu_backend.core.device import gpu_available, simulated

    available, device = gpu_available()
    if not choice:
        return (device if available else "none on this machine"), None
    from softlab.gpu_backend.mass_spring.grid.choice import MEASURED_LIMITS, MEASURED_ON

    if not available:
        device = f"none on this machine; choice for the {MEASURED_ON} {choice}"
    return device, None if available and not simulated() else MEASURED_LIMITS


def leaves(node: Node | Stage) -> Iterator[Stage]:
    """Iterate over the stages below a node, or the stage itself."""
    yield from (node,) if isinstance(node, Stage) else node.stages()


def stages_of(plan: Plan) -> list[Stage]:
    """Return each stage once, in the order of first occurrence."""
    return list({stage.name: stage for stage in plan.root.stages()}.values())


def merged_passes(
    groups: Sequence[Sequence[Stage]], plan: Plan, precision: str, note: str, memory_fraction: float = 1.0
) -> tuple[Pass, ...]:
    """Return a `merged_pass` for each group of stages."""
    return tuple(merged_pass(group, item_bytes(precision), plan.dimensions, note, memory_fraction) for group in groups)


def fused_groups(plan: Plan, combine_kicks: bool) -> list[list[Stage]]:
    """Return the stages of each pass of a fused kernel of explicit steps over a sheet in a step, in order.

    `combine_kicks`: velocity Verlet's force at the end of a step is that at the start of the next one, so one pass does
    the end of one and the start of the next; its random force is computed for both.
    """
    children = plan.root.children
    halves = [list(leaves(child)) for child in children if isinstance(child, Node)]
    if plan.has("second half kick"):
        (first, last), named = halves, {stage.name: stage for stage in plan.root.stages()}
        kick = named["second half kick"]
        moved = [named[name] for name in ("first half kick and drift", "collide", "pins") if name in named]
        if combine_kicks:
            changing = {force.stage for force in particle_forces(plan.parts) if force.changes}
            again = [stage for stage in first if stage.name in changing]
            return [[*last, *again, kick, *moved]]
        return [[*first, *moved], [*last, kick]]
    if halves and len(halves) == len(children):  # the stages of a Runge-Kutta method
        return halves
    return [list(plan.root.stages())]


def fused_passes(
    plan: Plan, precision: str, memory_fraction: float, note: str, *, combine_kicks: bool = True, more: float = 0.0
) -> tuple[Pass, ...]:
    """Return the passes of `fused_groups`.

    `memory_fraction`: fraction of the state's bytes that a pass moves through memory; `more`: additional operations per
    mass for springs that are computed twice.
    """
    groups = fused_groups(plan, combine_kicks)
    verlet = plan.has("second half kick")
    moved = memory_fraction * plan.bytes(item_bytes(precision)) / (1 if verlet else len(groups))
    if verlet and combine_kicks:
        note += "; the end of a step and the start of the next are one pass"
    elif verlet:
        note += "; two passes per step, because a force depends on the velocity of neighbours"
    passes = []
    for stages in groups:
        operations = float(sum(stage.operations for stage in stages))
        operations += more * any(stage.name == "spring forces" for stage in stages)
        passes.append(Pass(tuple(stage.name for stage in stages), moved, operations, note))
    return tuple(passes)
