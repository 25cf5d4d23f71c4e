"""`softlab sweep --gpus 1 --gpus 2 --gpus 4`: speed-up of several GPUs over one.

One sheet for all GPUs (strong scaling), or one for each (`--weak`). All numbers of GPUs and links of a size are sampled
in turn; each state is first compared bit by bit with that of one GPU, in `exact` math.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from rich.console import Console

from softlab.app.driver import open_simulation
from softlab.app.shared import check_sharing
from softlab.bench.experiments.scaling.model import TRANSFERS, Cluster, predicted
from softlab.bench.measure.case_timing import Case, Rates, Row, Summary
from softlab.bench.measure.costs_timing import Measures
from softlab.bench.measure.declaration import Choices
from softlab.bench.measure.energy import joules_of_all, nvml_counter
from softlab.bench.measure.experiment import source_hash, store_measures
from softlab.bench.measure.gpu import gpu_simulated
from softlab.bench.measure.tables import print_table
from softlab.bench.measure.timing import Subject
from softlab.bench.store.database import Store
from softlab.bench.store.results import Measure, configuration, measures
from softlab.model.base.components import component
from softlab.model.base.errors import SceneError
from softlab.model.core.sharing.decomposition import Stencil, decompose
from softlab.model.core.simulation import Simulation
from softlab.model.scene.scene import Scene, load_scene

DEVICES = "softlab.gpu_backend.domains.devices:devices_for"
DIFFERENCE = "shared_difference"  # m: largest difference from one GPU's state, in exact math
JOULES = "shared_joules"  # J: energy of all GPUs per step
SCENES = {  # word of `--scene` -> catalogue name, ordering of constraints, of sheets that can be partitioned
    "grid": ("lab-grid", None),
    "xpbd": ("cloth-small-steps", "gauss-seidel"),
    "xpbd-jacobi": ("cloth-small-steps", "jacobi"),
}
SIZES, QUICK_SIZES = (2048, 8192, 16384), (512,)
CHECKED = 4096 * 4096  # largest number of masses at which the bits are compared
CHECK_STEPS, CHECK_SUBSTEPS = (
    69,
    90,
)  # two exchanges and a remainder of a grid, at the usual number of steps; with 30 substeps per step
BY_TURNS = " by turns"  # suffix of a link if there were fewer GPUs than windows


@dataclass(frozen=True)
class SharedCase(Case):
    """A sheet on `gpus` GPUs that exchange by `link`."""

    gpus: int = 1
    link: str = "flags"
    exchange_every: int | None = None

    def open(self, math: str | None = None) -> Simulation:
        return open_simulation(
            self.scene, self.backend, precision=self.precision, math=math or self.math, gpus=self.gpus, link=self.link,
            exchange_every=self.exchange_every if self.gpus > 1 else None,
        )  # fmt: skip


def shared_case(scene: Scene, precision: str, gpus: int, link: str, exchange_every: int | None) -> SharedCase:
    """Return one configuration with its description as the store has it.

    One GPU has the same description for any link, and windows that take turns on a GPU do not count as GPUs.
    """
    description = configuration(scene, backend="gpu", precision=precision) | {"gpus": gpus}
    label = f"{scene.grid.rows} x {scene.grid.columns} on {gpus}"
    if gpus > 1:
        turns = BY_TURNS if len(set(component(DEVICES, "--gpus")(gpus))) < gpus else ""
        description |= {"link": link + turns, "exchange_every": exchange_every}
        label += f" by {link}"
    return SharedCase(scene, "gpu", description, source_hash("gpu"), label, gpus, link, exchange_every)


def sheet_of(scene: str, rows: int, columns: int) -> Scene:
    """Return one of SCENES with that many masses."""
    name, ordering = SCENES[scene]
    kind = "cloth" if ordering else "grid"
    changes: dict[str, object] = {f"{kind}.rows": rows, f"{kind}.columns": columns}
    return load_scene(name).replace(changes | ({"method.ordering": ordering} if ordering else {}))


def word_of(scene: Scene) -> str:
    """Return the key of SCENES that the scene belongs to."""
    ordering = scene.method.ordering if scene.cloth else None
    return next(word for word, (_, known) in SCENES.items() if known == ordering)


def _check_steps(scene: Scene) -> int:
    return CHECK_STEPS if word_of(scene) == "grid" else CHECK_SUBSTEPS // scene.method.substeps


def _end_of(case: SharedCase) -> np.ndarray | None:
    """Return the positions after some steps in exact math, or None for a sheet that is too large."""
    if case.scene.grid.particle_count > CHECKED:
        return None
    with case.open("exact") as simulation:
        simulation.advance(_check_steps(case.scene))
        return simulation.state().position


def _measured(row: Row, name: str) -> float | None:
    return row.measures[name].value if name in row.measures else None


class Scaling(Rates):
    """Measure the speed-up of several GPUs over one (`softlab sweep --gpus`).

    States are compared with one GPU's before they are timed; energy is measured with the time.
    """

    name, command, stage = "sweep", "sweep", "shared"
    step, rate, kernel = "shared_step", "shared_masses_per_second", "shared_kernel"
    fields = {
        "sheet": lambda row: word_of(row.scene),
        "rows": lambda row: row.scene.grid.rows,
        "columns": lambda row: row.scene.grid.columns,
        "gpus": lambda row: row.measures[Scaling.rate].description["gpus"],
        "link": lambda row: row.measures[Scaling.rate].description.get("link", ""),
        "exchange_every": lambda row: row.measures[Scaling.rate].description.get("exchange_every"),  # as requested
        "difference": lambda row: _measured(row, DIFFERENCE),  # m, from one GPU's state; None: not measured
        "joules": lambda row: _measured(row, JOULES),  # per step
    }
    order = ("sheet", "precision", "rows", "columns", "gpus", "link")

    def work(self, scene: Scene) -> float:
        """Return the number of masses per step."""
        return scene.grid.particle_count

    def picked(self, how: Choices, quick: bool) -> Choices:
        """Return the options, which `softlab sweep` has checked."""
        return {"precisions": ("float32",)} | dict(how)

    def rows(self, stored: Iterable[Measure], every: bool = False) -> list[Row]:
        """Return the points, smallest first, without those of links that were removed."""
        known = (*TRANSFERS, "")
        return [row for row in super().rows(stored, every) if row.link.removesuffix(BY_TURNS) in known]

    def groups(
        self,
        backends: Sequence[str],
        quick: bool,
        precisions: Sequence[str],
        gpus: Sequence[int] = (1, 2),
        sizes: Sequence[int] | None = None,
        links: Sequence[str] = ("flags",),
        exchange_every: int | None = None,
        weak: bool = False,
        scene: str = "grid",
    ) -> list[list[Case]]:
        """Return the groups timed in turn: all numbers of GPUs and links of a size.

        `weak`: `size` x `size` masses for each GPU, stacked in rows; `scene`: one of SCENES. Raises SceneError for a
        backend without GPUs, an invalid number or an unknown scene, and BackendUnavailable for more GPUs than there are.
        """
        if "gpu" not in backends:
            raise SceneError("--gpus", list(gpus), "applies to --backend gpu")
        for count in gpus:
            if count < 1:
                raise SceneError("--gpus", count, "must be at least 1")
        for link in links:
            check_sharing("gpu", max(gpus), 1, link)
        component(DEVICES, "--gpus")(max(gpus))
        all_groups = []
        for size in sizes or (QUICK_SIZES if quick else SIZES):
            for precision in precisions:
                cases: list[Case] = []
                for n in sorted({1, *gpus}):
                    sheet = sheet_of(scene, size * n if weak else size, size)
                    for link in links if n > 1 else links[:1]:
                        cases.append(shared_case(sheet, precision, n, link, exchange_every))
                all_groups.append(cases)
        return all_groups

    def show(self, console: Console, store: Store, machine: str) -> None:
        """Print a table of what was timed on a machine, with the model's speed-up."""
        timed = self.rows(measures(store, machine=machine))
        by_point, weak = {id(p): (faster, model) for p, faster, model in speedups(timed)}, weak_efficiencies(timed)
        rows = []
        for p in timed:
            faster, model = by_point.get(id(p), (None, None))
            same = "" if p.gpus == 1 else "not compared" if p.difference is None else f"{p.difference:.2g}"
            double = " float64" if p.precision == "float64" else ""
            rows.append((
                f"{p.sheet} {p.rows} x {p.columns}{double}", str(p.gpus), p.link, p.kernel, f"{1e6 * p.step:.1f}",
                f"{p.rate / 1e9:.1f}", "" if faster is None else f"{faster:.2f}", "" if model is None else f"{model:.2f}",
                f"{100 * weak[id(p)]:.1f} %" if id(p) in weak else "", "" if p.joules is None else f"{p.joules:.3g}", same,
            ))  # fmt: skip
        heads = "sheet", "GPUs", "link", "kernel", "step / us", "G / s", "x one", "model", "weak", "J / step", "off / m"
        note = (
            "G / s: masses; x one: one GPU with the same sheet; weak: of one GPU's rate with such a share; model: softlab "
            "scale; off: from one GPU's state in exact math, 0 the same bits"
        )
        print_table(console, heads, rows, note)

    def _time(self, store: Store, summary: Summary, group: Sequence[Case], repeats: int) -> None:
        ends: dict[Scene, np.ndarray | None] = {}  # end positions on one GPU
        for case in group:
            assert isinstance(case, SharedCase)
            if case.gpus == 1:
                continue
            if case.scene not in ends:
                ends[case.scene] = _end_of(replace(case, gpus=1))
            wanted, end = ends[case.scene], _end_of(case)
            numbers: Measures = {DIFFERENCE: (None, "m", f"states are not compared above {CHECKED} masses")}
            if end is not None and wanted is not None:
                off = float(np.abs(np.subtract(end, wanted, dtype=np.float64)).max())
                steps = _check_steps(case.scene)
                numbers = {DIFFERENCE: (off, "m", f"largest, from one GPU, after {steps} steps in exact math")}
            store_measures(store, summary.run, case.description, case.sources, numbers)
        super()._time(store, summary, group, repeats)

    def besides(self, subject: Subject) -> Measures:
        if gpu_simulated():
            return {}
        count = subject.name.gpus
        joules = joules_of_all(subject, [nvml_counter(k) for k in range(count)])
        why = f"of {count} GPUs, by NVML" if joules else "no counter, or it advances too rarely"
        return {JOULES: (joules, "J", why)}


