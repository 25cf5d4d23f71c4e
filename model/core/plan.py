"""The plan: the tree of named stages that one step of a scene consists of. A solver builds it and owns no loop.

Each backend's executor runs the tree: stage by stage (kernel `stages`), or through a fused kernel that is registered as
the replacement of the whole tree and tested against it. `softlab plan SCENE` prints it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

from model.core.errors import SceneError
from model.core.own_forces import own_forces, own_parts
from model.formulas import integrators as integrator_formulas
from model.formulas import manufactured as manufactured_formulas
from model.formulas import springs as spring_formulas
from model.scene.scene import Scene


@dataclass(frozen=True)
class Stage:
    """A leaf of the plan. `reads` and `writes`: scalars per particle and axis of the unfused stage; `operations`:
    floating-point operations per particle. `argument` is the stage time's offset in steps where it matters."""

    name: str
    reads: int
    writes: int
    operations: int
    argument: float = 0.0

    def bytes(self, item: int, dimensions: int = 2) -> int:
        """Bytes per particle that the stage moves through memory when it runs alone, `item` bytes a scalar."""
        return dimensions * item * (self.reads + self.writes)


@dataclass(frozen=True)
class Moment:
    """When a stage runs: in step number `step`, in which `substep` of `substeps`, in which `iteration` of that; `argument`:
    the stage's own."""

    step: int = 0
    substep: int = 0
    iteration: int = 0
    substeps: int = 1
    argument: float = 0.0

    @property
    def number(self) -> int:
        """Of the substep, counted from time 0."""
        return self.step * self.substeps + self.substep

    @property
    def fresh(self) -> bool:
        """Whether this is a substep's first iteration, where multipliers are 0."""
        return self.iteration == 0


StageRun = Callable[[Moment], None]


@dataclass(frozen=True)
class Node:
    """A branch of the plan: its children run `times` times (substeps, iterations, colours are such nodes)."""

    name: str
    children: tuple[Node | Stage, ...]
    times: int = 1

    def stages(self) -> Iterator[Stage]:
        """The leaves in the order they run, each as often as it runs."""
        for _ in range(self.times):
            for child in self.children:
                if isinstance(child, Stage):
                    yield child
                else:
                    yield from child.stages()

    def leaves(self, at: Moment) -> Iterator[tuple[Stage, Moment]]:
        """The same, and when each runs."""
        for turn in range(self.times):
            if self.name == "substep":
                at = replace(at, substep=turn, substeps=self.times)
            elif self.name == "iteration":
                at = replace(at, iteration=turn)
            for child in self.children:
                if isinstance(child, Stage):
                    yield child, replace(at, argument=child.argument)
                else:
                    yield from child.leaves(at)


@dataclass(frozen=True)
class Plan:
    """`root`: the tree of one step. `fused_scalars`: scalars per particle and axis that one step moves when fused."""

    root: Node
    fused_scalars: int
    parts: frozenset[str] = field(default_factory=frozenset)
    dimensions: int = 2

    @property
    def operations(self) -> int:
        """Floating-point operations per particle and step."""
        return sum(stage.operations for stage in self.root.stages())

    def bytes(self, item: int) -> int:
        """Bytes per particle and step that one fused pass moves, `item` bytes a scalar: 32 for float32, one force."""
        return self.dimensions * item * self.fused_scalars

    @cached_property
    def _leaves(self) -> tuple[tuple[Stage, Moment], ...]:
        return tuple(self.root.leaves(Moment()))

    def moments(self, step: int) -> Iterator[tuple[Stage, Moment]]:
        """The stages of step number `step` in the order in which they run, and when each does."""
        for stage, at in self._leaves:
            yield stage, replace(at, step=step)

    def has(self, name: str) -> bool:
        return any(stage.name == name for stage in self.root.stages())


def present_parts(scene: Scene, live: frozenset[str] = frozenset()) -> frozenset[str]:
    """The parts that need a stage: those of the scene that do anything, and those that may be switched on live."""
    parts = set()
    if scene.springs or "stiffness" in live:
        parts.add("springs")
    if scene.springs and scene.springs.alternate:
        parts.add("alternating")  # no stage of its own: which stiffness a spring has
    if (scene.damping and scene.damping.coefficient > 0) or "damping" in live:
        parts.add("damping")
    gravity = scene.gravity
    if (gravity and gravity.enabled and gravity.acceleration > 0) or "gravity" in live:
        parts.add("gravity")
    if scene.manufactured:
        parts.add("manufactured")
    if scene.grid.pinned not in ("none", []):
        parts.add("pins")
    return frozenset(parts | own_parts(scene, live))


