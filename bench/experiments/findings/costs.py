"""Costs of the lab's safeguards as ratios of times sampled in turn in one process; stored, resumable.

The safeguards are the check for a diverged state (here), and adding forces in a fixed order
(bench/experiments/findings/determinism.py). A check costs little compared with the steps between two checks, often less
than the scatter of the repeats. It is therefore measured twice: as the ratio of the same steps with checks at their
real interval and without any, and as the time of one check over the minimum time of the steps between two.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Sequence
from functools import partial

from softlab.app.driver import open_simulation
from softlab.bench.measure.costs_timing import FULL, QUICK, QUICKEST, Effort, Measures, Record, in_turn
from softlab.bench.measure.declaration import WITH_FINDINGS
from softlab.bench.measure.experiment import described
from softlab.bench.measure.items import Group, Items, cost_sources
from softlab.bench.measure.timing import Subject, prepare
from softlab.bench.store.database import Store
from softlab.bench.store.schema import Description
from softlab.model.core import stepping
from softlab.model.core.simulation import PRECISIONS, Simulation
from softlab.model.scene.scene import Scene, load_scene

CHECKS = "looks"  # value of `finding`
CHECK_FRACTION = "cost_share"  # of CHECKS: time of a check over that of the steps between two
INTERVAL = "cost_interval"  # steps between two checks
CHECK_SCENE = "lab-grid"
CHECK_SIZES = {"cpu": (8, 32, 128, 512, 1024), "gpu": (16, 32, 128, 512, 1024, 2048, 4096)}
QUICK_MOST = 512  # largest number of masses per side that `quick` measures
CHECK_REPEATS = 15  # repeats of a single check; their median counts
NEVER = 2**62  # steps


def groups(store: Store, backends: Sequence[str], quick: bool) -> list[Group]:
    """Return the groups of all costs; `quick`: no grid wider than QUICK_MOST, fewer and shorter samples."""
    from softlab.bench.experiments.findings.determinism import determinism
    from softlab.bench.experiments.findings.steady import steady_groups
    from softlab.bench.measure.vertex_timing import vertex_groups  # imported late, because it loads the drawing code

    effort, most = (QUICK, QUICK_MOST) if quick else (FULL, None)
    all_groups = [
        g for backend in backends for g in (*check_groups(backend, effort, most), *determinism(backend, effort, most))
    ]
    all_groups += [group for backend in backends for group in steady_groups(backend, effort, quick)]
    return all_groups + (vertex_groups(effort, most) if "gpu" in backends else [])


class Costs(Items):
    """Measure the cost of softlab's checks."""

    name, command, doing = "costs", "accuracy", "costs: "
    in_lab, on_workers, extra = True, True, WITH_FINDINGS
    items = staticmethod(groups)


# ---------------------------------------------------------------------- cost of the check for a diverged state


class _Checking(Subject):
    """Subject that is stepped with a check every `interval` steps."""

    interval: int = NEVER

    def run(self, steps: int) -> float:
        self.simulation.check_interval = self.interval
        return super().run(steps)


def check_groups(backend: str, effort: Effort, most: int | None = None) -> list[Group]:
    """Return groups for the lab's grid at several sizes, both precisions, default kernel: (without checks, with
    checks).
    """
    sources = cost_sources(backend, [str(stepping.__file__)])
    all_groups = []
    for n in CHECK_SIZES[backend]:
        if most and n > most:
            continue
        scene = load_scene(CHECK_SCENE).replace({"grid.rows": n, "grid.columns": n})
        for precision in PRECISIONS:
            descriptions = tuple(
                described(scene, backend, CHECKS, precision=precision, looks=checking) for checking in (False, True)
            )
            measure = partial(_measure, scene, descriptions, effort)
            all_groups.append(Group(f"{CHECKS} {n} x {n} {precision} {backend}", descriptions, sources, measure))
    return all_groups


def _measure(scene: Scene, descriptions: Sequence[Description], effort: Effort, record: Record) -> list[Measures]:
    with open_simulation(scene, descriptions[0]["backend"], precision=descriptions[0]["precision"]) as simulation:
        return _check_costs(record, simulation, descriptions, effort)


def _check_costs(
    record: Record, simulation: Simulation, descriptions: Sequence[Description], effort: Effort
) -> list[Measures]:
    """Measure the same steps without and with checks. A sample is a whole number of intervals, so that each has its
    check.
    """
    interval = simulation.check_interval
    without, looking = (_Checking(simulation, description) for description in descriptions)
    looking.interval = interval
    prepare(without, effort.seconds, effort.most)
    for subject in (without, looking):
        subject.steps = max(1, -(-without.steps // interval)) * interval
        subject.wanted_seconds = without.wanted_seconds
    plain, looked = in_turn(record, (without, looking), effort.repeats)
    check = _one_check(simulation)
    # not the median: other programs that slow the steps down would make checks seem cheap
    step, _, reason = plain[QUICKEST]
    assert step is not None
    fraction = check / (interval * step)
    note = f"a look of {check * 1e6:.3g} us every {interval} steps; {reason}"
    looked = {INTERVAL: (interval, "", None), CHECK_FRACTION: (fraction, "", note)} | looked
    return [plain, looked]


def _one_check(simulation: Simulation) -> float:
    """Return the median time [s] of a single check, including the copy of the state that it makes."""
    simulation.check_interval = NEVER
    taken = []
    for _ in range(CHECK_REPEATS):
        simulation.advance(2)
        simulation.synchronize()
        begin = time.perf_counter()
        simulation.check()
        simulation.synchronize()
        taken.append(time.perf_counter() - begin)
    return statistics.median(taken)
