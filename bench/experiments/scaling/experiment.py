"""How much faster several GPUs are than one: `softlab sweep --gpus 1 --gpus 2 --gpus 4`, one grid for all (strong scaling), or
a grid for each (`--weak`). All numbers of GPUs of a size are sampled in turn; each is held against one GPU's bits first, in
`exact` math."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rich.console import Console

from app.driver import open_simulation
from bench.experiments.scaling.model import Cluster, predicted
from bench.measure.case_timing import Case, RatePoint, Rates, Summary
from bench.measure.costs_timing import Measures
from bench.measure.experiment import keep, source_hash
from bench.store.database import Store
from bench.store.results import Measure, configuration, measures
from bench.store.tables import print_table
from model.core.errors import SceneError
from model.core.simulation import Simulation
from model.scene.scene import Scene, load_scene

STAGE = "shared"  # of the samples
STEP = "shared_step"  # s: the median of a step
RATE = "shared_masses_per_second"
KERNEL = "shared_kernel"  # its name is the reason
DIFFERENCE = "shared_difference"  # m: the largest from one GPU's state, in exact math
SIZES, QUICK_SIZES = (2048, 8192, 16384), (512,)
CHECKED = 4096 * 4096  # masses up to which the bits are compared
CHECK_STEPS = 37  # two exchanges and a rest, at the usual 16 steps
BY_TURNS = " by turns"  # of a link: there were fewer GPUs than windows


@dataclass(frozen=True)
class SharedCase(Case):
    """A grid on `gpus` GPUs, linked as `link` says."""

    gpus: int = 1
    link: str = "peer"
    exchange_every: int | None = None

    def open(self, math: str | None = None) -> Simulation:
        return open_simulation(
            self.scene, self.backend, precision=self.precision, math=math or self.math, gpus=self.gpus, link=self.link,
            exchange_every=self.exchange_every if self.gpus > 1 else None,
        )  # fmt: skip


def shared_case(scene: Scene, precision: str, gpus: int, link: str, exchange_every: int | None) -> SharedCase:
    """One configuration, described as the store holds it: one GPU is the same whatever the link, and windows that take turns
    on a GPU are no GPUs of their own."""
    from gpu_backend.domains.devices import devices_for

    description = configuration(scene, backend="gpu", precision=precision) | {"gpus": gpus}
    if gpus > 1:
        turns = BY_TURNS if len(set(devices_for(gpus))) < gpus else ""
        description |= {"link": link + turns, "exchange_every": exchange_every}
    label = f"{scene.grid.rows} x {scene.grid.columns} on {gpus}"
    return SharedCase(scene, "gpu", description, source_hash("gpu"), label, gpus, link, exchange_every)


def groups(
    backends: Sequence[str],
    quick: bool,
    precisions: Sequence[str],
    gpus: Sequence[int] = (1, 2),
    sizes: Sequence[int] | None = None,
    link: str = "peer",
    exchange_every: int | None = None,
    weak: bool = False,
) -> list[list[Case]]:
    """What is timed in turn: all numbers of GPUs of a size; `weak`: so many masses for each GPU, rows on rows. Raises
    SceneError for a backend without GPUs, a number that is none, and BackendUnavailable for more GPUs than there are."""
    from gpu_backend.domains.devices import devices_for

    if "gpu" not in backends:
        raise SceneError("--gpus", list(gpus), "is for --backend gpu")
    for count in gpus:
        if count < 1:
            raise SceneError("--gpus", count, "must be at least 1")
    devices_for(max(gpus))
    counts, found = sorted({1, *gpus}), []
    for size in sizes or (QUICK_SIZES if quick else SIZES):
        scenes = {n: grid_of(size * n if weak else size, size) for n in counts}
        for precision in precisions:
            cases: list[Case] = [shared_case(scenes[n], precision, n, link, exchange_every) for n in counts]
            found.append(cases)
    return found


def grid_of(rows: int, columns: int) -> Scene:
    """The lab grid of so many masses."""
    return load_scene("lab-grid").replace({"grid.rows": rows, "grid.columns": columns})


class SharedRates(Rates):
    """Rates whose states are held against one GPU's before they are timed."""

    def _time(self, store: Store, summary: Summary, group: Sequence[Case], repeats: int) -> None:
        ends: dict[Scene, np.ndarray | None] = {}  # of one GPU
        for case in group:
            assert isinstance(case, SharedCase)
            if case.gpus == 1:
                continue
            if case.scene not in ends:
                ends[case.scene] = _end_of(replace(case, gpus=1))
            wanted, found = ends[case.scene], _end_of(case)
            numbers: Measures = {DIFFERENCE: (None, "m", f"over {CHECKED} masses no states are compared")}
            if found is not None and wanted is not None:
                off = float(np.abs(np.subtract(found, wanted, dtype=np.float64)).max())
                numbers = {DIFFERENCE: (off, "m", f"largest, from one GPU, after {CHECK_STEPS} steps in exact math")}
            keep(store, summary.run, case.description, case.sources, numbers)
        super()._time(store, summary, group, repeats)