def _every(p: Row) -> int:
    """Return the steps between two exchanges: as requested, or as the lab chooses."""
    return p.exchange_every or decompose(p.rows, p.columns, p.gpus, Stencil()).steps


def _sheet(p: Row) -> tuple[object, ...]:
    """Return the key that two comparable points have in common, without the rows."""
    return p.machine, p.sheet, p.precision, p.columns


def speedups(timed: Sequence[Row]) -> list[tuple[Row, float, float | None]]:
    """Return (point, speed-up over one GPU, speed-up by the model or None) of points of more than one GPU.

    Only points whose sheet was measured on one GPU too, without windows that alternate on a GPU.
    """
    alone = {(*_sheet(p), p.rows): p for p in timed if p.gpus == 1}
    result = []
    for p in timed:
        one = alone.get((*_sheet(p), p.rows))
        if p.gpus == 1 or one is None or p.link.endswith(BY_TURNS):
            continue
        model = None
        if p.precision == "float32" and p.sheet == "grid":
            one_by, many = (
                predicted(p.rows, p.columns, n, Cluster(), steps=_every(p), transfer=TRANSFERS[p.link])
                for n in (1, p.gpus)
            )
            model = one_by.step / many.step
        result.append((p, one.step / p.step, model))
    return result


def weak_efficiencies(timed: Sequence[Row]) -> dict[int, float]:
    """Return {id of a point: rate per GPU over that of one GPU with such a partition alone} (weak scaling).

    Only points whose partition was measured on one GPU; rates in masses/s.
    """
    alone = {(*_sheet(p), p.rows): p for p in timed if p.gpus == 1}
    result = {}
    for p in timed:
        one = alone.get((*_sheet(p), p.rows // p.gpus))
        if p.gpus > 1 and p.rows % p.gpus == 0 and one is not None and not p.link.endswith(BY_TURNS):
            result[id(p)] = p.rate / (p.gpus * one.rate)
    return result
