"""What another program costs threads that work together: `softlab busy`.

Every scene on one thread and on one thread a core, sampled in turn (A B A B ...): with the cores to themselves, beside a
program that computes all the time at the lowest priority, and beside one at the same priority. Threads that wait for one
another may lose far more than their share of a core then; what idle threads do (`wait_policy`) is part of every row.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any

from rich.console import Console

from app.driver import open_simulation
from bench.measure.costs_timing import FULL, RATIO, SECONDS, Effort, Measures, Record, in_turn
from bench.measure.costs_timing import QUICK as SHORT
from bench.measure.experiment import described
from bench.measure.items import Group, Items, cost_sources
from bench.measure.timing import Subject, prepare
from bench.store.database import Store
from bench.store.results import Measure, measures
from bench.store.tables import print_table
from cpu_backend.core.threads import core_count
from model.core.errors import SceneError
from model.scene.scene import load_scene

FINDING = "busy"  # value of `finding`
ALONE, NICED, SAME = "alone", "niced", "same"
BESIDE = {ALONE: 0, NICED: 19, SAME: 0}  # what runs beside: the `nice` it gives itself
SCENES = {  # and the kernel, None: the scene's own
    "lab-grid": (None, "fused"), "cloth-hanging": (None,), "cloth-warp": (None,), "cloth-xpbd": (None,),
    "cloth-self": (None,), "cloth-mesh": (None,), "jelly-grid": (None,), "jelly-block": (None,), "soft-pile": (None,),
}  # fmt: skip
QUICK = ("lab-grid", "soft-pile")
LIMIT = 1.5  # threads beside a busy program take at most so much of what one thread takes there

# Ends itself when the process that started it is gone (POSIX), or after an hour.
PROGRAM = """
import os, sys, time
parent, end = os.getppid(), time.monotonic() + 3600
if hasattr(os, "nice"):
    os.nice(int(sys.argv[1]))
print("computing", flush=True)
while os.getppid() == parent and time.monotonic() < end:
    for _ in range(1000000):
        pass
"""


@contextmanager
def beside(kind: str) -> Iterator[subprocess.Popen[str] | None]:
    """A program that computes on a core as long as this lasts; ended and waited for whatever happens. `kind`: of BESIDE."""
    if kind == ALONE:
        yield None
        return
    lowest = getattr(subprocess, "IDLE_PRIORITY_CLASS", 0) if kind == NICED else 0  # Windows knows no nice
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(BESIDE[kind])], stdout=subprocess.PIPE, text=True, creationflags=lowest
    )
    try:
        assert process.stdout is not None
        process.stdout.readline()
        yield process
    finally:
        process.kill()
        process.communicate()


def groups(effort: Effort, scenes: Iterable[str] = tuple(SCENES)) -> list[Group]:
    """Of each scene and kernel, and of what runs beside: (one thread, a thread a core, at least two)."""
    sources = cost_sources("cpu", __file__)
    found = []
    for name in scenes:
        for kernel, kind in product(SCENES[name], BESIDE):
            scene = load_scene(name)
            how = {"precision": "float32", "kernel": kernel or "auto", "shown": name, "beside": kind}
            ways = tuple(
                described(scene, "cpu", FINDING, **how) | {"threads": count} for count in (1, max(2, core_count()))
            )
            found.append(Group(f"{name} {kernel or ''} {kind}", ways, sources, partial(_measure, scene, ways, effort)))
    return found


def _measure(scene: Any, ways: Sequence[dict[str, Any]], effort: Effort, record: Record) -> list[Measures]:
    with ExitStack() as stack:
        subjects = []
        for way in ways:
            kernel = None if way["kernel"] == "auto" else way["kernel"]
            simulation = stack.enter_context(open_simulation(scene, threads=way["threads"], kernel=kernel))
            subjects.append(prepare(Subject(simulation, way), effort.seconds, effort.most))
        for subject in subjects:  # the same steps: bodies that meet take longer than such as fall
            subject.steps = max(s.steps for s in subjects)
        stack.enter_context(beside(ways[0]["beside"]))
        return in_turn(record, subjects, effort.repeats)


def items(store: Store, backends: Sequence[str], quick: bool, scenes: Sequence[str] = ()) -> list[Group]:
    """All; `quick`: two scenes, fewer and shorter samples; `scenes`: these instead. Raises SceneError for one that is not of
    SCENES."""
    for name in scenes:
        if name not in SCENES:
            raise SceneError("--scene", name, f"must be one of {', '.join(SCENES)}")
    return groups(SHORT if quick else FULL, scenes or (QUICK if quick else tuple(SCENES)))


run_busy = Items(FINDING, items, "softlab busy", f"{FINDING}: ")


# ---------------------------------------------------------------------- what the store says


def print_busy(console: Console, store: Store, machine: str) -> None:
    """A table of what was measured on a machine."""
    rows = (
        (
            p.scene, p.kernel, p.beside, p.wait_policy, str(p.threads), f"{1e3 * p.one:.3g}", f"{1e3 * p.many:.3g}",
            f"{p.ratio:.2f}",
        )
        for p in points(measures(store, machine=machine))
    )  # fmt: skip
    heads = "scene", "kernel", "beside", "waiting", "threads", "1 thread / ms", "threads / ms", "ratio"
    below = "ratio: of a step's time on all threads over that on one, in the same company; medians"
    print_table(console, heads, rows, below)


@dataclass(frozen=True)
class BusyPoint:
    """A scene beside a program (`beside`): seconds of a step on one thread and on `threads`, and the median of their ratio
    over the pairs."""

    machine: str
    scene: str
    kernel: str
    beside: str
    wait_policy: str
    threads: int
    one: float
    many: float
    ratio: float


def points(held: Iterable[Measure]) -> list[BusyPoint]:
    """What the measures tell, by scene."""
    told: dict[tuple[str, str, str, str, str], dict[int, dict[str, Measure]]] = {}
    for measure in held:
        description: dict[str, Any] = measure.description
        if description.get("finding") == FINDING and measure.name in (RATIO, SECONDS):
            place = (measure.machine, *(description[key] for key in ("shown", "kernel", "beside", "wait_policy")))
            told.setdefault(place, {}).setdefault(description["threads"], {})[measure.name] = measure
    found = []
    for place, by_threads in told.items():
        most = max(by_threads)
        if most == 1 or 1 not in by_threads or RATIO not in by_threads[most]:
            continue
        one, many = by_threads[1][SECONDS].value, by_threads[most][SECONDS].value
        ratio = by_threads[most][RATIO].value
        if one is not None and many is not None and ratio is not None:
            found.append(BusyPoint(*place, most, one, many, ratio))
    order = list(BESIDE)
    return sorted(found, key=lambda p: (p.machine, p.scene, p.kernel, order.index(p.beside)))
