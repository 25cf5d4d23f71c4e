"""Measured time of every stage of a step, run one by one, and of the whole step of the default kernel.

That kernel starts its threads once and its stages reuse loads, so it takes a fraction of the sum. On the CPU each stage
of a real step is timed in turn. On a GPU a launch from Python takes longer than most stages, so each stage is captured
many times in a graph (gpu_backend/core/launch.py) and replayed. Repeating a stage leads to an arbitrary state, which is
discarded; the time of a stage does not depend on its values.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf
from statistics import median
from typing import Any

from softlab.app.driver import open_simulation
from softlab.model.base.errors import BackendUnavailable, SceneError
from softlab.model.core.plan import Moment, Stage, StageRun
from softlab.model.core.simulation import Simulation
from softlab.model.scene.scene import Scene

SECONDS = 1.0  # of measuring a backend
MIN_STEPS, MAX_STEPS = 3, 20000
SAMPLES = 10
REWIND = 256  # steps until the state is reset, so that a diverging one never runs for long
MIN_REPLAYS = 256  # of a stage on a GPU: one whole graph
EMPTY = "empty"  # on the CPU: a stage that starts the threads and does nothing

Runs = Mapping[str, StageRun]
Moments = list[tuple[Stage, Moment]]


@dataclass(frozen=True)
class StageTimes:
    """`seconds` of each stage in the order of a step; `empty`: of an empty stage. Or `missing`: the reason. `step`: of
    a whole step with the default kernel."""

    seconds: tuple[float, ...] = ()
    empty: float | None = None
    missing: str | None = None
    step: float | None = None


def measure_stages(scene: Scene, backend: str, precision: str, required: bool = False) -> StageTimes:
    """Return the time of every stage of a scene on a backend, and of a whole step, within about two seconds.

    Raises BackendUnavailable instead, if `required`.
    """
    try:
        simulation = open_simulation(scene, backend, precision=precision, kernel="stages", allow_unstable=True)
    except BackendUnavailable as error:
        if required:
            raise
        return StageTimes(missing=str(error))
    except SceneError as error:  # a solver without a stage-by-stage kernel
        times = StageTimes(missing=str(error))
    else:
        with simulation:
            times = _stage_times(simulation)
    with open_simulation(scene, backend, precision=precision, allow_unstable=True) as whole:
        return replace(times, step=_step_time(whole))


def _step_time(simulation: Simulation) -> float:
    """Return the seconds of a step: the minimum of samples that take about a second together."""
    simulation.advance(1)  # remaining compilation and loading
    simulation.synchronize()
    least, steps = inf, 1
    end = time.perf_counter() + SECONDS
    while True:
        simulation.rewind()
        simulation.synchronize()
        begin = time.perf_counter()
        simulation.advance(steps)
        simulation.synchronize()
        now = time.perf_counter()
        least = min(least, (now - begin) / steps)
        if now > end:
            return least
        if now - begin < SECONDS / SAMPLES:
            steps = min(2 * steps, REWIND)


def _stage_times(simulation: Simulation) -> StageTimes:
    stages = list(simulation.plan.moments(0))
    runs = simulation.stages
    if simulation.backend == "gpu":
        from softlab.gpu_backend.core.device import simulated

        return (_in_turn if simulated() else _replayed)(simulation, stages, runs)
    from softlab.cpu_backend.core.compile import start_threads

    runs = {**runs, EMPTY: lambda moment: start_threads()}
    *seconds, empty = _in_turn(simulation, [*stages, (Stage(EMPTY, 0, 0, 0), Moment())], runs).seconds
    return StageTimes(tuple(seconds), empty)


def _warm_up(simulation: Simulation, stages: Moments, runs: Runs) -> None:
    """Run one step, which compiles and loads the rest."""
    for stage, moment in stages:
        runs[stage.name](moment)
    simulation.synchronize()


def _in_turn(simulation: Simulation, stages: Moments, runs: Runs) -> StageTimes:
    """Return the medians over the steps of about a second."""
    _warm_up(simulation, stages, runs)
    samples: list[list[float]] = [[] for _ in stages]
    end = time.perf_counter() + SECONDS
    step = 0
    while step < MIN_STEPS or (step < MAX_STEPS and time.perf_counter() < end):
        if step % REWIND == 0:
            simulation.rewind()
        simulation.synchronize()
        for (stage, moment), taken in zip(stages, samples, strict=True):
            begin = time.perf_counter()
            runs[stage.name](replace(moment, step=step))
            simulation.synchronize()
            taken.append(time.perf_counter() - begin)
        step += 1
    return StageTimes(tuple(median(taken) for taken in samples))


def _replayed(simulation: Any, stages: Moments, runs: Runs) -> StageTimes:
    """Time each stage separately, for its fraction of a second."""
    from softlab.gpu_backend.core.launch import Graphs

    _warm_up(simulation, stages, runs)
    seconds = []
    for stage, moment in stages:

        def launch(parity: int, count: int, run: StageRun = runs[stage.name], moment: Moment = moment) -> None:
            for _ in range(count):
                run(moment)

        graphs = Graphs(simulation.stream, launch, lambda count: None)

        def timed(count: int, graphs: Graphs = graphs) -> float:
            simulation.synchronize()
            begin = time.perf_counter()
            graphs.run(0, count)
            simulation.synchronize()
            return time.perf_counter() - begin

        timed(MIN_REPLAYS)  # captures
        one = timed(MIN_REPLAYS) / MIN_REPLAYS
        chunks = max(1, int(SECONDS / len(stages) / one / MIN_REPLAYS))
        count = MIN_REPLAYS * min(chunks, MAX_STEPS)
        seconds.append(timed(count) / count)
        graphs.close()
        simulation.rewind()
    return StageTimes(tuple(seconds))
