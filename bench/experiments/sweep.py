"""Timing sweep: sizes x backends x threads x precisions x {without graphics, with}, into the store.

Small and cheap configurations come first, so that an interrupted sweep is useful. Results that the store has of this
machine and these sources are not measured again; every sample is written to disk as soon as it is finished.

`quick`: squares from 16 to 512 masses per side at 3 samples of 20 ms (drawn up to 256; float64 on 1x threads only), a
1:4, a 4:1 and a size that no block divides, in a quarter of a minute. Otherwise: squares from 16 on, 1:4 and 4:1 at the
mass counts of four of them, five odd sizes, 5 samples of 100 ms, as far as memory and `max_seconds` allow.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from softlab.bench.experiments.group import GroupRunner
from softlab.bench.measure.cases import Case, Effort, Kind, SweepSummary, record_skip
from softlab.bench.measure.experiment import Report, backends_here, host_of, resume, source_hash
from softlab.bench.store.database import Store
from softlab.bench.store.results import configuration, timings
from softlab.bench.store.schema import configuration_hash
from softlab.cpu_backend.core.threads import thread_count
from softlab.model.base.errors import SceneError
from softlab.model.base.memory import available_bytes, readable
from softlab.model.core.simulation import PRECISIONS
from softlab.model.scene.scene import Scene, load_scene

Shape = tuple[int, int]  # rows, columns, in masses

SQUARES = tuple(16 << k for k in range(11))  # 16 ... 16384
QUICK_SQUARES = (16, 32, 64, 128, 256, 512)
QUICK_OTHERS: tuple[Shape, ...] = ((32, 128), (128, 32), (100, 100))
QUICK_DRAWN = tuple((n, n) for n in QUICK_SQUARES[:-1])  # the other shapes are not drawn
ODD: tuple[Shape, ...] = ((100, 100), (1000, 37), (37, 1000), (1023, 1025), (3001, 2999))
STRETCHED = (64, 256, 1024, 4096)  # squares whose mass counts are measured at 4:1 and 1:4 too
THREADS = ("1x", "2x", "4x", 1)  # one thread: the baseline of every speed-up
QUICK = Effort(3, 0.02, 3.0, 75.0)
FULL = Effort(5, 0.1, 30.0, None)


def shapes(quick: bool, sizes: Iterable[int | Shape] | None = None) -> list[Shape]:
    """Return the grids of a sweep, smallest first; `sizes`: these instead, as N (a square) or (rows, columns)."""
    if sizes is not None:
        chosen = [(size, size) if isinstance(size, int) else (int(size[0]), int(size[1])) for size in sizes]
        for shape in chosen:
            if min(shape) < 1:
                asked = shape[0] if shape[0] == shape[1] else shape
                raise SceneError("--size", asked, "a grid has at least 1 x 1 masses")
    elif quick:
        chosen = [*((n, n) for n in QUICK_SQUARES), *QUICK_OTHERS]
    else:
        stretched = [shape for n in STRETCHED for shape in ((n // 2, 2 * n), (2 * n, n // 2))]
        chosen = [*((n, n) for n in SQUARES), *stretched, *ODD]
    return sorted(set(chosen), key=lambda shape: (shape[0] * shape[1], abs(shape[0] - shape[1]), shape))


def cases_of(
    scene: Scene,
    backends: Sequence[str],
    threads: Sequence[str | int],
    precisions: Sequence[str],
    graphics: Sequence[bool],
) -> list[Case]:
    """Return the configurations of one grid, without duplicates. Raises SceneError for an impossible number of threads."""
    cases: dict[str, Case] = {}
    for precision in precisions:
        for backend in backends:
            for word in threads if backend == "cpu" else [None]:
                host = host_of(backend, word or "1x")
                text = None if word is None else str(word)
                for drawn in graphics:
                    description = configuration(scene, backend=backend, precision=precision, graphics=drawn, **host)
                    count, sources = host.get("threads"), source_hash(backend)
                    case = Case(scene, backend, text, count, precision, drawn, description, sources)
                    cases.setdefault(configuration_hash(description), case)
    return list(cases.values())


def _quick_cases(
    scene: Scene, backends: Sequence[str], threads: Sequence[str | int], precisions: Sequence[str], graphics: bool
) -> list[Case]:
    """Return the configurations of one grid in a quick sweep.

    The first precision on all threads, drawn if the shape is in QUICK_DRAWN; the others, for squares, on the first
    number of threads.
    """
    shape = scene.grid.rows, scene.grid.columns
    drawn = (False, True) if graphics and shape in QUICK_DRAWN else (False,)
    selected = cases_of(scene, backends, threads, precisions[:1], drawn)
    return selected + (cases_of(scene, backends, threads[:1], precisions[1:], (False,)) if shape[0] == shape[1] else [])


def check_positive(name: str, value: float | None) -> None:
    """Raise SceneError naming the option `name` unless `value` is None or finite and greater than 0."""
    if value is not None and not 0 < value < float("inf"):
        raise SceneError(name, value, "must be greater than 0 and finite")


@dataclass(frozen=True)
class Asked:
    """Request of a sweep.

    `scene` gives everything but the grid's size; `sizes`: as in `shapes`. `max_seconds` [s]: longest time of one
    configuration; one that is estimated to take longer is not started. `total_seconds` [s]: nothing new is started
    after it (None: no limit; quick has 75). `repeats`, `min_seconds`: samples, and seconds of one. `again`: repeat
    samples that other programs disturbed.
    """

    quick: bool = False
    scene: Scene | str = "lab-grid"
    backends: Sequence[str] | None = None
    sizes: Iterable[int | Shape] | None = None
    precisions: Sequence[str] = tuple(PRECISIONS)
    max_seconds: float | None = None
    total_seconds: float | None = None
    repeats: int | None = None
    min_seconds: float | None = None
    again: bool = True
    progress: bool = True
    command: str = "softlab sweep"

    def effort(self) -> Effort:
        """Return the preset with the requested changes. Raises SceneError for a value that is not positive."""
        for name, value in (
            ("--max-seconds", self.max_seconds), ("--total-seconds", self.total_seconds), ("--repeats", self.repeats),
            ("min_seconds", self.min_seconds),
        ):  # fmt: skip
            check_positive(name, value)
        preset = QUICK if self.quick else FULL
        repeats = self.repeats or preset.repeats
        return Effort(
            repeats, self.min_seconds or preset.min_seconds, self.max_seconds or preset.max_seconds,
            self.total_seconds or preset.total_seconds, again=repeats if self.again and not self.quick else 0,
        )  # fmt: skip

    def grids(self, usual: Iterable[int] | None = None) -> list[Scene]:
        """Return the scene in every requested size, smallest first. If none was requested: squares of the `usual` sizes,
        or with None those of `shapes`."""
        base = self.scene if isinstance(self.scene, Scene) else load_scene(self.scene)
        planned = shapes(self.quick, self.sizes if self.sizes is not None else usual)
        return [base.replace({"grid.rows": rows, "grid.columns": columns}) for rows, columns in planned]


def run_sweep(
    store: Store, *, threads: Sequence[str | int] = THREADS, graphics: bool = True, **how: Any
) -> SweepSummary:
    """Measure the configurations that the store lacks, and return a summary.

    `how`: fields of `Asked`. Ctrl-C ends cleanly (`interrupted`).

    Raises SceneError (an impossible choice), InputError (the store), BackendUnavailable (a requested backend).
    """
    asked = Asked(**how)
    effort, here, grids = asked.effort(), backends_here(asked.backends), asked.grids()
    for word in threads:
        thread_count(word)  # refuse an impossible number before anything is measured
    sweep = Sweep(GroupRunner(store, effort, SweepSummary.begun(store, "sweep"), here, {}))
    drawn = (False, True) if graphics else (False,)
    if asked.quick and asked.sizes is None:
        cases = [_quick_cases(scene, here, threads, asked.precisions, graphics) for scene in grids]
    else:
        cases = [cases_of(scene, here, threads, asked.precisions, drawn) for scene in grids]
    return sweep.run(cases, asked.progress, asked.command)


class Sweep:
    """State of a sweep: known costs, and the remaining time. The runner measures its grids.

    `whole`: a grid is measured anew if any of its cases is missing.
    """

    whole = False

    def __init__(self, runner: GroupRunner):
        self.runner, self.costs = runner, runner.costs
        self.store, self.effort, self.summary = runner.store, runner.effort, runner.summary
        for timing in timings(self.store, self.summary.machine):
            if timing.peer is not None:
                continue
            asked = None if timing.chosen else timing.kernel
            kind = (timing.backend, timing.threads, timing.precision, asked, timing.graphics)
            self.costs[kind] = (timing.particles, timing.median, 0.0)

    def run(self, grids: Sequence[Sequence[Case]], progress: bool, command: str) -> SweepSummary:
        """Measure the grids that the store lacks, one after another."""
        return resume(
            self.store, self.summary, grids, lambda case: self._missing(case) <= 0, self._measure,
            progress=progress, command=command, worth=self._weight, whole=self.whole,
        )  # fmt: skip

    def _measure(self, cases: Sequence[Case], report: Report) -> None:
        grid = cases[0].scene.grid
        report(f"{grid.rows} x {grid.columns} masses", 0)
        self.runner.report = lambda text: report(text, 0)
        for group in self._groups(self._affordable(cases)):
            self.runner.measure(group)
        report(f"{grid.rows} x {grid.columns} masses", sum(map(self._weight, cases)))

    def _missing(self, case: Case) -> int:
        stored = self.store.sample_count(case.description, self.summary.machine, case.sources)
        return self.effort.repeats_of(case) - stored

    def _skip(self, case: Case, reason: str) -> None:
        record_skip(self.store, self.summary, case, reason)

    @cached_property
    def _no_graphics(self) -> str | None:
        """Reason why nothing can be drawn off-screen, or None if it can."""
        try:
            from softlab.app.output.offscreen import opengl_available
        except ImportError as error:
            return f"off-screen drawing cannot be loaded ({error})"
        works, text = opengl_available(text=False)  # frames are timed without a legend
        return None if works else text

    def _weight(self, case: Case) -> float:
        """Return the rough time [s] of a case, for the remaining time in the progress bar."""
        each = max(self.effort.min_seconds, case.particles * case.least_steps * (2e-7 if case.graphics else 2e-9))
        return min(self.effort.max_seconds, (self.effort.repeats_of(case) + 2) * each) + case.particles * 1e-7

    def estimate(self, case: Case) -> float | None:
        """Return the time [s] of all repeats of a case, scaled from the same kind at the last size; None: unknown."""
        known = self.costs.get(case.kind)
        if known is None:
            return None
        particles, seconds, restore = known
        ratio = max(1.0, case.particles / particles)
        sample = max(self.effort.min_seconds, case.least_steps * seconds * ratio)
        return (self._missing(case) + 2) * (sample + restore * ratio)

    def _affordable(self, cases: Sequence[Case]) -> list[Case]:
        """Return the cases that fit into time and memory; record the others as skipped."""
        affordable = []
        effort = self.effort
        spent = time.perf_counter() - self.summary.begin
        left = effort.total_seconds - spent if effort.total_seconds else float("inf")
        for case in cases:
            needed = self.estimate(case)
            if case.graphics and self._no_graphics:
                self._skip(case, f"no off-screen drawing: {self._no_graphics}")
            elif needed is not None and needed > effort.max_seconds:
                self._skip(case, f"estimated to take {needed:.0f} s, over --max-seconds {effort.max_seconds:g}")
            elif (needed or 0.0) > left or left <= 0:
                self._skip(case, f"the sweep's {effort.total_seconds:g} s are used up")
            else:
                left -= needed or 0.0
                affordable.append(case)
        return affordable

    def _groups(self, cases: list[Case]) -> list[list[Case]]:
        """Return groups of cases that are sampled in turn: as many as fit into half of the free memory together."""
        free = available_bytes()
        groups: list[list[Case]] = []
        used, opened = 0, set[Kind]()
        for case in cases:
            needed = 0 if case.simulation_kind in opened else case.host_bytes
            if case.host_bytes > 0.8 * free:
                self._skip(case, f"needs {readable(case.host_bytes)} of main memory, {readable(free)} is free")
                continue
            if not groups or used + needed > free / 2:
                groups.append([])
                used, opened, needed = 0, set(), case.host_bytes
            groups[-1].append(case)
            opened.add(case.simulation_kind)
            used += needed
        return groups
