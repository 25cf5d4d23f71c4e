"""`softlab tetrahedra`: a bar of tetrahedra under its own weight; the error of its solver and that of its mesh.

The cantilever of 1 m x 0.1 m x 0.1 m, with `across` voxels along a side of its section, is released at the exact rest
state of that mesh (bench/reference/finite_elements_newton.py) and braked until its tip stands still. SOLVER_ERROR is
its sag then over the exact one, minus 1: 0 for a solver that converged, whatever the mesh. MESH_ERROR is the exact sag
over that of the continuum, minus 1: linear tetrahedra are too stiff (S. Timoshenko, "On the correction for shear",
Phil. Mag. 41 (1921)). Gravity grows with Young's modulus, so that all bars should sag by the same amount.

A solver that begins each step where the last one ended stands still at rest whatever its budget, and unfinished
iterations slow its motion. So the bar is also released from its unloaded shape, without a brake: MOTION_ERROR compares
the displacement of its tip after half of its first period, where it should be about twice the sag, with that by the
modes of the same mesh (lumped masses). It includes the error of the time steps. A frame of 1/60 s is timed in that
motion, all settings in turn.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from itertools import product
from math import ceil, inf, pi

import numpy as np

from softlab.app.driver import open_simulation
from softlab.bench.experiments.advise.tetrahedra_laws import Stiff
from softlab.bench.experiments.tetrahedral.cantilever import (
    BLOCKS,
    DENSITY,
    FRAME,
    POISSON,
    SECOND,
    SIDE,
    bending_frequency,
    cantilever,
    continuum_sag,
    exact_drop,
    exact_rest,
    lacking,
    sag,
    setting_of,
)
from softlab.bench.experiments.tetrahedral.promised import promised
from softlab.bench.measure.costs_timing import FULL, QUICK, RATIO, SECONDS, Effort, Measures, Record, in_turn
from softlab.bench.measure.experiment import described, store_measures
from softlab.bench.measure.items import Group, cost_sources
from softlab.bench.measure.timing import Subject, prepare
from softlab.bench.store.database import Store
from softlab.bench.store.schema import Description
from softlab.model.base.errors import SoftlabError, UnstableTimeStep
from softlab.model.core.build import build
from softlab.model.core.simulation import PRECISIONS, Simulation, State
from softlab.model.scene.checks.tetrahedra import SOLVERS_OF_TETRAHEDRA
from softlab.model.scene.scene import Scene

TETRAHEDRA = "tetrahedra"  # value of `finding`
SAG, SOLVER_ERROR, MESH_ERROR = "tetrahedra_sag", "tetrahedra_solver_error", "tetrahedra_mesh_error"
MOTION_ERROR, ELEMENTS = "tetrahedra_motion_error", "tetrahedra_count"
MODULI = (1e5, 1e6, 1e7)  # Pa
SECTIONS = (1, 2, 4, 8)  # voxels per side of the section: 50, 400, 3200, 25 600 tetrahedra
LONGEST = (
    # s, of a bar's run to rest and of its half vibration; settings that would take longer are reported and skipped
    30.0
)
SETTINGS = {  # solver -> (substeps, iterations) per frame
    "xpbd": ((4, 1), (16, 1), (30, 1), (1, 30), (4, 8), (64, 1), (128, 1), (256, 1), (512, 1), (32, 2)),
    BLOCKS: ((4, 1), (16, 1), (30, 1), (64, 1), (128, 1), (4, 8), (16, 8), (32, 2)),
    "vbd": ((1, 10), (1, 30), (1, 100), (4, 30), (16, 10)),
    "newton": ((1, 1), (1, 2), (1, 4), (4, 1)),
    SECOND: ((1, 1), (1, 2), (2, 1), (4, 1)),
}
QUICK_SETTINGS = {
    "xpbd": ((4, 1), (30, 1), (128, 1)),
    BLOCKS: ((30, 1), (16, 8)),
    "vbd": ((1, 30),),
    "newton": ((1, 1),),
    SECOND: ((1, 1),),
}
STIFFER = 1.25  # frequency of a bar of two voxels across over the continuum's; finer bars have less
FREE = 1e-9  # factor of the brake: practically none, with the same machine code
TO_REST = 22  # tenths of a period after which a critical brake leaves STILL
STILL, FRAMES = 1e-5, 1200  # relative change of the sag in a tenth of a period; largest number of frames


class TooLong(Exception):
    """The run would take too many seconds."""

    def __init__(self, seconds: float, most: float):
        super().__init__(f"would take {seconds:.0f} s, over {most:g} s")


def settle(simulation: Simulation, across: int, young: float, most: float = inf) -> float:
    """Release at the exact rest state, step until the tip stands still, and return its sag [m].

    Raises Diverged, and TooLong for more than `most` [s].
    """
    scene, rest = simulation.scene, exact_rest(across)
    simulation.load(State(rest, np.zeros_like(rest), build(scene).inverse_mass, 0.0, 0))
    part = max(1, round(0.1 / bending_frequency(young) / FRAME))
    last, begin = sag(scene, rest), clock.perf_counter()
    for done in range(1, 1 + ceil(FRAMES / part)):
        simulation.advance(part)
        now = sag(scene, simulation.state().position)
        needed = (clock.perf_counter() - begin) * max(1.0, TO_REST / done)
        if needed > most:
            raise TooLong(needed, most)
        if abs(now - last) < STILL * abs(now):
            return now
        last = now
    return last


def drop(simulation: Simulation, across: int, young: float, most: float = inf) -> float:
    """Return the displacement [m] of the tip after half a period from the unloaded shape.

    Raises Diverged, and TooLong for more than `most` [s], without the first frame, which may compile.
    """
    frames, begin = exact_drop(across, young)[0], 0.0
    for done in range(frames):
        simulation.advance(1)
        simulation.synchronize()
        begin = clock.perf_counter() if done == 0 else begin
        needed = (clock.perf_counter() - begin) * frames / max(done, 1)
        if needed > most:
            raise TooLong(needed, most)
    return sag(simulation.scene, simulation.state().position)


def settings(
    quick: bool, across: int = SECTIONS[1], young: float | None = None, solvers: Sequence[str] = ()
) -> list[tuple[str, int, int]]:
    """Return (solver, substeps, iterations) of a bar, of `solvers` or of all.

    Fine meshes, which take minutes to settle, have few. With a Young's modulus `young` [Pa], unless `quick`, the
    settings that should be fastest within an error of 1 % by the laws are added.
    """
    chosen = QUICK_SETTINGS if quick or across > SECTIONS[1] else SETTINGS
    there = [solver for solver in SETTINGS if solver.split()[0] in SOLVERS_OF_TETRAHEDRA]
    there = [solver for solver in there if not solvers or solver in solvers]
    budgets = [(solver, *both) for solver in there for both in chosen[solver]]
    if young is not None and not quick:
        frequency = STIFFER * 2 * pi * bending_frequency(young)
        stiff = Stiff(young, POISSON, DENSITY, SIDE / across, 0.0, frequency, across == SECTIONS[0])
        budgets += [one for one in promised(stiff, FRAME) if one[0] in there]
    return list(dict.fromkeys(budgets))


def groups(
    store: Store,
    backends: Sequence[str],
    quick: bool,
    precisions: Sequence[str] = tuple(PRECISIONS),
    across: Sequence[int] = SECTIONS,
    young: Sequence[float] = MODULI,
    solvers: Sequence[str] = (),
) -> list[Group]:
    """Return the groups timed in turn: all settings of one bar.

    `quick`: few settings, fewer and shorter samples; `solvers`: only these of SETTINGS.
    """
    effort = QUICK if quick else FULL
    scenes_by_bar = {
        (a, e): tuple(cantilever(a, e, *setting) for setting in settings(quick, a, e, solvers))
        for a in across
        for e in young
    }
    all_groups = []
    for backend in backends:
        sources = cost_sources(backend, [__file__])
        for precision, ((a, e), scenes) in product(precisions, scenes_by_bar.items()):
            descriptions = tuple(described(scene, backend, TETRAHEDRA, precision=precision) for scene in scenes)
            name = f"{a} across, {e:.0e} Pa, {precision}, {backend}"
            run = partial(_bar, a, e, scenes, descriptions, effort)
            all_groups.append(Group(name, descriptions, sources, run, len(scenes)))
    return all_groups


def let_go(scene: Scene) -> Scene:
    """Return the scene without a brake."""
    return scene.replace({"damping.coefficient": FREE * scene.damping.coefficient}) if scene.damping else scene


def open_braked(scene: Scene, backend: str, precision: str) -> Simulation:
    """Open the bar with the largest brake that its step size allows: the lightest particles of fine meshes allow less.

    Raises UnstableTimeStep if a quarter is too much.
    """
    for part in (1.0, 0.5, 0.25):
        assert scene.damping is not None
        less = scene.replace({"damping.coefficient": part * scene.damping.coefficient}) if part < 1 else scene
        try:
            return open_simulation(less, backend, precision=precision)
        except UnstableTimeStep:
            if part == 0.25:
                raise
    raise AssertionError


def _bar(
    across: int,
    young: float,
    scenes: Sequence[Scene],
    descriptions: Sequence[Description],
    effort: Effort,
    record: Record,
) -> list[Measures]:
    """Measure all settings of a bar. Errors are stored row by row, times when all rows have been sampled in turn."""
    results: list[Measures] = []
    with ExitStack() as stack:
        subjects: list[tuple[int, Subject]] = []
        for scene, one in zip(scenes, descriptions, strict=True):
            method = scene.method
            name = f"{setting_of(method.model_dump())} {method.substeps} x {method.iterations}"
            simulation = stack.enter_context(open_simulation(let_go(scene), one["backend"], precision=one["precision"]))
            row_errors, moves = _errors(simulation, scene, one, (across, young), partial(_report_row, record, name))
            errors = {
                what: value for what, value in row_errors.items() if what not in (SECONDS, RATIO)
            }  # these tell of the end
            store_measures(record.store, record.run, one, record.sources, errors)
            results.append(row_errors)
            if moves:
                record.report(f"{name}, warming up")
                subject = prepare(Subject(simulation, one, start=simulation.state()), effort.seconds, effort.most)
                subjects.append((len(results) - 1, subject))
        record.report("timing all settings in turn")
        timed = in_turn(record, [subject for _, subject in subjects], effort.repeats) if subjects else []
    for (number, _), numbers in zip(subjects, timed, strict=True):
        results[number] |= numbers
    return results


def _report_row(record: Record, name: str, text: str) -> None:
    record.report(f"{name}, {text}")


def _errors(
    simulation: Simulation, scene: Scene, one: Description, bar: tuple[int, float], report: Callable[[str], None]
) -> tuple[Measures, bool]:
    """Return the errors of one setting, and True if its free motion could be followed.

    `simulation`: the scene without a brake, left in that motion; `one`: its description; `bar`: voxels across, and Young's
    modulus [Pa]. References are made when they are first needed.
    """
    errors: Measures = {ELEMENTS: (float(len(scene.tetrahedra_set.tetrahedra)), "", None)}
    report("motion, after the vibrations of the mesh (once)" if "modes" in lacking(bar[0]) else "motion")
    try:
        right = exact_drop(*bar)[1]
        errors[MOTION_ERROR] = (
            drop(simulation, *bar, LONGEST) / right - 1, "", "over the modes of the mesh, half a period after it was let go"
        )  # fmt: skip
    except (TooLong, SoftlabError) as reason:
        errors |= {name: (None, "", str(reason)) for name in (SAG, SOLVER_ERROR, MOTION_ERROR, SECONDS, RATIO)}
    report("rest, after the exact rest of the mesh (once)" if "rest" in lacking(bar[0]) else "rest")
    exact = sag(scene, exact_rest(bar[0]))
    errors[MESH_ERROR] = (exact / continuum_sag(bar[1]) - 1, "", "of the exact rest over the continuum's")
    if SECONDS in errors:
        return errors, False
    try:
        with open_braked(scene, one["backend"], one["precision"]) as braked:
            hung = settle(braked, *bar, LONGEST)
        errors |= {SAG: (hung, "m", None), SOLVER_ERROR: (hung / exact - 1, "", "over the exact rest of the mesh")}
    except (TooLong, SoftlabError) as reason:
        errors |= {name: (None, "", str(reason)) for name in (SAG, SOLVER_ERROR)}
    return errors, True
