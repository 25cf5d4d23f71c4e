"""Passes of a fluid's substep: their names, how their order is declared, and the order in which kernels do them.

model/fluid/plan.py and model/fluid/divergence_plan.py declare the passes. A backend says what runs each of them, and
which runs of consecutive passes one fused kernel does.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from softlab.model.core.plan import Node, Stage

EMIT, PREDICT, SAMPLE, GATHER, SORT = "emit", "predict", "sample solids", "gather", "sort into cells"
FIND, FOLLOW, DENSITY, CORRECT, PUSH = "find neighbours", "follow solids", "density", "correct", "push solids"
UPDATE, SHAPE, LIMIT = "update velocity", "normals and vorticity", "limit velocities"
SURVEY, RELAX, PUSH_APART, TAKE_UP = "density and divergence", "relax", "push apart", "take up"
ACCELERATE, FORESEE, MOVE = "accelerate", "foresee density", "move"
SHAPES = frozenset({"surface-tension", "vorticity"})  # parts of the plan that need normals and vorticity
SMOOTHING = SHAPES | {"viscosity", "cohesion"}


class Scalars(NamedTuple):
    """Scalars per particle and axis that a pass moves: of the particle, of each of its neighbours, and, if `lists` is 1,
    its list of neighbours."""

    particle: int
    neighbours: int = 0
    lists: int = 0


def around(vectors: int, particle: int = 1) -> Scalars:
    """Return what a sum over neighbours reads, for `vectors` vectors of each."""
    return Scalars(particle, vectors, 1)


class Pass(NamedTuple):
    """A pass over all particles. `operations`: floating-point operations per particle, by what they are counted per.

    A pass runs if the plan has one of the parts `needs`, if there are any, and none of the parts `without`.
    """

    name: str
    reads: Scalars = Scalars(0)
    writes: Scalars = Scalars(0)
    operations: Mapping[str, int] = {}
    needs: frozenset[str] = frozenset()
    without: frozenset[str] = frozenset()


class Iterations(NamedTuple):
    """Passes that run once per iteration; `argument`: of their stages."""

    passes: tuple[Pass, ...]
    argument: float = 0.0


Substep = Sequence[Pass | Iterations]


def chosen(substep: Substep, parts: frozenset[str]) -> tuple[Pass | Iterations, ...]:
    """Return the passes of a substep that a plan with these parts has."""

    def runs(one: Pass) -> bool:
        return not parts & one.without and bool(not one.needs or parts & one.needs)

    return tuple(
        node._replace(passes=tuple(filter(runs, node.passes))) if isinstance(node, Iterations) else node
        for node in substep
        if isinstance(node, Iterations) or runs(node)
    )


def stages_of(substep: Substep, iterations: int, counts: Mapping[str, float]) -> tuple[Stage | Node, ...]:
    """Return the stages of a plan; `counts`: how often an operation is done that is counted per particle, neighbour, ..."""

    def scalars(moved: Scalars) -> int:
        gathered, listed = round(counts["neighbour"]), round(counts["neighbour"] / counts["axis"])
        return (
            moved.particle + moved.neighbours * gathered + moved.lists * listed
        )  # an entry has four bytes, like a scalar

    def stage(one: Pass, argument: float = 0.0) -> Stage:
        operations = sum(round(counts[per] * number) for per, number in one.operations.items())
        return Stage(one.name, scalars(one.reads), scalars(one.writes), operations, argument)

    return tuple(
        Node("iteration", tuple(stage(one, node.argument) for one in node.passes), iterations)
        if isinstance(node, Iterations)
        else stage(node)
        for node in substep
    )


class Run(NamedTuple):
    """Consecutive passes, by name, that one kernel does; iteration and argument of the first."""

    passes: tuple[str, ...]
    iteration: int = 0
    argument: float = 0.0


def runs_of(substep: Substep, iterations: int, fused: Iterable[tuple[str, ...]] = ()) -> list[Run]:
    """Return what runs in a substep, in order, where kernels do the runs of passes `fused` at once."""
    single = [
        Run((one.name,), iteration, node.argument if isinstance(node, Iterations) else 0.0)
        for node in substep
        for iteration in range(iterations if isinstance(node, Iterations) else 1)
        for one in (node.passes if isinstance(node, Iterations) else (node,))
    ]
    names, runs, longest = [run.passes[0] for run in single], list[Run](), sorted(fused, key=len, reverse=True)
    while names:
        passes = next((run for run in longest if tuple(names[: len(run)]) == run), (names[0],))
        runs.append(single[-len(names)]._replace(passes=passes))
        del names[: len(passes)]
    return runs


def three_parts(substep: Substep) -> tuple[Substep, Substep, Substep]:
    """Return the passes before, in and after the iterations of a substep that iterates once."""
    (place,) = (n for n, node in enumerate(substep) if isinstance(node, Iterations))
    iterated = substep[place]
    assert isinstance(iterated, Iterations)
    return substep[:place], iterated.passes, substep[place + 1 :]
