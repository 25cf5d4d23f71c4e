"""`softlab advise` of fluids: the scheme, substeps and iterations that keep the density of a scene fastest.

A fluid's motion has no converged reference. The requested error is one of density: the mean of the relative excess over
the rest density, in the last `CHECKED_STEPS` steps before a time. Every scheme is run on the scene itself with rising effort
until it reaches the error, or until a step takes several times as long as that of the best so far. Those that reach it
are then timed in turn. Other results of the store on fluids (`softlab fluids --truth`: fronts, spacings) are reported
as notes.
"""

from __future__ import annotations

import time as clock
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite

import numpy as np

from softlab.app.driver import open_simulation
from softlab.bench.experiments.advise.budgets import time_in_turn
from softlab.bench.experiments.advise.fluids_advice import FluidAdvice, FluidBudget
from softlab.bench.experiments.fluid_truth import laws
from softlab.bench.experiments.fluid_truth.rows import Judged, rows
from softlab.bench.experiments.fluid_truth.scenes import DAM, SCHEMES, WIDTH
from softlab.bench.measure.costs_timing import SECONDS
from softlab.bench.measure.experiment import Summary, backends_here, described, store_measures
from softlab.bench.measure.items import cost_sources
from softlab.bench.measure.progress import progress_bar
from softlab.bench.measure.timing import incomplete
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.model.base.errors import Diverged, SceneError
from softlab.model.core.simulation import PRECISIONS
from softlab.model.fluid.family import comes_to_rest, springs_back
from softlab.model.fluid.measure import compression
from softlab.model.scene.scene import Scene

FINDING, DENSITY = "advise fluids", "advise_density"  # value of `finding`; name of the measure
LADDER = ((1, 2), (1, 4), (2, 3), (2, 6), (4, 5), (4, 10), (8, 5), (8, 10), (16, 10), (32, 10))  # substeps, iterations
UNTIL = 1.0  # s, default of the end time
CHECKED_STEPS = 10
LEAST, LARGEST = 1e-5, 0.2  # range of errors that can be requested
SLOWER = 4.0  # times the best: a scheme that takes longer is not tried with more effort
FRONT = 0.05  # error of the front of a dam below which a row of the store is reported


@dataclass
class _Search:
    """Search with `end` [s] and `error` as requested; `deadline`: in time.perf_counter."""

    scene: Scene
    error: float
    end: float
    deadline: float

    def climb(self, budget: FluidBudget, best: float) -> Iterator[FluidBudget]:
        """Yield the runs of a scheme, up to the first that reaches the error.

        Efforts at which water does not come to rest, or springs back from colliders, are left out.
        """
        for substeps, iterations in LADDER:
            wanted = replace(budget, substeps=substeps, iterations=iterations)
            scene = self.scene.replace(wanted.changes)
            if springs_back(scene) or not comes_to_rest(scene):
                continue
            one = self.run(wanted)
            yield one
            if one.density <= self.error or one.seconds > SLOWER * best or clock.perf_counter() > self.deadline:
                return

    def run(self, budget: FluidBudget) -> FluidBudget:
        """Return the budget with its density error and the time of a step, measured until `end`."""
        scene = self.scene.replace(budget.changes)
        steps = max(CHECKED_STEPS, round(self.end / scene.method.dt))
        with open_simulation(scene, budget.backend, precision=budget.precision) as simulation:
            simulation.advance(1)  # compiles the kernels
            simulation.reset()
            simulation.synchronize()
            begin = clock.perf_counter()
            try:
                simulation.advance(steps - CHECKED_STEPS)
                simulation.check()
                simulation.synchronize()
                seconds = (clock.perf_counter() - begin) / max(1, steps - CHECKED_STEPS)
                densities = []
                for _ in range(CHECKED_STEPS):
                    simulation.advance(1)
                    densities.append(compression(scene, simulation.read("position"))[0])
            except Diverged:
                return replace(budget, density=inf, seconds=inf)
            if incomplete(simulation):
                return replace(budget, density=inf, seconds=inf)
        return replace(budget, density=float(np.mean(densities)), seconds=seconds)


def end_of(scene: Scene, time: float | None) -> float:
    """Return the end time [s] (None: UNTIL). Raises SceneError if it is not finite, or shorter than a step."""
    end, dt = UNTIL if time is None else time, scene.method.dt
    if not (isfinite(end) and end >= dt):
        raise SceneError("--time", end, f"must be a finite number of seconds, at least one step of {dt:g} s")
    return end


