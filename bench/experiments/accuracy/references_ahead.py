"""References of accuracy runs on several processes, before the first case is measured.

One after another they take longer than all the rest: the scheme with converged iterations needs thousands of iterations
at large steps (bench/experiments/accuracy/solver_error.py).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path

from softlab.bench.experiments.accuracy.cases import Case
from softlab.bench.experiments.accuracy.points import AT_REST, end_of
from softlab.bench.experiments.accuracy.references import converged_for, growth_for, half_for, motion_of
from softlab.bench.experiments.accuracy.solver_error import Iterated
from softlab.bench.measure.processes import run_in_processes
from softlab.cpu_backend.core.threads import core_count
from softlab.model.core.build import build

FEWEST = 16  # tasks: fewer are done before the processes have started

Task = Callable[[], object]


def references_ahead(folder: Path | None, cases: Iterable[Case], progress: bool) -> int:
    """Store the references of the cases in `folder`; return the number of tasks that processes have done: 0 where that
    would not pay (no folder, one core, few tasks)."""
    tasks = tasks_of(cases, folder) if folder else {}
    if len(tasks) < FEWEST or core_count() < 2:
        return 0
    return len(run_in_processes(tasks, core_count(), progress, "references"))


def tasks_of(cases: Iterable[Case], folder: Path) -> dict[str, Task]:
    """Return the tasks that store all references of the cases, by name; no two of them make the same."""
    tasks: dict[str, Task] = {}
    iterated: dict[str, list[Case]] = {}
    for case in cases:
        of_motion = case.label, motion_of(case.scene), end_of(case.label), folder
        for make in (converged_for, half_for, growth_for):
            tasks.setdefault(f"{case.label} {make.__name__}", partial(make, *of_motion))
        method = case.scene.method
        if method.position_based and case.label not in AT_REST:
            odd = method.iterations // (method.iterations & -method.iterations)  # doubling keeps the odd factor
            iterated.setdefault(f"{case.label} {method.name} {method.dt:g} {odd}", []).append(case)
    return tasks | {name: partial(iterate, same, folder) for name, same in iterated.items()}


def iterate(cases: Sequence[Case], folder: Path) -> None:
    """Store the end states with converged iterations of cases that differ in their iterations, precision and backend only."""
    iterated = Iterated(folder)
    for case in {case.scene.method.iterations: case for case in cases}.values():
        iterated.converged(case.scene, case.steps, build(case.scene).inverse_mass > 0)
