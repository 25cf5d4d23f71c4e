"""Cost of determinism: the step with each mass gathering its forces in a fixed order, and with springs scattering them.

All kernels of the lab gather. The result repeats bit for bit, whatever the number of threads and their scheduling, and
a mass is written by one thread only; but the force of a spring is needed at both of its ends. Compared with:

- on the GPU, a scatter with atomic additions, which evaluates each spring once and does not repeat, and the same with
  springs in four colours, which does (bench/experiments/findings/scatter_gpu.py). The gather is the lab's `graph`, with
  one launch per step like those.
- on the CPU, a scatter in four colours (bench/experiments/findings/scatter_cpu.py), and a gather that evaluates each
  spring twice (bench/experiments/findings/gather_cpu.py). The lab's `fused` carries a force to the other end and
  evaluates each spring once.

Each is first compared with the lab's CPU in float64 `exact` math; a wrong result gets no ratio. The number of `RUNS`
runs from one start whose end state differs in bits from the first is counted.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial

import numpy as np

from softlab.app.driver import open_simulation
from softlab.bench.experiments import checks
from softlab.bench.experiments.checks import compare, displaced
from softlab.bench.experiments.findings import gather_cpu, scatter_cpu
from softlab.bench.measure.costs_timing import RATIO, Effort, Measures, Record, in_turn
from softlab.bench.measure.experiment import described
from softlab.bench.measure.items import Group, cost_sources
from softlab.bench.measure.timing import Subject, prepare
from softlab.bench.store.schema import Description
from softlab.model.core.simulation import PRECISIONS, Simulation, State
from softlab.model.scene.scene import Scene, load_scene

DETERMINISM = "determinism"  # value of `finding`
DIFFERENT = "cost_different"  # runs whose end state differs in bits from the first
DISTANCE = "cost_distance"  # spacings, root mean square, from the lab's CPU in float64 `exact` math
GATHER = "gather"  # value of the field `sums` for the lab's own kernel; the others are kernel names
SCENE = "lab-grid"
SIZES = {"cpu": (32, 256, 1024), "gpu": (32, 256, 1024, 4096)}
OTHERS = {"cpu": (scatter_cpu.COLOURS, gather_cpu.TWICE), "gpu": ("atomics", "colours")}
RUNS, RUN_STEPS = 10, 100
FEW_STEPS = 10  # of the check of grids above MANY_STEPS_UP_TO, which the CPU has to run too
MANY_STEPS_UP_TO = 512 * 512  # masses


def determinism(backend: str, effort: Effort, most: int | None = None) -> list[Group]:
    """Return groups for the lab's grid at several sizes, both precisions: (gather, the others), all in `fast` math."""
    files = [checks.__file__, scatter_cpu.__file__, gather_cpu.__file__]
    if backend == "gpu":
        from softlab.bench.experiments.findings import scatter_gpu

        files = [checks.__file__, scatter_gpu.__file__]
    sources = cost_sources(backend, [*map(str, files), __file__])
    all_groups = []
    for n in SIZES[backend]:
        if most and n > most:
            continue
        scene = load_scene(SCENE).replace({"grid.rows": n, "grid.columns": n})
        for precision in PRECISIONS:
            descriptions = tuple(
                described(scene, backend, DETERMINISM, precision=precision, sums=how)
                for how in (GATHER, *OTHERS[backend])
            )
            measure = partial(_costs, scene, descriptions, effort)
            all_groups.append(Group(f"{DETERMINISM} {n} x {n} {precision} {backend}", descriptions, sources, measure))
    return all_groups


def open_variant(scene: Scene, backend: str, precision: str, how: str) -> Simulation:
    """Open the scene with the summation `how`: GATHER, or one of OTHERS."""
    if how == GATHER:
        return open_simulation(scene, backend, precision=precision, kernel=_lab_kernel(backend))
    if backend == "gpu":
        from softlab.bench.experiments.findings.scatter_gpu import ScatterGrid

        return ScatterGrid(scene, precision, how)
    make: Callable[..., Simulation] = scatter_cpu.ColouredGrid if how == scatter_cpu.COLOURS else gather_cpu.GatherGrid
    return make(scene, precision)


def _lab_kernel(backend: str) -> str:
    """Return the lab's kernel with one pass per step."""
    if backend == "cpu":
        return "fused"
    from softlab.gpu_backend.core.launch import can_capture

    return "graph" if can_capture() else "launch"


def _costs(scene: Scene, descriptions: tuple[Description, ...], effort: Effort, record: Record) -> list[Measures]:
    many = scene.grid.rows * scene.grid.columns <= MANY_STEPS_UP_TO
    steps = RUN_STEPS if many else FEW_STEPS
    start, expected = _expected(scene, steps)
    with ExitStack() as stack:
        subjects, checked, good = [], [], []
        for description in descriptions:
            simulation = stack.enter_context(
                open_variant(scene, description["backend"], description["precision"], description["sums"])
            )
            simulation.load(start)
            simulation.advance(steps)
            check = compare(simulation, expected, f"{steps} steps, against the lab's CPU in float64, exact")
            different = different_runs(simulation, start, RUNS, steps)
            checked.append(
                {
                    DISTANCE: (check.error, "spacing", check.note),
                    DIFFERENT: (different, "", f"of {RUNS - 1} runs after the first, {steps} steps"),
                }
            )
            good.append(check.good)
            subjects.append(prepare(Subject(simulation, description), effort.seconds, effort.most))
        timed = in_turn(record, subjects, effort.repeats)
    wrong: Measures = {RATIO: (None, "", "wrong answer")}
    return [before | (numbers if fine else wrong) for before, numbers, fine in zip(checked, timed, good, strict=True)]


def _expected(scene: Scene, steps: int) -> tuple[State, np.ndarray]:
    """Return (a displaced start, the positions after `steps` steps) by the lab's CPU in float64 `exact` math."""
    with open_simulation(scene, "cpu", precision="float64", math="exact") as judge:
        start = displaced(judge)
        judge.load(start)
        judge.advance(steps)
        return start, judge.state().position


def different_runs(simulation: Simulation, start: State, runs: int, steps: int) -> int:
    """Count the runs, of `runs` runs of `steps` steps from `start`, whose end state differs in bits from the first."""
    ends = []
    for _ in range(runs):
        simulation.load(start)
        simulation.advance(steps)
        state = simulation.state()
        ends.append((state.position.tobytes(), state.velocity.tobytes()))
    return sum(end != ends[0] for end in ends[1:])
