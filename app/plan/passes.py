"""What a backend makes of the stages of a step: passes, each of which does several of them at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from model.core.plan import Node, Stage


@dataclass(frozen=True)
class Pass:
    """What a kernel does in one pass: `stages` by name, in order. `bytes` through memory and `operations`, a mass and
    pass; `note` says what the pass is."""

    stages: tuple[str, ...]
    bytes: float
    operations: float
    note: str


def merged_pass(stages: Sequence[Stage], item: int, dimensions: int, note: str) -> Pass:
    """One pass that does all `stages`: values are `item` bytes, and what one stage hands the next stays on the way."""
    moved = max(stage.bytes(item, dimensions) for stage in stages)
    operations = sum(stage.operations for stage in stages)
    return Pass(tuple(stage.name for stage in stages), float(moved), float(operations), note)


@dataclass(frozen=True)
class BackendPlan:
    """What a backend makes of a step: on `device`, by `kernel` (its `tile`, where it has one) for the reason `why`.

    Where stages were to be measured: `unmeasured`, why they could not be; `empty`, seconds of a stage that does nothing;
    `step`, of a whole step by `kernel`.
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


def leaves(node: Node | Stage) -> Iterator[Stage]:
    """The stages below a node, or the one that it is."""
    yield from (node,) if isinstance(node, Stage) else node.stages()
