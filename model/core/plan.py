"""The plan: the tree of named stages of one step of a scene. A solver builds it and contains no loop.

Each backend's executor runs the tree: stage by stage (kernel `stages`), or through a fused kernel that is registered as
the replacement of the whole tree and tested against it. `softlab plan SCENE` prints it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property


@dataclass(frozen=True)
class Stage:
    """A leaf of the plan.

    `reads`, `writes`: scalars per particle and axis of the unfused stage; `operations`: floating-point operations per
    particle; `argument`: the stage time's offset in steps, where needed.
    """

    name: str
    reads: int
    writes: int
    operations: int
    argument: float = 0.0

    def bytes(self, item: int, dimensions: int = 2) -> int:
        """Return the bytes per particle that the stage moves through memory when it runs alone, `item` bytes per
        scalar."""
        return dimensions * item * (self.reads + self.writes)


@dataclass(frozen=True)
class Moment:
    """Time at which a stage runs: step number `step`, `substep` of `substeps`, `iteration`; `argument`: argument of the
    stage."""

    step: int = 0
    substep: int = 0
    iteration: int = 0
    substeps: int = 1
    argument: float = 0.0

    @property
    def number(self) -> int:
        """Number of the substep, counted from time 0."""
        return self.step * self.substeps + self.substep

    @property
    def fresh(self) -> bool:
        """True in the first iteration of a substep, where multipliers are 0."""
        return self.iteration == 0


StageRun = Callable[[Moment], None]


@dataclass(frozen=True)
class Node:
    """A branch of the plan: its children run `times` times (substeps, iterations and colours are such nodes)."""

    name: str
    children: tuple[Node | Stage, ...]
    times: int = 1

    def stages(self) -> Iterator[Stage]:
        """Yield the leaves in the order in which they run, each as often as it runs."""
        for _ in range(self.times):
            for child in self.children:
                if isinstance(child, Stage):
                    yield child
                else:
                    yield from child.stages()

    def leaves(self, at: Moment) -> Iterator[tuple[Stage, Moment]]:
        """Yield the leaves and the moment of each."""
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


Children = Sequence[Node | Stage]


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
        """Return the bytes per particle and step that one fused pass moves, at `item` bytes per scalar. With one force in
        two dimensions and float32 they are 32."""
        return self.dimensions * item * self.fused_scalars

    @cached_property
    def _leaves(self) -> tuple[tuple[Stage, Moment], ...]:
        return tuple(self.root.leaves(Moment()))

    @cached_property
    def substep_parts(self) -> tuple[Children, Children, Children]:
        """Children of a substep before, in and after its iterations."""
        (substep,) = self.root.children
        assert isinstance(substep, Node) and substep.name == "substep"
        (place,) = (
            n for n, child in enumerate(substep.children) if isinstance(child, Node) and child.name == "iteration"
        )
        iteration = substep.children[place]
        assert isinstance(iteration, Node)
        return substep.children[:place], iteration.children, substep.children[place + 1 :]

    def moments(self, step: int) -> Iterator[tuple[Stage, Moment]]:
        """Yield the stages of step number `step` in the order in which they run, and the moment of each."""
        for stage, at in self._leaves:
            yield stage, replace(at, step=step)

    def has(self, name: str) -> bool:
        """Return True if a step has a stage with this name."""
        return any(stage.name == name for stage in self.root.stages())


@dataclass(frozen=True)
class Executor:
    """Executor of a plan on a backend: `fused(step, steps)`, the replacement of the whole tree, or else stage by stage.

    `stages` maps a stage's name to the function that runs it.
    """

    plan: Plan
    stages: Mapping[str, StageRun]
    fused: Callable[[int, int], None] | None = None

    def __post_init__(self) -> None:
        missing = {stage.name for stage in self.plan.root.stages()} - set(self.stages) if self.fused is None else ()
        if missing:
            raise LookupError(f"stages of the plan that nothing runs: {', '.join(sorted(missing))}; bind them")

    def run(self, step: int, steps: int) -> None:
        """Advance by `steps` steps, starting with step number `step`."""
        if self.fused is not None:
            self.fused(step, steps)
            return
        for now in range(step, step + steps):
            for stage, moment in self.plan.moments(now):
                self.stages[stage.name](moment)