def _end_of(case: SharedCase) -> np.ndarray | None:
    """Positions after some steps in exact math; None of a grid that is too large."""
    if case.scene.grid.particle_count > CHECKED:
        return None
    with case.open("exact") as simulation:
        simulation.advance(CHECK_STEPS)
        return simulation.state().position


def masses(scene: Scene) -> int:
    """Of a step."""
    return scene.grid.particle_count


RATES = run_scaling = SharedRates("sweep", STAGE, STEP, RATE, KERNEL, masses, groups)


@dataclass(frozen=True)
class ScalingPoint(RatePoint):
    """Of a grid on `gpus` GPUs. `difference` [m] from one GPU's state, None: not compared."""

    rows: int
    columns: int
    gpus: int
    link: str
    difference: float | None


def points(held: Iterable[Measure]) -> list[ScalingPoint]:
    """What the measures tell, smallest first."""
    held = list(held)
    off = {(m.machine, m.configuration): m.value for m in held if m.name == DIFFERENCE}
    found = []
    for told, scene, point in RATES.told(held):
        rate, grid = told[RATE], scene.grid
        what: dict[str, Any] = rate.description
        place = grid.rows, grid.columns, what["gpus"], what.get("link", "")
        found.append(ScalingPoint(**vars(point), **dict(zip(("rows", "columns", "gpus", "link"), place, strict=True)),
                                  difference=off.get((rate.machine, rate.configuration))))  # fmt: skip
    return sorted(found, key=lambda p: (p.precision, p.rows, p.columns, p.gpus, p.link))


def speedups(found: Sequence[ScalingPoint]) -> list[tuple[ScalingPoint, float, float | None]]:
    """(point, how many times as fast as one GPU, how many times the model says, None in float64) of points of more than one
    GPU whose one was measured, too; not of windows that took turns."""
    alone = {(p.machine, p.precision, p.rows, p.columns): p for p in found if p.gpus == 1}
    result = []
    for p in found:
        one = alone.get((p.machine, p.precision, p.rows, p.columns))
        if p.gpus == 1 or one is None or p.link.endswith(BY_TURNS):
            continue
        model = None
        if p.precision == "float32":
            first, many = (predicted(p.rows, p.columns, count, Cluster()) for count in (1, p.gpus))
            model = first.step / many.step
        result.append((p, one.step / p.step, model))
    return result


def shares(found: Sequence[ScalingPoint]) -> dict[int, float]:
    """{id of a point: masses a second of each of its GPUs, over those of one GPU with such a share alone} (weak scaling), of
    points whose share was measured on one."""
    alone = {(p.machine, p.precision, p.rows, p.columns): p for p in found if p.gpus == 1}
    result = {}
    for p in found:
        one = alone.get((p.machine, p.precision, p.rows // p.gpus, p.columns))
        if p.gpus > 1 and p.rows % p.gpus == 0 and one is not None and not p.link.endswith(BY_TURNS):
            result[id(p)] = p.rate / (p.gpus * one.rate)
    return result


def print_scaling(console: Console, store: Store, machine: str) -> None:
    """A table of what was timed on a machine, beside what the model says."""
    found = points(measures(store, machine=machine))
    told, weak = {id(p): (faster, model) for p, faster, model in speedups(found)}, shares(found)
    rows = []
    for p in found:
        faster, model = told.get(id(p), (None, None))
        same = "" if p.gpus == 1 else "not compared" if p.difference is None else f"{p.difference:.2g}"
        grid, ways = f"{p.rows} x {p.columns}", (p.precision, str(p.gpus), p.link, p.kernel)
        rows.append((
            grid, *ways, f"{1e6 * p.step:.1f}", f"{p.rate / 1e9:.1f}",
            "" if faster is None else f"{faster:.2f}", "" if faster is None else f"{100 * faster / p.gpus:.1f} %",
            "" if model is None else f"{model:.2f}", f"{100 * weak[id(p)]:.1f} %" if id(p) in weak else "", same,
        ))  # fmt: skip
    heads = (
        "grid",
        "",
        "GPUs",
        "link",
        "kernel",
        "step / us",
        "G masses / s",
        "x one",
        "of ideal",
        "model",
        "weak",
        "off / m",
    )
    note = "weak: of one GPU's rate with such a share; off: from one GPU's state in exact math, 0 the same bits; model: scale"
    print_table(console, heads, rows, note)
