"""Summaries of the store as queries, for figures, the lab book and the terminal.

`Store` itself is in bench/store/database.py; reading and writing text exports in bench/store/transfer.py.

>>> from softlab.bench.store.results import open_readonly, timings
>>> with open_readonly("softlab-results/results.sqlite") as store:
...     for timing in timings(store):
...         print(timing.particles, timing.median, timing.error)
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from softlab.bench.store.database import DEFAULT_PATH, Store
from softlab.bench.store.method_name import name_of
from softlab.bench.store.schema import Description, Row, canonical, configuration_hash, tables_by_kind
from softlab.model.base.errors import SoftlabError
from softlab.model.base.table import Table
from softlab.model.core.families import scene_plan
from softlab.model.scene.scene import Scene

SPREAD_LIMIT = 0.10  # a larger spread of the repeats makes a timing suspect
ENOUGH = 3  # undisturbed samples of a configuration, beside which disturbed ones do not count
NOTES = ("error", "kernel")  # measures that are reported with a timing
ITEM_BYTES = {"float32": 4, "float64": 8}


def configuration(
    scene: Scene,
    *,
    backend: str,
    kernel: str = "auto",
    threads: int | None = None,
    layer: str | None = None,
    wait_policy: str | None = None,
    precision: str = "float32",
    math: str = "fast",
    graphics: bool = False,
    peer: str | None = None,
) -> Description:
    """Return the description of a configuration: the resolved scene and the options of its run.

    `kernel` as requested (`auto`: the backend's choice, which the measure `kernel` then names). `threads`, `layer`,
    `wait_policy`: None on the GPU. `graphics`: with off-screen drawing. `peer`: another program, None for this lab's.
    """
    return {
        "scene": json.loads(scene.canonical()),
        "backend": backend,
        "kernel": kernel,
        "threads": threads,
        "layer": layer,
        "wait_policy": wait_policy,
        "precision": precision,
        "math": math,
        "graphics": graphics,
        "peer": peer,
    }


@dataclass(frozen=True)
class Machine:
    """`label` is fit for captions; `record` as bench/measure/machine.py wrote it (cores, cpu, copy_bandwidth, gpu, ...)."""

    key: str
    label: str
    record: dict[str, Any]


@dataclass(frozen=True)
class Timing:
    """All repeats of one configuration, stage and machine, of the newest sources that were measured.

    `seconds_per_step`: one per sample [s]; of stages without steps (compile) the plain seconds. `median`, `low`, `high`
    (least and most) [s] a step; `spread`: (75th - 25th percentile) / median; `sessions`: the runs that samples are of.
    `suspect`: reasons, empty where there are none. `error` in units of the spacing, None with `error_reason`; with a
    value, `error_reason` is its origin. `kernel`: the one that ran; `chosen`: by the backend itself, not forced.
    `thread_word`: 1x, 2x, 4x of the machine's cores or the number; None on the GPU. `bytes_per_step`: bytes that one
    fused pass over the state moves. `joules_per_step`: median [J], None where the machine has no counter. `graphics`
    timings hold stepping and drawing together; the cost of drawing is the difference to the same timing without
    graphics.
    """

    machine: str
    configuration: str
    sources: str
    backend: str
    kernel: str
    chosen: bool
    threads: int | None
    thread_word: str | None
    layer: str | None
    wait_policy: str | None
    precision: str
    math: str
    graphics: bool
    peer: str | None
    rows: int
    columns: int
    particles: int
    integrator: str
    dt: float
    stage: str
    steps: int
    seconds_per_step: list[float]
    median: float
    low: float
    high: float
    spread: float
    count: int
    suspect: tuple[str, ...]
    error: float | None
    error_reason: str | None
    bytes_per_step: float | None
    joules_per_step: float | None
    sessions: int = 1


@dataclass(frozen=True)
class Measure:
    """One number of one configuration on one machine, the newest of the newest sources. `description`: the whole
    configuration, as `configuration()` makes it. `value` None: there is none, for the `reason`."""

    machine: str
    configuration: str
    sources: str
    run: str
    description: Description
    name: str
    value: float | None
    unit: str
    reason: str | None

    @property
    def backend(self) -> str:
        return self.description["backend"]


def open_readonly(path: str | Path = DEFAULT_PATH) -> Store:
    """Open a .sqlite file, or a .csv or .csv.gz export (in memory), as a store to read from. Raises InputError."""
    from softlab.bench.store.text import is_text
    from softlab.bench.store.transfer import load_text

    if is_text(path):
        return load_text([path])
    return Store(path, readonly=True)


def machines(store: Store) -> list[Machine]:
    """Every machine in the store, in the order they were entered."""
    rows = store.query("SELECT key, label, record FROM machine ORDER BY rowid")
    return [Machine(key, label, json.loads(record)) for key, label, record in rows]


def measures(store: Store, name: str | None = None, machine: str | None = None) -> list[Measure]:
    """Return the measures in the store, of one name or machine (a key) or of all.

    A configuration that was measured repeatedly on a machine has the newest run's value.
    """
    rows = store.query(
        "SELECT run.machine, measure.configuration, sources, run.key, description, name, value, unit, reason "
        "FROM measure JOIN run ON run.key = measure.run JOIN configuration ON hash = measure.configuration "
        "WHERE (:name IS NULL OR name = :name) AND (:machine IS NULL OR run.machine = :machine) "
        "ORDER BY run.started, run.rowid",
        {"name": name, "machine": machine},
    )
    newest: dict[tuple[str, str, str], Measure] = {}
    descriptions: dict[str, Description] = {}  # read once, shared by the measures of a configuration
    for owner, key, sources, run, text, measure, value, unit, reason in rows:
        description = descriptions.get(key) or descriptions.setdefault(key, json.loads(text))
        newest.pop((owner, key, measure), None)  # so that the order, too, is that of the newest
        newest[owner, key, measure] = Measure(owner, key, sources, run, description, measure, value, unit, reason)
    return list(newest.values())


def measures_of(store: Store, machine: str, descriptions: Iterable[Description]) -> list[Measure]:
    """Return the measures of these configurations on a machine."""
    wanted = set(map(configuration_hash, descriptions))
    return [measure for measure in measures(store, machine=machine) if measure.configuration in wanted]


def by_configuration(stored: Iterable[Measure]) -> list[dict[str, Measure]]:
    """Return the measures of each configuration on each machine, by name."""
    named: dict[tuple[str, str], dict[str, Measure]] = {}
    for measure in stored:
        named.setdefault((measure.machine, measure.configuration), {})[measure.name] = measure
    return list(named.values())


@dataclass(frozen=True)
class Result:
    """The measures of one configuration of a finding on one machine, by name."""

    measures: dict[str, Measure]

    @property
    def description(self) -> Description:
        return next(iter(self.measures.values())).description

    @property
    def tables(self) -> dict[str, Any]:
        """The tables of its scene by their kind."""
        return tables_by_kind(self.description["scene"])

    @property
    def values(self) -> dict[str, float]:
        return {name: one.value for name, one in self.measures.items() if one.value is not None}

    def is_suspect(self, name: str) -> bool:
        """True if the samples of a measure are doubtful."""
        return "; " in (self.measures[name].reason or "")


def results_of(stored: Iterable[Measure], finding: str, backend: str | None = None) -> list[Result]:
    """Return the results of a finding (on a backend)."""
    chosen = (m for m in stored if m.description.get("finding") == finding and backend in (None, m.backend))
    return [Result(measures) for measures in by_configuration(chosen)]


def timings(store: Store, machine: str | None = None, stage: str | None = "step") -> list[Timing]:
    """Return the timings in the store, of one machine (a key) or all, of one stage (None: all), smallest grids first.

    A configuration that was measured with several sources has those measured last. Marked samples are left out where there
    are ENOUGH others.
    """
    rows = store.query(
        "SELECT run.machine, sample.configuration, stage, sources, run.key, seconds, steps, joules, suspect "
        "FROM sample JOIN run ON run.key = sample.run "
        "WHERE (:machine IS NULL OR run.machine = :machine) AND (:stage IS NULL OR stage = :stage) "
        "ORDER BY run.started, run.rowid, sample.rowid",
        {"machine": machine, "stage": stage},
    )
    groups: dict[tuple[str, str, str], dict[str, list[Row]]] = {}
    for owner, key, stage_name, sources, *sample in rows:
        of_sources = groups.setdefault((owner, key, stage_name), {})
        of_sources[sources] = [*of_sources.pop(sources, []), tuple(sample)]  # the newest sources end up last
    descriptions = {key: json.loads(text) for key, text in store.query("SELECT hash, description FROM configuration")}
    cores = {entry.key: entry.record.get("cores") for entry in machines(store)}
    notes = {(m.machine, m.configuration, name): m for name in NOTES for m in measures(store, name, machine)}
    result = []
    for (owner, key, stage_name), of_sources in groups.items():
        sources, samples = list(of_sources.items())[-1]
        clean = [sample for sample in samples if not sample[-1]]
        samples = clean if len(clean) >= ENOUGH else samples
        error, kernel = (notes.get((owner, key, name)) for name in NOTES)
        result.append(
            _timing((owner, key, stage_name, sources), samples, descriptions[key], cores.get(owner), error, kernel)
        )
    result.sort(key=lambda timing: (timing.particles, timing.rows))
    return result


def _timing(
    identity: tuple[str, str, str, str],
    samples: list[Row],
    description: Description,
    cores: int | None,
    error: Measure | None,
    kernel: Measure | None,
) -> Timing:
    owner, key, stage, sources = identity
    per_step = [seconds / (steps or 1) for _, seconds, steps, _, _ in samples]
    median = float(np.median(per_step))
    quarter, three_quarters = np.percentile(per_step, (25, 75))
    spread = float((three_quarters - quarter) / median) if median > 0 else 0.0
    suspect = list(dict.fromkeys(reason for *_, reason in samples if reason))
    if spread > SPREAD_LIMIT and stage != "compile":
        suspect.append(f"spread {spread:.0%}")
    joules = [joule / (steps or 1) for _, _, steps, joule, _ in samples if joule is not None]
    scene = description["scene"]
    grid, method, bytes_per_particle = _facts(canonical(scene), description["precision"])
    current = error is not None and error.sources == sources
    return Timing(
        machine=owner,
        configuration=key,
        sources=sources,
        **{
            name: description[name]
            for name in ("backend", "threads", "layer", "wait_policy", "precision", "math", "graphics", "peer")
        },
        kernel=kernel.reason or "auto" if kernel and description["kernel"] == "auto" else description["kernel"],
        chosen=description["kernel"] == "auto",
        thread_word=_thread_word(description["threads"], cores),
        rows=grid["rows"],
        columns=grid["columns"],
        particles=grid["rows"] * grid["columns"],
        integrator=name_of(method) if "solver" in method else method["integrator"],
        dt=method["dt"],
        stage=stage,
        steps=samples[-1][2],
        seconds_per_step=per_step,
        median=median,
        low=min(per_step),
        high=max(per_step),
        spread=spread,
        count=len(per_step),
        suspect=tuple(suspect),
        error=error.value if error and current else None,
        error_reason=error.reason if error and current else "not checked with these sources",
        bytes_per_step=bytes_per_particle and bytes_per_particle * grid["rows"] * grid["columns"],
        joules_per_step=float(np.median(joules)) if joules else None,
        sessions=len({run for run, *_ in samples}),
    )


def _thread_word(threads: int | None, cores: int | None) -> str | None:
    if threads is None:
        return None
    words = {cores: "1x", 2 * cores: "2x", 4 * cores: "4x"} if cores else {}
    return words.get(threads, str(threads))


@lru_cache(maxsize=4096)
def _facts(scene_text: str, precision: str) -> tuple[Table, Table, int | None]:
    """Return the grid, the method and the bytes per particle and step of a scene in the store."""
    data = json.loads(scene_text)
    kinds = tables_by_kind(data)
    grid = {"rows": 0, "columns": 0} | kinds.get("grid", {})
    method = {"integrator": "", "dt": 0.0} | kinds.get("method", {})
    try:
        return grid, method, scene_plan(Scene.stored(data)).bytes(ITEM_BYTES[precision])
    except (SoftlabError, KeyError):  # a scene of another lab version: its times stay readable
        return grid, method, None
