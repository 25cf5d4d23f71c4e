"""Reading of stores and text exports: the measurements of each machine, of one version of the code each."""

from __future__ import annotations

import gc
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

from softlab.bench.experiments.accuracy.experiment import OLDER_STAGE
from softlab.bench.experiments.accuracy.experiment import STAGE as ACCURACY_STAGE
from softlab.bench.experiments.registry import experiments
from softlab.bench.measure.case_timing import FINDINGS, Rates
from softlab.bench.measure.energy import STAGE as ENERGY_STAGE
from softlab.bench.peers.results import ratios
from softlab.bench.store.database import Store
from softlab.bench.store.results import Timing, machines, measures, open_readonly, timings
from softlab.bench.store.schema import Description, canonical
from softlab.bench.store.versions import of_one_version, read_version
from softlab.model.base.table import Table
from softlab.plots.core.data import Origin, Results, Run, Source
from softlab.plots.core.older import older_peers, same_kernels, with_older

SIMULATOR = "CUDA simulator"  # in a suspect mark: not a time of a GPU
OTHER_INTERVAL = "timed over a longer interval than that of the error"  # a mark of an accuracy time
STAGES = (ACCURACY_STAGE, ENERGY_STAGE, FINDINGS)
RATES = tuple((one.step, one.rate, one.kernel) for one in experiments() if isinstance(one, Rates))


@contextmanager
def uncollected() -> Iterator[None]:
    """Disable garbage collection while 100 000 permanent small tables are made: it would take a third of the time."""
    wanted = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if wanted:
            gc.enable()


def load(users: Origin | Sequence[Origin] | None, committed: Iterable[str | Path] = ()) -> Results:
    """Read the user's own store(s) (None: there are none) and the committed text exports. Raises InputError."""
    origins: list[Origin] = [] if users is None else [users] if isinstance(users, Store | str | Path) else list(users)
    sources: list[Source] = []
    with uncollected(), ExitStack() as stack:
        for origin in origins:
            store = origin if isinstance(origin, Store) else stack.enter_context(open_readonly(origin))
            sources += _sources(store, by_user=True)
        for path in committed:
            sources += _sources(stack.enter_context(open_readonly(path)), by_user=False)
    sources.sort(key=lambda source: (not source.by_user, not source.has_gpu_times))
    alone = not any(source.by_user for source in sources)
    return Results(tuple(replace(source, alone=alone) for source in _with_letters(sources)))


def _with_letters(sources: list[Source]) -> list[Source]:
    """Return the sources with a letter in the names of machines with equal names: `AMD EPYC A, 2 cores`."""
    keys: dict[tuple[bool, str], list[str]] = {}
    for source in sources:
        named = keys.setdefault((source.by_user, source.machine.label), [])
        if source.machine.key not in named:
            named.append(source.machine.key)
    lettered = []
    for source in sources:
        named = keys[source.by_user, source.machine.label]
        if len(named) > 1:
            processor, *rest = source.machine.label.split(",")
            letter = chr(ord("A") + named.index(source.machine.key))
            label = ",".join((f"{processor} {letter}", *rest))
            source = replace(source, machine=replace(source.machine, label=label))
        lettered.append(source)
    return lettered


def _sources(store: Store, by_user: bool) -> list[Source]:
    """Return the measurements of each machine in a store."""
    descriptions = {key: json.loads(text) for key, text in store.query("SELECT hash, description FROM configuration")}
    result = []
    for machine in machines(store):
        everything = [
            timing
            for timing in timings(store, machine.key)
            if timing.peer is None and not any(SIMULATOR in mark for mark in timing.suspect)
        ]
        simulated = machine.record.get("gpu_count") is None
        numbers = [
            m
            for m in measures(store, machine=machine.key)
            if not (simulated and m.description["backend"] == "gpu") and _is_shown(m.description)
        ]
        runs = tuple(
            Run(read_version(version), started, command)
            for version, started, command in store.query(
                "SELECT commit_hash, started, command FROM run WHERE machine = ? ORDER BY started, rowid",
                (machine.key,),
            )
        )
        versions = [run.version for run in runs]
        scene, everything = _one_family(everything, descriptions)
        threading, everything = _one_threading(everything)
        of_stages = [[t for t in everything if t.chosen], [t for t in everything if not t.chosen]] + [
            [t for t in _of_stage(store, machine.key, stage) if not any(SIMULATOR in mark for mark in t.suspect)]
            for stage in STAGES
        ]
        same = same_kernels(numbers)
        current = [of_one_version(times, versions, by_user, same) for times in of_stages]
        of_rates = [[m for m in numbers if m.name in names] for names in RATES]
        dropped = {id(m) for rates in of_rates for m in rates}
        dropped -= {id(m) for rates in of_rates for m in of_one_version(rates, versions, by_user, same)}
        numbers = [m for m in numbers if id(m) not in dropped]
        times, forced, costs, energies, findings = current
        defaults = {m.configuration: bool(m.value) for m in numbers if m.name == "default"}
        peers = tuple(ratios(store, machine.key))
        if everything or numbers or peers:
            source = Source(
                machine, by_user, tuple(times), tuple(numbers), runs, scene, threading,
                {timing.configuration: timing for timing in costs}, tuple(forced),
                {timing.configuration: timing for timing in energies}, defaults, peers, tuple(findings),
                sum(map(len, of_stages)) - sum(map(len, current)) + len(dropped), older_peers=older_peers(store, machine.key),
            )  # fmt: skip
            result.append(with_older(source))
    return sorted(result, key=lambda source: source.runs[-1].started if source.runs else "", reverse=True)


def _of_stage(store: Store, machine: str, stage: str) -> list[Timing]:
    """Return the timings of a stage; of accuracy runs on a machine without whole runs the older ones, marked."""
    of_stage = timings(store, machine, stage)
    if of_stage or stage != ACCURACY_STAGE:
        return of_stage
    return [replace(t, suspect=(*t.suspect, OTHER_INTERVAL)) for t in timings(store, machine, OLDER_STAGE)]


def _is_shown(description: Description) -> bool:
    """True for the lab's own configurations and findings; `ratios` handles those of a sweep with peers."""
    return description.get("peer") is None or "finding" in description


def _one_family(times: list[Timing], descriptions: dict[str, Description]) -> tuple[Table, list[Timing]]:
    """Return the timings of the scene that was swept over most sizes: scenes timed at one size are no curve."""

    def family(timing: Timing) -> str:
        scene = json.loads(canonical(descriptions[timing.configuration]["scene"]))
        for table in scene.values():
            if isinstance(table, dict) and "rows" in table:
                del table["rows"], table["columns"]
        return canonical(scene | {"math": descriptions[timing.configuration]["math"]})

    sizes: dict[str, set[tuple[int, int]]] = {}
    for timing in times:
        sizes.setdefault(family(timing), set()).add((timing.rows, timing.columns))
    if not sizes:
        return {}, []
    chosen = max(sizes, key=lambda key: len(sizes[key]))
    scene = json.loads(chosen)
    scene.pop("math")
    return scene, [timing for timing in times if family(timing) == chosen]


def _one_threading(times: list[Timing]) -> tuple[tuple[str | None, str | None], list[Timing]]:
    """Return the timings of the most frequent threading layer and wait policy, which must not mix in a curve."""
    count = Counter((timing.layer, timing.wait_policy) for timing in times if timing.backend == "cpu")
    if not count:
        return (None, None), times
    (chosen, _), *_ = count.most_common(1)
    return chosen, [t for t in times if t.backend != "cpu" or (t.layer, t.wait_policy) == chosen]
