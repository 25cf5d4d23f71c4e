"""The headline numbers of the book that is built from the committed measurements, computed again from the raw samples by
queries of their own; and that no sentence compares across versions of the code, or rests on marked times in silence."""

from __future__ import annotations

import json
import statistics
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

from bench.store.database import Store
from bench.store.transfer import load_text
from labbook.build import CLAIMS, book_data, committed_data
from labbook.claims.claim import Claim
from plots.core.data import Results
from plots.core.read import load

SPREAD = 0.1
WITH_GPU = [path for path in committed_data() if "h200" in path.name]


@dataclass(frozen=True)
class Raw:
    """The samples of one configuration, seconds a step; `code`: of its backend's sources; `marked`: suspect."""

    backend: str
    threads: int | None
    rows: int
    columns: int
    precision: str
    graphics: bool
    code: str
    seconds: tuple[float, ...]
    marked: bool

    @property
    def median(self) -> float:
        return statistics.median(self.seconds)


@cache
def results() -> Results:
    return load(store())


def told(name: str) -> Claim:
    return CLAIMS[name](results())


@cache
def raw() -> list[Raw]:
    return list(_raw())


@cache
def store() -> Store:
    return load_text(WITH_GPU)


def _raw() -> Iterator[Raw]:
    """Of the sweep of the hand-out's grid by the kernels that were chosen by themselves."""
    found: dict[tuple[str, str], list[tuple[float, str | None]]] = {}
    for key, sources, seconds, steps, suspect in store().query(
        "SELECT configuration, sources, seconds, steps, suspect FROM sample WHERE stage = 'step'"
    ):
        found.setdefault((key, sources), []).append((seconds / steps, suspect))
    told = {key: json.loads(text) for key, text in store().query("SELECT hash, description FROM configuration")}
    for (key, sources), samples in found.items():
        what = told[key]
        grid, method = what["scene"]["grid"], what["scene"]["method"]
        if what["kernel"] != "auto" or what["peer"] or what["math"] != "fast" or method["integrator"] != "lab":
            continue
        clean = [seconds for seconds, suspect in samples if not suspect]
        taken = clean if len(clean) >= 3 else [seconds for seconds, _ in samples]
        ordered = sorted(taken)
        quarter, last = (statistics.quantiles(ordered, n=4, method="inclusive")[k] for k in (0, 2))
        spread = (last - quarter) / statistics.median(ordered)
        marked = len(clean) < 3 and any(suspect for _, suspect in samples)
        yield Raw(
            what["backend"], what["threads"], grid["rows"], grid["columns"], what["precision"], what["graphics"],
            sources.split("-")[0], tuple(ordered), marked or spread > SPREAD,
        )  # fmt: skip


@cache
def versions() -> set[tuple[str, str]]:
    """(CPU's sources, GPU's sources) that runs name side by side."""
    found = set()
    for (text,) in store().query("SELECT commit_hash FROM run WHERE commit_hash IS NOT NULL"):
        told = dict(word.split(":") for word in text.split() if ":" in word)
        found.add((told["cpu"], told["gpu"]))
    return found


def pairs(graphics: bool = False) -> list[tuple[Raw, Raw]]:
    """(the fastest CPU, the GPU) at every square that both ran, in float32; those of one version of the code."""
    mine = [r for r in raw() if r.precision == "float32" and r.graphics == graphics and r.rows == r.columns]
    both = []
    for gpu in sorted((r for r in mine if r.backend == "gpu"), key=lambda r: r.rows):
        cpus = [r for r in mine if r.backend == "cpu" and r.rows == gpu.rows and (r.code, gpu.code) in versions()]
        if cpus:
            both.append((min(cpus, key=lambda r: r.median), gpu))
    return both


@pytest.mark.parametrize("graphics", [False, True])
def test_the_gpu_against_the_cpu(graphics: bool) -> None:
    claim = told("overtakes-drawing" if graphics else "overtakes")
    clean = [pair for pair in pairs(graphics) if not any(r.marked for r in pair)]
    used = clean or pairs(graphics)
    cpu, gpu = used[-1]
    assert claim.numbers["ratio"] == pytest.approx(cpu.median / gpu.median, rel=1e-12)
    assert claim.numbers["masses"] == gpu.rows * gpu.columns
    assert ("suspect" in claim.sentence) == (not clean)


def test_float64_against_float32() -> None:
    for backend, threads, name in (("cpu", 16, "cpu-float64"), ("gpu", None, "gpu-float64")):
        mine = [
            r for r in raw() if (r.backend, r.threads, r.graphics) == (backend, threads, False) and r.rows == r.columns
        ]
        single, double = ({r.rows: r for r in mine if r.precision == p} for p in ("float32", "float64"))
        both = [n for n in sorted(single) if n in double and single[n].code == double[n].code]
        clean = [n for n in both if not (single[n].marked or double[n].marked)]
        largest = (clean or both)[-1]
        assert told(name).numbers["ratio"] == pytest.approx(double[largest].median / single[largest].median, rel=1e-12)
        assert ("suspect" in told(name).sentence) == (not clean)


def test_more_threads_than_cores() -> None:
    for name, end in (("threads-small", 0), ("threads-large", -1)):
        claim = told(name)
        size = claim.numbers["masses"]
        mine = {
            r.threads: r for r in raw() if r.backend == "cpu" and r.precision == "float32" and not r.graphics
            and r.rows == r.columns and r.rows * r.columns == size
        }  # fmt: skip
        for word, threads in (("2x", 32), ("4x", 64)):
            assert claim.numbers[word] == pytest.approx(mine[threads].median / mine[16].median, rel=1e-12), end


def test_at_equal_error() -> None:
    """The least cost that reaches 1e-3 spacings on each backend, from the measures, and the samples behind it."""
    cost: dict[tuple[int, str], float] = {}
    for side in (16, 32, 64):
        for text, error, seconds, sources in store().query(
            "SELECT description, e.value, c.value, c.sources FROM measure AS e JOIN measure AS c USING (configuration, run) "
            "JOIN configuration ON hash = e.configuration WHERE e.name = 'accuracy_error' "
            "AND c.name = 'seconds_per_simulated_second'"
        ):
            what = json.loads(text)
            grid = what["scene"].get("grid", {})
            if (grid.get("rows"), grid.get("pinned"), what["math"]) != (side, "top", "fast") or error is None:
                continue
            assert any(sources.split("-")[0] in version for version in versions()), "of the version that was measured"
            if error <= 1e-3:
                key = side, what["backend"]
                cost[key] = min(seconds, cost.get(key, float("inf")))
    claim = told("equal-error")
    for side, name in ((16, "ratio S1-16"), (32, "ratio"), (64, "ratio S1-64")):
        if name in claim.numbers:
            assert claim.numbers[name] == pytest.approx(cost[side, "cpu"] / cost[side, "gpu"], rel=1e-12)
    assert "ratio" in claim.numbers


def test_no_printed_sentence_rests_on_nothing_but_marked_times_silently() -> None:
    """Every sentence that names a ratio of the sweep's times says `suspect` if all of its kind are."""
    data = book_data(results())
    if all(r.marked for r in raw()):
        assert "suspect" in data["claims"]["overtakes"]
    assert all(Path(path).suffix == ".gz" for path in committed_data())