def own_stages(parts: frozenset[str], memory: int = 1) -> tuple[Stage, ...]:
    """Of the forces on a particle by itself; `memory` 0 where they cost none, since positions are predicted with them."""
    return tuple(
        Stage(force.stage, force.traffic * memory, force.traffic * memory, force.operations)
        for force in own_forces(parts)
    )


def mass_spring_plan(scene: Scene, live: frozenset[str] = frozenset()) -> Plan:
    """The plan of the mass-spring solver for the scene's parts and integrator."""
    parts = present_parts(scene, live)
    if scene.springs and {"alternating", "manufactured"} <= parts:
        raise SceneError(
            "springs.stiffness_ratio", scene.springs.stiffness_ratio,
            "must be 1 with a manufactured force, whose formula knows one stiffness",
        )  # fmt: skip
    integrator = scene.method.integrator
    implicit_damping = integrator == "velocity-verlet"  # its damper is part of the kicks

    def forces(offset: float) -> tuple[Stage, ...]:
        stages = []
        if "springs" in parts:
            stages.append(Stage("spring forces", 1, 1, 2 * spring_formulas.OPERATIONS_SPRING_2D + 6))
        else:
            stages.append(Stage("no forces", 0, 1, 0))
        if "gravity" in parts:
            stages.append(Stage("gravity", 1, 1, 1))
        stages.extend(own_stages(parts))
        if "manufactured" in parts:
            stages.append(Stage("manufactured force", 1, 1, manufactured_formulas.OPERATIONS, offset))
        if "damping" in parts and not implicit_damping:
            stages.append(Stage("damping", 2, 1, 4))
        return tuple(stages)

    pins = (Stage("pins", 0, 0, 0),) if "pins" in parts else ()
    per_axis = integrator_formulas.OPERATIONS[integrator]
    if integrator == "velocity-verlet":
        children: tuple[Node | Stage, ...] = (
            Node("forces at the start", forces(0.0)),
            Stage("first half kick and drift", 3, 2, 12 if "damping" in parts else 8),
            *pins,
            Node("forces at the end", forces(1.0)),
            Stage("second half kick", 2, 1, 6 if "damping" in parts else 4),
            *pins,
        )
        scalars = 4  # the kicks of neighbouring steps meet in one pass, so that one force a step is enough
    elif integrator == "rk4":
        steps: list[Node | Stage] = []
        for stage, offset in enumerate((0.0, 0.5, 0.5, 1.0), start=1):
            steps.append(
                Node(
                    f"stage {stage}", (*forces(offset), Stage(f"accumulate (rk4 {stage})", 7, 4, per_axis // 2), *pins)
                )
            )
        children = tuple(steps)
        scalars = 4 * 10
    else:
        children = (*forces(0.0), Stage(f"integrate ({integrator})", 3, 2, 2 * per_axis), *pins)
        scalars = 4
    return Plan(Node("step", children), scalars, parts)


@dataclass(frozen=True)
class Executor:
    """Runs a plan on a backend: `fused(step, steps)`, the replacement of the whole tree, or else stage by stage.

    `stages` maps a stage's name to what runs it.
    """

    plan: Plan
    stages: Mapping[str, StageRun]
    fused: Callable[[int, int], None] | None = None

    def __post_init__(self) -> None:
        missing = {stage.name for stage in self.plan.root.stages()} - set(self.stages) if self.fused is None else ()
        if missing:
            raise LookupError(f"stages of the plan that nothing runs: {', '.join(sorted(missing))}; bind them")

    def run(self, step: int, steps: int) -> None:
        """Advance by `steps` steps, the first of which is number `step`."""
        if self.fused is not None:
            self.fused(step, steps)
            return
        for now in range(step, step + steps):
            for stage, moment in self.plan.moments(now):
                self.stages[stage.name](moment)
