"""Cost of the results of `softlab bar`: the time of a frame of 1/60 s of the hanging bar (the jelly bar stands).

Every method and number of substeps whose results were measured is timed, sampled in turn, in float64 and exact math
like the results: the same machine code. Mass-spring uses steps for substeps, and is left out where its step is refused.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial

from softlab.app.driver import open_simulation
from softlab.bench.experiments.bar import (
    LAW_SUBSTEPS,
    SOLVERS,
    SOME_LAYERS,
    SOME_LINKS,
    SOME_OVERLAP,
    SOME_VOXELS,
    SUBSTEPS,
    TETRAHEDRA,
)
from softlab.bench.experiments.bar_body import bar, tetrahedra
from softlab.bench.experiments.bar_rows import JELLY, Bar, is_bar, rows
from softlab.bench.experiments.bar_strip import FRAME, FREQUENCY, OPTIONS, SAG, method_of, strip
from softlab.bench.measure import costs_timing
from softlab.bench.measure.costs_timing import RATIO, SECONDS, Effort, Measures, Record, in_turn
from softlab.bench.measure.experiment import described
from softlab.bench.measure.items import Group, Items, cost_sources
from softlab.bench.measure.timing import Subject, prepare
from softlab.bench.store.database import Store
from softlab.bench.store.results import Measure, results_of
from softlab.bench.store.schema import Description
from softlab.model.base.errors import SoftlabError
from softlab.model.scene.scene import Scene

COST = "bar: cost"  # value of `finding`
CLOSE = 0.1  # relative error of sag and frequency below which a method reproduces the rod


def settings(quick: bool = False) -> Iterator[tuple[str, int, Scene]]:
    """Yield (name of a method, substeps, the bar that hangs or stands) of everything that is timed."""
    for substeps in LAW_SUBSTEPS if quick else SUBSTEPS:
        for name, (solver, iterations) in SOLVERS.items():
            yield name, substeps, strip(SOME_LINKS, method_of(solver, substeps, iterations))
        yield JELLY, substeps, bar(SOME_LAYERS, SOME_OVERLAP, substeps, True)
        for name, (solver, iterations) in TETRAHEDRA.items():
            yield name, substeps, tetrahedra(SOME_VOXELS, solver, iterations, substeps, SAG)


def groups(store: Store, backends: Sequence[str], quick: bool) -> list[Group]:
    """Return one group per backend, with all methods in turn."""
    all_groups = []
    for backend in backends:
        settled = list(settings(quick))
        descriptions = tuple(
            described(scene, backend, COST, solver=name, substeps=substeps, **OPTIONS)
            for name, substeps, scene in settled
        )
        effort = costs_timing.QUICK if quick else costs_timing.FULL
        scenes = [scene for _, _, scene in settled]
        run = partial(_timed, scenes, descriptions, effort)
        all_groups.append(Group(f"costs, {backend}", descriptions, cost_sources(backend, [__file__]), run, 10))
    return all_groups


def _timed(
    scenes: Sequence[Scene], descriptions: Sequence[Description], effort: Effort, record: Record
) -> list[Measures]:
    results: list[Measures] = [{} for _ in descriptions]
    with ExitStack() as stack:
        subjects: list[tuple[int, Subject]] = []
        for number, (scene, one) in enumerate(zip(scenes, descriptions, strict=True)):
            try:
                simulation = stack.enter_context(open_simulation(scene, one["backend"], **OPTIONS))
                subjects.append((number, prepare(Subject(simulation, one), effort.seconds, effort.most)))
            except SoftlabError as reason:  # a refused step, a solver that the backend lacks, a run that diverged
                results[number] = {name: (None, "", str(reason)) for name in (SECONDS, RATIO)}
        timed = in_turn(record, [subject for _, subject in subjects], effort.repeats) if subjects else []
    for (number, _), numbers in zip(subjects, timed, strict=True):
        results[number] = numbers
    return results


# ---------------------------------------------------------------------- results from the store


@dataclass(frozen=True)
class Cost:
    """A method with that many substeps: the time of a `frame` [s], and whether it is `suspect`. `sag`, `frequency`:
    relative differences from a rod's, None if not measured.
    """

    backend: str
    solver: str
    substeps: int
    frame: float
    suspect: bool
    sag: float | None
    frequency: float | None

    @property
    def close(self) -> bool:
        """True if sag and frequency differ from the rod's by at most CLOSE."""
        return None not in (self.sag, self.frequency) and max(abs(self.sag or 0), abs(self.frequency or 0)) <= CLOSE


def costs(stored: Iterable[Measure]) -> list[Cost]:
    """Return the costs from the measures, with the errors of either backend, which exact math makes equal."""
    everything = list(stored)
    answers: dict[tuple[str, int], Bar] = {}
    some = {JELLY: (SOME_LAYERS, SOME_OVERLAP), **dict.fromkeys(TETRAHEDRA, (SOME_VOXELS, 1.0))}
    for bar_row in rows(measure for measure in everything if is_bar(measure)):
        if not bar_row.law and (bar_row.fine, bar_row.size) == some.get(bar_row.solver, (SOME_LINKS, 1.0)):
            answers.setdefault((bar_row.solver, bar_row.substeps), bar_row)
    result = []
    for one in results_of(everything, COST):
        if (seconds := one.values.get(SECONDS)) is None:
            continue
        fields = one.description
        steps = round(FRAME / one.tables["method"]["dt"])
        budget = fields["solver"], fields["substeps"]
        row = answers.get(budget)
        off = [None if row is None or (part := row.part(name)) is None else part - 1 for name in (SAG, FREQUENCY)]
        result.append(Cost(fields["backend"], *budget, steps * seconds, one.is_suspect(SECONDS), *off))
    return sorted(result, key=lambda c: (c.backend, c.solver, c.substeps))


def _percent(error: float | None) -> str:
    return "-" if error is None else f"{100 * error:+.3g}"


class BarCosts(Items):
    """Measure the time of the methods of the bar."""

    name, command = "bar: costs", "bar"
    in_lab = True
    items = staticmethod(groups)
    table = {
        "solver": "solver", "on": "backend", "substeps": lambda cost: str(cost.substeps),
        "frame / ms": lambda cost: f"{1e3 * cost.frame:.3g}{'?' * cost.suspect}",
        "sag, % off": lambda cost: _percent(cost.sag), "frequency, % off": lambda cost: _percent(cost.frequency),
    }  # fmt: skip
    note = "time of the bar, and its difference from a rod; ?: suspect"

    def rows(self, stored: Iterable[Measure], every: bool = False) -> list[Cost]:
        return costs(stored)
