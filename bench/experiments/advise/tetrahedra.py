"""`softlab advise` of tetrahedral bodies: the solver, substeps and iterations that reach a relative error fastest.

A body has no converged reference. The requested error is that of the solver on the scene's own mesh: of the sag at
rest, and of the displacement in half of its slowest vibration. The budgets follow from laws with measured constants
(bench/experiments/advise/tetrahedra_laws.py) and from the frequencies of the scene's own meshes, and are then timed in
turn on the scene itself. Bars that the store has from `softlab tetrahedra` are reported too: the law's error and the
measured one. The error of the mesh is not included.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from math import inf, isfinite, pi, sqrt
from pathlib import Path

import numpy as np

from softlab.bench.experiments.advise.budgets import time_in_turn
from softlab.bench.experiments.advise.tetrahedra_advice import Budget, TetrahedraAdvice
from softlab.bench.experiments.advise.tetrahedra_laws import (
    DAMPING,
    LARGEST,
    LEAST,
    MOST,
    SWING,
    Stiff,
    fewest,
    gravity_lost,
    least_descent,
    least_substep,
)
from softlab.bench.experiments.tetrahedral.bars import Bar, bars
from softlab.bench.experiments.tetrahedral.cantilever import DENSITY, FRAME, LENGTH, POISSON, SECOND, SIDE
from softlab.bench.measure.costs_timing import SECONDS
from softlab.bench.measure.experiment import Summary, backends_here
from softlab.bench.reference.finite_elements import mode_shapes
from softlab.bench.store.database import Store
from softlab.bench.store.marks import is_wrong
from softlab.bench.store.results import measures
from softlab.model.base.errors import SceneError
from softlab.model.core.simulation import PRECISIONS
from softlab.model.scene.checks.tetrahedra import NOT_SMOOTH, unsteady
from softlab.model.scene.scene import Scene

FINDING = "advise tetrahedra"  # value of `finding`
FACTORED = 20_000  # tetrahedra of the largest body whose frequency is computed from its own mesh: a few seconds
RIGID = 1e-4  # fraction of the frequency of waves along a body: slower modes are motions without strain
PER_VOXEL = 5  # tetrahedra per voxel with which the laws were measured
SWEEPS = {1: "one sweep", 2: "two sweeps"}


def advise_tetrahedra(
    store: Store,
    scene: Scene,
    error: float,
    *,
    backends: Sequence[str] | None = None,
    precisions: Sequence[str] = tuple(PRECISIONS),
    command: str = "softlab advise",
) -> TetrahedraAdvice:
    """Find the fastest budget with at most `error`, relative, of the sag at rest and of the displacement in motion.

    Every step is one of the scene's dt.

    Raises SceneError (an error outside the range in which the laws were checked), BackendUnavailable, InputError (the
    store).
    """
    if not LEAST <= error <= LARGEST:
        raise SceneError(
            "--error", error, f"must be a relative error from {LEAST:g} to {LARGEST:g} for tetrahedral bodies"
        )
    if scene.mesh:
        message = (
            "there is no error law for a cloth beside tetrahedral bodies; leave it out to get advice for the bodies"
        )
        raise SceneError(scene.name_of("mesh"), "a cloth", message)
    chosen, summary = backends_here(backends), Summary.begun(store, "advise")
    stiff, basis = bodies(scene)
    budgets, beaten = [], []
    for budget in budgets_by_law(scene, stiff, error):
        if isinstance(budget, tuple):
            beaten.append(budget)
            continue
        for precision in sorted(precisions, reverse=True):
            lost = _lost(scene, budget.solve(scene.method.dt)) if precision == "float32" else 0.0
            if lost > error:
                beaten.append((f"{budget.words}, float32", _loses(scene, budget, lost, error)))
            else:
                budgets += [replace(budget, backend=backend, precision=precision) for backend in chosen]
    timed, failed = _timed(store, summary.start(store, command), scene, budgets) if budgets else ([], [])
    slowest = min(one.frequency for one in stiff)
    return TetrahedraAdvice(
        scene, error, pi / slowest, tuple(sorted(timed, key=lambda budget: budget.seconds)), (*beaten, *failed),
        (basis, *_beside(store, summary.machine)), clock.perf_counter() - summary.begin,
    )  # fmt: skip


def bodies(scene: Scene) -> tuple[list[Stiff], str]:
    """Return (the scene's bodies as input of the laws, a sentence on how their frequencies were computed)."""
    tetrahedra_set = scene.tetrahedra_set
    fixed = np.zeros(tetrahedra_set.particle_count, bool)
    fixed[tetrahedra_set.pinned_vertices] = True
    surface = np.zeros(tetrahedra_set.particle_count, bool)
    surface[tetrahedra_set.surface.ravel()] = True
    ends = [*tetrahedra_set.first_particle[1:], tetrahedra_set.particle_count]
    result, coarser = [], 0
    for number, (part, first, last) in enumerate(
        zip(tetrahedra_set.parts, tetrahedra_set.first_particle, ends, strict=True)
    ):
        members = tetrahedra_set.body == number
        mesh = tetrahedra_set.position[first:last], tetrahedra_set.tetrahedra[members] - first
        inside = tetrahedra_set.fraction[members]
        # 1/s: rate of waves from end to end
        waves = sqrt(part.young_modulus / part.density) / float(np.ptp(mesh[0], axis=0).max())
        frequency = pi * waves
        if members.sum() <= FACTORED:
            some = mode_shapes(
                *mesh, part.young_modulus * inside, part.poisson_ratio, part.density * inside, fixed[first:last], 7
            )[0]
            frequency = 2 * pi * next((f for f in some if f > RIGID * waves), waves / 2)
        else:
            coarser += 1
        edge = float(np.cbrt(PER_VOXEL * tetrahedra_set.whole_volume[members].mean()))
        stiff = Stiff(
            part.young_modulus, part.poisson_ratio, part.density, edge, part.damping, float(frequency),
            bool(surface[first:last].all()),
        )  # fmt: skip
        result.append(stiff)
    basis = "frequencies are computed from the scene's own meshes (lumped masses, inverse iteration)"
    if coarser:
        basis += (
            f"; for {coarser} larger ones they are estimated from waves along the body, which overestimates the effort"
        )
    return result, basis


# ---------------------------------------------------------------------- budgets by the laws


def budgets_by_law(scene: Scene, stiff: Sequence[Stiff], error: float) -> Iterator[Budget | tuple[str, str]]:
    """Yield the budgets that reach the error by the laws, and (words, reason) of those that do not."""
    dt = scene.method.dt
    quick, rows = max(stiff, key=lambda one: one.frequency), None
    wave = f"w = {quick.frequency:.3g} 1/s, the lowest frequency of the stiffest body"

    def damped(substeps: int, order: int = 1) -> float:
        return max(one.damped(dt / substeps, order) for one in stiff)

    steps = fewest(lambda n: damped(n) <= error)
    if steps is None:
        yield "newton", f"needs more than {MOST} substeps per step: the vibration is too fast for the time step"
    else:
        why = f"in motion implicit Euler's damping, {DAMPING:g} pi w h / 4, {wave}"
        yield Budget("newton", steps, 1, 0.0, damped(steps), f"no error at rest; {why}")
        yield _descent(dt, stiff, error, damped)
    yield _second(scene, error, damped, wave)
    others = _outside(scene)
    for sweeps, name in SWEEPS.items():
        if others or (sweeps > 1 and any(part.material == "neo-hookean" for part in scene.tetrahedra.values())):
            yield f"xpbd of {name}", others or "there is no error law for neo-Hookean rows with several sweeps"
            continue

        def excess(substeps: int, sweeps: int = sweeps) -> float:
            return max(one.excess(dt / substeps, sweeps) for one in stiff)

        def within(substeps: int, excess: Callable[[int], float] = excess) -> bool:
            return max(excess(substeps), damped(substeps)) <= error

        rows = fewest(within)
        if rows is None:
            yield f"xpbd of {name}", f"needs more than {MOST} substeps per step"
            continue
        worst = max(stiff, key=lambda one: one.excess(dt / rows, sweeps))
        law = "the excess of rows, as (h^2 E / (rho a^2))" + ("" if sweeps == 1 else "^2 and less")
        basis = f"{law}, here {worst.stiffness(dt / rows):.3g}" + ", more by the damper" * (worst.damping > 0)
        yield Budget("xpbd", rows, sweeps, excess(rows), max(damped(rows), excess(rows)), basis)


def _second(scene: Scene, error: float, damped: Callable[[int, int], float], wave: str) -> Budget | tuple[str, str]:
    """Return the budget of Newton's method of second order, which does not support some parts of a scene."""
    against = unsteady(scene)
    if against:
        return SECOND, f"{', '.join(against)}: {NOT_SMOOTH}"
    steps = fewest(lambda n: damped(n, 2) <= error)
    if steps is None:
        return SECOND, f"needs more than {MOST} substeps per step"
    why = f"no error at rest; in motion {SWING:g} w^2 h^2, {wave}"
    return Budget("newton", steps, 1, 0.0, damped(steps, 2), why, order=2)


def _descent(
    dt: float, stiff: Sequence[Stiff], error: float, damped: Callable[[int], float]
) -> Budget | tuple[str, str]:
    """Return the budget of vertex block descent with the fewest sweeps in total.

    Half of the error is allowed for its damping, half for unfinished sweeps.
    """
    best = least_descent(stiff, dt, error)
    if best is None:
        return "vbd", f"needs more than {MOST} substeps per step"
    substeps, sweeps = best
    why = "no error at rest; in motion its damping, and as much from unfinished sweeps (creep)"
    return Budget("vbd", substeps, sweeps, 0.0, damped(substeps) + error / 2, why)


def _outside(scene: Scene) -> str:
    """Return the reason why the laws of rows do not hold for a scene, or an empty string."""
    cuts = {part.tetrahedra for part in scene.tetrahedra.values()} - {PER_VOXEL}
    if cuts:
        return f"its error law holds for {PER_VOXEL} tetrahedra per voxel, not for {', '.join(map(str, cuts))}"
    return ""


def _place(scene: Scene) -> float:
    """Largest distance [m] of a particle from 0 along gravity."""
    return float(np.abs(scene.tetrahedra_set.position[:, 1]).max())


def _lost(scene: Scene, h: float) -> float:
    pull = scene.gravity.acceleration if scene.gravity is not None and scene.gravity.enabled else 0.0
    return gravity_lost(_place(scene), pull, h)


def _loses(scene: Scene, budget: Budget, lost: float, error: float) -> str:
    h = budget.solve(scene.method.dt)
    assert scene.gravity is not None
    least = least_substep(_place(scene), scene.gravity.acceleration, error)
    return (
        f"may lose {min(lost, 1.0):.0%} of gravity: in a substep of {h:.2g} s a particle moves by less than the resolution "
        f"of float32; substeps longer than {least:.2g} s would do"
    )


# ---------------------------------------------------------------------- times and measured bars


def _timed(
    store: Store, run: str, scene: Scene, budgets: Sequence[Budget]
) -> tuple[list[Budget], list[tuple[str, str]]]:
    """Return (the budgets with the time of a step, (words, reason) of those that cannot be run here)."""
    timed, failed = time_in_turn(store, run, scene, budgets, FINDING, [__file__, str(Path(__file__).parent)])
    wrong = [(one, costs[SECONDS][2] or "") for one, costs in timed if is_wrong(costs[SECONDS][2])]
    able = [replace(b, seconds=costs[SECONDS][0] or inf) for b, costs in timed if not is_wrong(costs[SECONDS][2])]
    return able, [(str(one), reason) for one, reason in (*failed, *wrong)]


def _law_of(bar: Bar) -> float:
    """Return the error of a measured bar at rest by the laws."""
    across = round(sqrt(bar.elements / PER_VOXEL / (LENGTH / SIDE)) ** (2 / 3))
    stiff = Stiff(bar.young, POISSON, DENSITY, SIDE / across, 0.0, 0.0, across == 1)
    return stiff.excess(FRAME / bar.substeps, bar.iterations)


def _beside(store: Store, machine: str) -> Iterator[str]:
    """Yield a sentence on the bars in the store: the one whose error exceeds the law of position-based rows most."""
    rows = [b for b in bars(measures(store, machine=machine)) if b.solver == "xpbd" and b.iterations in SWEEPS]
    compared = [(bar.solver_error, _law_of(bar), bar) for bar in rows if bar.precision == "float64"]
    compared = [one for one in compared if one[1] <= LARGEST and isfinite(one[0])]
    if compared:
        error, law, bar = max(compared, key=lambda one: one[0] / one[1])
        many = "1 bar" if len(compared) == 1 else f"{len(compared)} bars"
        yield (
            f"{many} measured here (softlab tetrahedra) against the law of rows: at most {error / law:.2f} of its error "
            f"({bar.substeps} x {bar.iterations} at {bar.young:.0e} Pa: {error:.2%}, the law {law:.2%})"
        )
    elif any(bar.precision != "float64" for bar in rows):
        yield (
            "the bars measured on this machine are in float32, whose rounding hides the error law; "
            "softlab tetrahedra --quick --precision float64 measures some that show it"
        )
    else:
        yield (
            "no bar was measured on this machine to check the error laws; softlab tetrahedra --quick --precision float64 "
            "measures some"
        )