def advise_fluids(
    store: Store,
    scene: Scene,
    error: float,
    *,
    time: float | None = None,
    total_seconds: float = 180.0,
    backends: Sequence[str] | None = None,
    precisions: Sequence[str] = tuple(PRECISIONS),
    progress: bool = True,
    command: str = "softlab advise",
) -> FluidAdvice:
    """Find the fastest budget at the scene's dt with a mean density error of at most `error` at `time` [s] (None: 1).

    Raises SceneError (an impossible error or time), BackendUnavailable, InputError (the store).
    """
    end = end_of(scene, time)
    if not LEAST <= error <= LARGEST:
        raise SceneError("--error", error, f"must be a relative density error from {LEAST:g} to {LARGEST:g}")
    chosen = backends_here(backends)
    precision = "float32" if "float32" in precisions else "float64"
    summary = Summary.begun(store, "advise")
    search = _Search(scene, error, end, summary.begin + total_seconds)
    tried: list[FluidBudget] = []
    with progress_bar(progress) as bar:
        row = bar.add_task("schemes", total=len(chosen) * len(SCHEMES) * len(LADDER))
        for number, (backend, scheme) in enumerate((b, s) for b in chosen for s in SCHEMES):
            best = min((one.seconds for one in tried if one.density <= error), default=inf)
            for one in search.climb(FluidBudget(scheme, 1, 1, backend, precision), best):
                tried.append(one)
                bar.update(row, description=str(one), advance=1)
            bar.update(row, completed=(number + 1) * len(LADDER))
    able = [one for one in tried if one.density <= error]
    run = summary.start(store, command)
    _store_errors(store, run, scene, tried)
    timed = sorted(_timed(store, run, scene, able), key=lambda one: one.seconds)
    beaten = [_nearest(tried, backend, scheme, error) for backend in chosen for scheme in SCHEMES]
    return FluidAdvice(
        scene, error, end, tuple(timed), tuple(filter(None, beaten)), tuple(_beside(store, summary.machine, scene)),
        clock.perf_counter() - summary.begin,
    )  # fmt: skip


def _store_errors(store: Store, run: str, scene: Scene, tried: Sequence[FluidBudget]) -> None:
    """Store the density errors of the budgets that were tried."""
    for one in tried:
        description = described(scene.replace(one.changes), one.backend, FINDING, precision=one.precision)
        value = one.density if isfinite(one.density) else None
        density = value, "", None if value is not None else "diverged"
        store_measures(store, run, description, cost_sources(one.backend, [__file__]), {DENSITY: density})


def _nearest(tried: Sequence[FluidBudget], backend: str, scheme: str, error: float) -> tuple[str, str] | None:
    """Return (words, reason) of a scheme that did not reach the error, else None."""
    of_scheme = [one for one in tried if (one.backend, one.scheme) == (backend, scheme)]
    if not of_scheme or min(one.density for one in of_scheme) <= error:
        return None
    nearest = min(of_scheme, key=lambda one: one.density)
    message = (
        f"reaches {nearest.density:.2g} with {nearest.effort} (substeps x iterations)"
        if isfinite(nearest.density)
        else "diverges"
    )
    return f"{scheme}, {backend}", f"{message}; more were not tried because they take too long"


def _timed(store: Store, run: str, scene: Scene, able: Sequence[FluidBudget]) -> list[FluidBudget]:
    """Return the budgets that reach the error with the time of a step from the scene's start, sampled in turn."""
    timed, failed = time_in_turn(store, run, scene, able, FINDING, [__file__])
    # those that failed now ran before; that time stays
    return [replace(one, seconds=costs[SECONDS][0] or one.seconds) for one, costs in timed] + [one for one, _ in failed]


def _beside(store: Store, machine: str, scene: Scene) -> Iterator[str]:
    """Yield sentences on the dam breaks of the store: spacing and error of the front."""
    dams = [row for row in rows(measures(store, machine=machine)) if row.kind == DAM and row.frame and not row.peer]
    if not dams:
        yield "no dam break was measured on this machine; softlab fluids --truth measures its front"
        return
    for name, what in ((laws.FRONT, "all points"), (laws.FRONT_LATER, "all but the first")):
        able = [row for row in dams if name in row.numbers and row.numbers[name] <= FRONT]
        if able:
            best = min(able, key=lambda row: row.frame or inf)
            yield f"the front of a dam break within {FRONT:.0%} at {what}, fastest here: {_dam_words(best, name)}"
        else:
            nearest = min((row for row in dams if name in row.numbers), key=lambda row: row.numbers[name])
            yield f"no dam break measured here is within {FRONT:.0%} at {what}; nearest: {_dam_words(nearest, name)}"


def _dam_words(row: Judged, name: str) -> str:
    return (
        f"{row.who}, {row.effort} per step of 2 ms, {WIDTH / row.spacing:.0f} particles along its width, "
        f"{row.numbers[name]:.1%}, {1e3 * (row.frame or 0):.3g} ms per 1/60 s"
    )
