"""`softlab busy`: how much another program slows down threads that work together.

Every scene runs on one thread and on one thread per core, sampled in turn (A B A B ...): alone, next to a program that
computes all the time at the lowest priority, and next to one at the same priority. Threads that wait for each other may
lose far more than their part of a core then. The behaviour of idle threads (`wait_policy`) is part of every row.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import product

from softlab.app.driver import open_simulation
from softlab.bench.measure.costs_timing import FULL, RATIO, SECONDS, Effort, Measures, Record, in_turn
from softlab.bench.measure.costs_timing import QUICK as SHORT
from softlab.bench.measure.declaration import Option
from softlab.bench.measure.experiment import described
from softlab.bench.measure.items import Group, Items, cost_sources
from softlab.bench.measure.timing import Subject, prepare
from softlab.bench.store.database import Store
from softlab.bench.store.results import Measure
from softlab.bench.store.schema import Description
from softlab.cpu_backend.core.threads import core_count
from softlab.model.scene.scene import Scene, load_scene

FINDING = "busy"  # value of `finding`
ALONE, NICED, SAME = "alone", "niced", "same"
BESIDE = {ALONE: 0, NICED: 19, SAME: 0}  # kind of program -> its `nice` value
SCENES = {  # scene -> kernels; None: the scene's own
    "lab-grid": (None, "fused"), "cloth-hanging": (None,), "cloth-warp": (None,), "cloth-xpbd": (None,),
    "cloth-self": (None,), "cloth-mesh": (None,), "jelly-grid": (None,), "jelly-block": (None,), "soft-pile": (None,),
}  # fmt: skip
QUICK = ("lab-grid", "soft-pile")
LIMIT = 1.5  # largest ratio of the time of threads to that of one thread, next to a busy program

# The program ends when the process that started it is gone (POSIX), or after an hour.
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
    """Run a program that occupies a core inside this context; it is always killed and reaped. `kind`: a key of BESIDE."""
    if kind == ALONE:
        yield None
        return
    lowest = getattr(subprocess, "IDLE_PRIORITY_CLASS", 0) if kind == NICED else 0  # Windows has no nice
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
    """Return a group for each scene, kernel and kind of program: (one thread, a thread per core, at least two)."""
    sources = cost_sources("cpu", [__file__])
    all_groups = []
    for name in scenes:
        for kernel, kind in product(SCENES[name], BESIDE):
            scene = load_scene(name)
            how = {"precision": "float32", "kernel": kernel or "auto", "shown": name, "beside": kind}
            descriptions = tuple(
                described(scene, "cpu", FINDING, **how) | {"threads": count} for count in (1, max(2, core_count()))
            )
            run = partial(_measure, scene, descriptions, effort)
            all_groups.append(Group(f"{name} {kernel or ''} {kind}", descriptions, sources, run))
    return all_groups


def _measure(scene: Scene, descriptions: Sequence[Description], effort: Effort, record: Record) -> list[Measures]:
    with ExitStack() as stack:
        subjects = []
        for description in descriptions:
            kernel = None if description["kernel"] == "auto" else description["kernel"]
            simulation = stack.enter_context(open_simulation(scene, threads=description["threads"], kernel=kernel))
            subjects.append(prepare(Subject(simulation, description), effort.seconds, effort.most))
        for subject in subjects:  # the same steps for all: bodies in contact take longer than falling ones
            subject.steps = max(s.steps for s in subjects)
        stack.enter_context(beside(descriptions[0]["beside"]))
        return in_turn(record, subjects, effort.repeats)


# ---------------------------------------------------------------------- results from the store


@dataclass(frozen=True)
class BusyPoint:
    """A scene next to a program (`beside`): seconds per step on one thread and on `threads`, and their ratio.

    The ratio is the median over the pairs of samples.
    """

    machine: str
    scene: str
    kernel: str
    beside: str
    wait_policy: str
    threads: int
    one: float
    many: float
    ratio: float


def points(stored: Iterable[Measure]) -> list[BusyPoint]:
    """Return the points from the measures, by scene."""
    by_place: dict[tuple[str, str, str, str, str], dict[int, dict[str, Measure]]] = {}
    for measure in stored:
        description: Description = measure.description
        if description.get("finding") == FINDING and measure.name in (RATIO, SECONDS):
            place = (measure.machine, *(description[key] for key in ("shown", "kernel", "beside", "wait_policy")))
            by_place.setdefault(place, {}).setdefault(description["threads"], {})[measure.name] = measure
    busy_points = []
    for place, by_threads in by_place.items():
        most = max(by_threads)
        if most == 1 or 1 not in by_threads or RATIO not in by_threads[most]:
            continue
        one, many = by_threads[1][SECONDS].value, by_threads[most][SECONDS].value
        ratio = by_threads[most][RATIO].value
        if one is not None and many is not None and ratio is not None:
            busy_points.append(BusyPoint(*place, most, one, many, ratio))
    order = list(BESIDE)
    return sorted(busy_points, key=lambda p: (p.machine, p.scene, p.kernel, order.index(p.beside)))


class Busy(Items):
    """Measure how much another program on the machine slows down CPU threads."""

    name = command = FINDING
    doing = f"{FINDING}: "
    example = "softlab busy --quick   (softlab busy --scene soft-pile)"
    quick_help = "Two scenes, fewer and shorter samples."
    in_lab, on_backends = True, False
    options = {"scenes": Option("--scene", "Only this scene. Repeatable.", values=tuple(SCENES), quick=QUICK)}
    table = {
        "scene": "scene", "kernel": "kernel", "beside": "beside", "waiting": "wait_policy", "threads": "threads",
        "1 thread / ms": lambda point: f"{1e3 * point.one:.3g}", "threads / ms": lambda point: f"{1e3 * point.many:.3g}",
        "ratio": lambda point: f"{point.ratio:.2f}",
    }  # fmt: skip
    note = "ratio: of a step's time on all threads over that on one, in the same company; medians"

    def items(self, store: Store, backends: Sequence[str], quick: bool, scenes: Sequence[str]) -> list[Group]:
        """Return a group for each scene, kernel and kind of program; `quick`: fewer and shorter samples."""
        return groups(SHORT if quick else FULL, scenes)

    def rows(self, stored: Iterable[Measure], every: bool = False) -> list[BusyPoint]:
        return points(stored)
