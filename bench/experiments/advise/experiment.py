"""`softlab advise`: measure which method, step size, precision and backend reaches an error fastest on this machine.

The error at a step size is nearly the same on every backend and falls by a known power of it, so the full grid is not
run. For each integrator the largest step size that reaches the error is bracketed by its order from one or two coarse
runs; an integrator that already needs many times the forces of the best so far is not even compiled. The search in
float32 and on the other backends begins with the result in float64. Every answer was reached by the very configuration
that it names; these are then timed in turn. Step sizes above the stability limit are not advised. Everything is stored
as soon as it is measured, so that a repeated request costs little.
"""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from dataclasses import replace
from math import inf

from softlab.bench.experiments.accuracy.judgement import RESOLVED
from softlab.bench.experiments.accuracy.methods import METHODS, XPBD, newton, order_of, position_based, sweeps
from softlab.bench.experiments.accuracy.points import END
from softlab.bench.experiments.accuracy.references import (
    by_numpy,
    converged_of,
    growth_of,
    lab_seconds,
    numpy_seconds,
    references,
)
from softlab.bench.experiments.advise.advice import Advice
from softlab.bench.experiments.advise.search import Kind, Search, Task, disturbed
from softlab.bench.experiments.growth import MAX_GROWTH, Growth
from softlab.bench.measure.experiment import Summary, backends_here
from softlab.bench.measure.progress import progress_bar
from softlab.bench.reference import cache
from softlab.bench.store.database import Store
from softlab.model.base.errors import SceneError
from softlab.model.core.build import pinned_indices
from softlab.model.core.simulation import PRECISIONS
from softlab.model.scene.scene import Scene

REFERENCE_SECONDS = 60.0  # longest estimated time of a reference
TOTAL_SECONDS = 180.0
ADVISED = tuple(name for name in METHODS if name not in XPBD[1:])  # only the ordering that converges fastest
ITERATIONS = (1, 4)  # numbers of iterations that are tried with a position-based method


def advise(
    store: Store,
    scene: Scene,
    error: float,
    *,
    backends: Sequence[str] | None = None,
    time: float | None = None,
    integrators: Sequence[str] = ADVISED,
    precisions: Sequence[str] = tuple(PRECISIONS),
    total_seconds: float = TOTAL_SECONDS,
    progress: bool = True,
    command: str = "softlab advise",
) -> Advice:
    """Find the fastest configuration with at most `error` at `time` [s] (None: 1.5).

    `error` [spacings]: RMS over the free masses. `integrators`: names of bench.experiments.accuracy.methods.METHODS.
    `backends`: None for all that are available. `total_seconds`: no new search begins after it; the results so far are
    returned.

    Raises SceneError (an impossible error or time, a scene with a random force, no moving mass, a reference that would
    take too long, constraints without a force law), BackendUnavailable, InputError (the store). A chaotic motion, and
    an error that nothing reaches, are answers with a reason in `why`.
    """
    begin = clock.perf_counter()
    end = END if time is None else time
    _check(scene, error, end, total_seconds)
    chosen, summary = backends_here(backends), Summary.begun(store, "advise")
    with progress_bar(progress) as bar:
        row = bar.add_task("growth of a perturbation", total=None)
        motion = newton(scene)
        growth = growth_of(motion, end, references(store))
        advice = Advice(scene, error, end, growth.factor, machine=summary.machine)
        if growth.chaotic:
            return replace(advice, why=_chaos(growth), seconds=clock.perf_counter() - begin)
        bar.update(row, description="converged reference")
        right = converged_of(motion, end, references(store))
        if not right.estimate * RESOLVED <= error * scene.grid.spacing:
            off = right.estimate / scene.grid.spacing
            why = f"the reference itself is only accurate to {off:.1e} spacings; ask for a larger --error"
            return replace(advice, why=why, seconds=clock.perf_counter() - begin)
        run, deadline = summary.start(store, command), begin + total_seconds
        search = Search(store, Task(scene, error, end, growth, right, summary.machine, run, deadline))
        kinds = [
            Kind(name, precision, backend, iterations)
            for name in sorted(integrators, key=lambda name: (-order_of(name), position_based(name), sweeps(name)))
            for iterations in iterations_of(name)
            for backend in chosen
            for precision in sorted(precisions, reverse=True)  # float64 first: its errors fall by the order
        ]
        bar.update(row, total=len(kinds) + 1)
        for kind in kinds:
            bar.update(row, description=str(kind))
            search.find(kind)
            bar.advance(row)
        bar.update(row, description=f"timing {len(search.reached)} side by side")
        choices = search.timed()
    notes = [*search.notes(), *disturbed(choices)]
    if not by_numpy(motion, end):
        notes.append("the reference was computed by the lab's own rk4 in float64, since NumPy would have taken minutes")
    return replace(
        advice, choices=tuple(choices), beaten=tuple(search.beaten), why=None if choices else search.failure(),
        notes=tuple(notes), seconds=clock.perf_counter() - begin,
    )  # fmt: skip


def iterations_of(name: str) -> tuple[int | None, ...]:
    """Return the numbers of iterations with which a method is tried; (None,) for an integrator."""
    return ITERATIONS if position_based(name) else (None,)


def _check(scene: Scene, error: float, end: float, total_seconds: float) -> None:
    """Refuse requests without an answer before anything is measured."""
    for name, value in (("--time", end), ("--total-seconds", total_seconds)):
        if not 0 < value < inf:
            raise SceneError(name, value, "must be a finite number of seconds greater than 0")
    least = RESOLVED * cache.TOLERANCE
    if not least <= error < inf:
        raise SceneError(
            "--error", error, f"must be a finite number of spacings, at least {least:g}, the accuracy of the references"
        )
    motion = newton(scene)
    if scene.external and scene.external.magnitude > 0:
        raise SceneError(
            "external.magnitude",
            scene.external.magnitude,
            "a random force differs at every step size, so there is no reference; pass --set external.magnitude=0",
        )
    if len(set(pinned_indices(scene.grid).tolist())) == scene.grid.particle_count:
        raise SceneError(
            "grid.pinned", scene.grid.pinned, "every mass is pinned, so nothing moves; leave some masses free"
        )
    needed = min(numpy_seconds(motion, end), lab_seconds(motion, end))
    if needed > REFERENCE_SECONDS:
        fits = end * REFERENCE_SECONDS / needed
        raise SceneError(
            "--time",
            end,
            f"the reference would take about {needed:.0f} s to compute; use at most {fits:.1g}, or a smaller grid",
        )


def _chaos(growth: Growth) -> str:
    text = (
        f"the motion is chaotic: until {growth.times[-1]:g} s a perturbation grows {growth.factor:.1e} times (more than "
        f"{MAX_GROWTH:g}), so no method has a meaningful error"
    )
    safe = growth.safe_time()
    return (
        f"{text}; up to {safe:.2g} s they have one: pass --time {safe:.2g}"
        if safe
        else f"{text}; ask for a shorter --time"
    )
