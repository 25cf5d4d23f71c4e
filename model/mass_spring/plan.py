"""The plan of a mass-spring step: the common parts of grid and cloth, and the grid's plan (see model/core/plan.py)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from softlab.model.base.types import Feature
from softlab.model.base.variant import features_of
from softlab.model.contact.sheet_plan import WIND, Stages, particle_force_stages, present_parts
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.core.own_forces import particle_forces, particle_forces_change
from softlab.model.core.plan import Node, Plan, Stage
from softlab.model.formulas import springs
from softlab.model.scene.scene import Scene


def sheet_features(integrator: str, parts: frozenset[str]) -> dict[str, Feature]:
    """Return the features of the kernels of a sheet's `parts`."""
    return {
        **features_of(parts), "changing": particle_forces_change(parts), "damped": "damping" in parts,
        "forced": bool(particle_forces(parts)), "verlet": integrator == "velocity-verlet",
    }  # fmt: skip


def force_stages(parts: frozenset[str], pulls: Stage | None, axes: int, offset: float) -> Stages:
    """Return the stages of the forces on a mass, `offset` steps after the step's beginning; `pulls`: the springs'
    stage, if any."""
    fields = {"gravity": Stage("gravity", 1, 1, 1), "wind": Stage("wind", 3, 1, WIND, offset)}
    damping = (Stage("damping", 2, 1, 2 * axes),) if "damping" in parts else ()
    return (
        pulls or Stage("no forces", 0, 1, 0),
        *(stage for part, stage in fields.items() if part in parts),
        *particle_force_stages(parts),
        *damping,
    )


def stepped(
    integrator: str,
    axes: int,
    forces: Callable[[float], Stages],
    pins: Callable[[float], Stages],
    kicks: tuple[int, int],
    touch: Stages = (),
) -> tuple[Node, int]:
    """Return (the tree of an explicit step, the scalars per particle and axis that it moves when fused).

    `forces`, `pins`: the stages at that offset from the step's beginning; `kicks`: operations of velocity Verlet's two;
    `touch`: collision stages.
    """
    operations = axes * INTEGRATORS[integrator].operations
    children: list[Node | Stage]
    if integrator == "velocity-verlet":
        children = [
            Node("forces at the start", forces(0.0)),
            Stage("first half kick and drift", 3, 2, kicks[0]),
            *touch,
            *pins(1.0),
            Node("forces at the end", forces(1.0)),
            Stage("second half kick", 2, 1, kicks[1]),
            *pins(1.0),
        ]
        return Node(
            "step", tuple(children)
        ), 4  # adjacent kicks of two steps share one pass: one force per step is enough
    if integrator == "rk4":
        children = []
        for stage, (offset, end) in enumerate(((0.0, 0.5), (0.5, 0.5), (0.5, 1.0), (1.0, 1.0)), start=1):
            sums = Stage(f"accumulate (rk4 {stage})", 7, 4, operations // 4)
            children.append(Node(f"stage {stage}", (*forces(offset), sums, *(touch if stage == 4 else ()), *pins(end))))
        return Node("step", tuple(children)), 4 * 10
    children = [*forces(0.0), Stage(f"integrate ({integrator})", 3, 2, operations), *touch, *pins(1.0)]
    return Node("step", tuple(children)), 4


def mass_spring_plan(scene: Scene, live: frozenset[str] = frozenset()) -> Plan:
    """Return the plan of the mass-spring solver for the scene's parts and integrator."""
    parts = present_parts(scene, live)
    integrator = scene.method.integrator
    acting = parts - {"damping"} if integrator == "velocity-verlet" else parts  # its damper is part of the kicks
    pulls = Stage("spring forces", 1, 1, 2 * springs.OPERATIONS_SPRING_2D + 6) if "springs" in parts else None
    pins = (Stage("pins", 0, 0, 0),) if "pins" in parts else ()
    kicks = (12, 6) if "damping" in parts else (8, 4)
    root, scalars = stepped(integrator, 2, partial(force_stages, acting, pulls, 2), lambda offset: pins, kicks)
    return Plan(root, scalars, parts)
