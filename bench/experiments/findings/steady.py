"""Cost of a step at rest and in motion and over step sizes, and time of a run over its length.

STEADY: the cost of a step should depend neither on the state nor on the step size, or errors and times of different
step sizes would not compare. The accuracy scene S1 is timed from its start, in motion, and from REST seconds on, where
it hangs still, at four step sizes, the same number of steps each.

LENGTH: the time that a user waits for a run, from the start state to the end state on the host, with launches and copy,
for runs of different lengths: costs per run dominate short runs.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial

from softlab.app.driver import open_simulation
from softlab.bench.experiments.accuracy.cases import STEP_SIZES
from softlab.bench.experiments.accuracy.points import SCENES
from softlab.bench.measure.costs_timing import Effort, Measures, Record, in_turn
from softlab.bench.measure.experiment import described
from softlab.bench.measure.items import Group, cost_sources
from softlab.bench.measure.timing import Subject, prepare_runs
from softlab.bench.store.schema import Description
from softlab.model.scene.scene import Scene, load_scene

STEADY, LENGTH = "steady cost", "run length"  # values of `finding`
METHOD, PRECISION = "velocity-verlet", "float32"
REST = 80.0  # s: S1 hangs still, and velocities of float32 have become subnormal
STEPS = 600  # of a run from either state
SIDES = (32, 128)  # masses per side of the runs of different lengths
LENGTHS = (15, 150, 1500, 15000)  # steps of 10 ms: 0.15 s to 150 s
LENGTH_DT = 0.01  # s


class Delivered(Subject):
    """Subject whose runs end with the final state on the host."""

    def run(self, steps: int) -> float:
        begin = time.perf_counter()
        self.simulation.advance(steps)
        self.simulation.state()
        return time.perf_counter() - begin


def steady_groups(backend: str, effort: Effort, quick: bool) -> list[Group]:
    """Return the groups of both findings on a backend; `quick`: two step sizes, the small sheet, no longest run."""
    base = load_scene(SCENES["S1"]).replace({"method.integrator": METHOD})
    sources = cost_sources(backend, [__file__])
    sizes, sides, lengths = (STEP_SIZES[:4:2], SIDES[:1], LENGTHS[:3]) if quick else (STEP_SIZES[::2], SIDES, LENGTHS)
    variants = [(base.replace({"method.dt": dt}), state) for dt in sizes for state in ("start", "rest")]
    descriptions = tuple(
        described(scene, backend, STEADY, precision=PRECISION, state=state) for scene, state in variants
    )
    run = partial(_steady, variants, descriptions, effort)
    all_groups = [Group(f"{STEADY}, {backend}", descriptions, sources, run)]
    for side in sides:
        scene = base.replace({"grid.rows": side, "grid.columns": side, "method.dt": LENGTH_DT})
        runs = tuple(described(scene, backend, LENGTH, precision=PRECISION, steps=steps) for steps in lengths)
        all_groups.append(
            Group(f"{LENGTH}, {side} x {side}, {backend}", runs, sources, partial(_lengths, scene, runs, effort))
        )
    return all_groups


def _steady(
    variants: Sequence[tuple[Scene, str]], descriptions: Sequence[Description], effort: Effort, record: Record
) -> list[Measures]:
    with ExitStack() as stack:
        subjects = []
        for (scene, state), one in zip(variants, descriptions, strict=True):
            simulation = stack.enter_context(open_simulation(scene, one["backend"], precision=PRECISION))
            if state == "rest":
                record.report(f"to rest, {scene.method.dt:g} s a step")
                simulation.advance(round(REST / scene.method.dt))
            start = simulation.state() if state == "rest" else None
            subjects.append(prepare_runs(Subject(simulation, one, start=start), STEPS, effort.seconds))
        return in_turn(record, subjects, effort.repeats)


def _lengths(scene: Scene, descriptions: Sequence[Description], effort: Effort, record: Record) -> list[Measures]:
    with ExitStack() as stack:
        subjects = []
        for one in descriptions:
            simulation = stack.enter_context(open_simulation(scene, one["backend"], precision=PRECISION))
            subjects.append(prepare_runs(Delivered(simulation, one), one["steps"], effort.seconds))
        return in_turn(record, subjects, effort.repeats)
