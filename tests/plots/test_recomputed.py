"""The headline numbers of the book that is built from the committed measurements, computed again from the raw samples by
queries of their own; and that no sentence compares across versions of the code, or rests on marked times in silence."""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from softlab.bench.experiments.accuracy.equal_error import equal_error
from softlab.bench.store.database import Store
from softlab.bench.store.schema import canonical
from softlab.bench.store.transfer import load_text
from softlab.labbook.build import CLAIMS, book_data, committed_data
from softlab.labbook.claims.claim import Claim
from softlab.model.scene.scene import load_scene
from softlab.plots.core.data import Results
from softlab.plots.core.read import load
from softlab.plots.figures import regimes

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
        grid, method = what["scene"].get("grid"), what["scene"]["method"]
        if (
            grid is None
            or what["kernel"] != "auto"
            or what["peer"]
            or what["math"] != "fast"
            or method["integrator"] != "lab"
        ):
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


@dataclass(frozen=True)
class Judged:
    """An accuracy run: `pins` and `side` of a grid, or the kind and the number of masses of a cloth."""

    what: dict[str, Any]
    error: float
    seconds: float
    resolved: bool
    copy: float | None

    @property
    def scene(self) -> dict[str, Any]:
        return self.what["scene"]

    @property
    def method(self) -> dict[str, Any]:
        return self.scene["method"]

    def of(self, catalogue: str) -> bool:
        """Whether it is of a scene of the catalogue, however solved, in fast math."""
        here, there = (
            {k: v for k, v in tables.items() if k not in ("title", "method")}
            for tables in (self.scene, listed(catalogue))
        )
        return here == there and self.what["math"] == "fast"


@cache
def listed(catalogue: str) -> dict[str, Any]:
    return load_scene(catalogue).as_dict()


@cache
def judged() -> tuple[Judged, ...]:
    samples: dict[tuple[str, str], list[tuple[float, str | None]]] = {}
    for key, sources, seconds, steps, suspect in store().query(
        "SELECT configuration, sources, seconds, steps, suspect FROM sample WHERE stage = "
        "(SELECT max(stage) FROM sample WHERE stage IN ('accuracy', 'accuracy runs'))"  # the older stage if there is no other
    ):
        samples.setdefault((key, sources), []).append((seconds / steps, suspect))
    numbers = {
        name: dict(store().query(f"SELECT configuration, value FROM measure WHERE name = '{name}'"))
        for name in ("unresolved", "copy_seconds")
    }
    found = []
    for key, text, error, sources in store().query(
        "SELECT e.configuration, description, e.value, c.sources FROM measure AS e JOIN measure AS c "
        "USING (configuration, run) JOIN configuration ON hash = e.configuration WHERE e.name = 'accuracy_error' "
        "AND c.name = 'seconds_per_simulated_second'"
    ):
        assert any(sources.split("-")[0] in version for version in versions()), "of the version that was measured"
        if error is not None and "end" not in (what := json.loads(text)):
            taken = samples[key, sources]
            clean = [step for step, suspect in taken if not suspect]
            step = statistics.median(clean if len(clean) >= 3 else [step for step, _ in taken])
            seconds = step / what["scene"]["method"]["dt"]
            found.append(
                Judged(what, error, seconds, not numbers["unresolved"].get(key), numbers["copy_seconds"].get(key))
            )
    return tuple(found)


def curtains(side: int) -> list[Judged]:
    """Runs of S1 with so many masses a side."""
    found = [r for r in judged() if r.what["math"] == "fast" and r.scene.get("grid", {}).get("pinned") == "top"]
    return [r for r in found if r.scene["grid"]["rows"] == side == r.scene["grid"]["columns"]]


def least(found: Iterable[Judged], error: float, **wanted: str) -> float:
    """The least cost [s a simulated second] of those that reach an error, of a backend or an integrator."""
    mine = (r for r in found if all((r.what | r.method).get(key) == value for key, value in wanted.items()))
    return min((r.seconds for r in mine if r.error <= error and r.resolved), default=math.inf)


def test_at_equal_error() -> None:
    """The least cost that reaches 1e-3 spacings on each backend."""
    claim = told("equal-error")
    for side, name in ((16, "ratio S1-16"), (32, "ratio"), (64, "ratio S1-64")):
        cpu, gpu = (least(curtains(side), 1e-3, backend=backend) for backend in ("cpu", "gpu"))
        assert claim.numbers[name] == pytest.approx(cpu / gpu, rel=1e-12)


def test_families_and_the_rope_at_equal_error() -> None:
    cloth, rope = ([r for r in judged() if r.of(name)] for name in ("cloth-wind", "rope-stiff"))
    best = least(cloth, 0.1)
    families = {
        "explicit": [r for r in cloth if r.method.get("solver", "mass-spring") == "mass-spring"
                     and not r.method["integrator"].startswith("implicit")],
        "position-based": [r for r in cloth if r.method.get("solver") == "xpbd"],
        "implicit": [r for r in cloth if r.method.get("integrator", "").startswith("implicit")],
    }  # fmt: skip
    ratios = {name: least(mine, 0.1) / best for name, mine in families.items()}
    assert told("families").numbers == pytest.approx({n: r for n, r in ratios.items() if r < math.inf}, rel=1e-12)
    ratio = least(rope, 0.1, backend="cpu") / least(rope, 0.1, backend="gpu")
    assert told("rope").numbers == {"ratio": pytest.approx(ratio, rel=1e-12)}


def test_orders_are_slopes() -> None:
    """Of the CPU's runs in float64 whose error is ten times the reference's own."""
    unresolved = {
        text for text, value in store().query(
            "SELECT description, value FROM measure JOIN configuration ON hash = configuration WHERE name = 'unresolved'"
        ) if value
    }  # fmt: skip
    for name, order in told("orders").numbers.items():
        mine = [
            r for r in curtains(32) if (r.what["backend"], r.what["precision"]) == ("cpu", "float64")
            and r.method.get("integrator") == name and r.method.get("solver", "mass-spring") == "mass-spring"
            and canonical(r.what) not in unresolved and r.error > 0
        ]  # fmt: skip
        x, y = (np.log([pick(r) for r in mine]) for pick in (lambda r: r.method["dt"], lambda r: r.error))
        assert order == pytest.approx(np.polyfit(x, y, 1)[0], rel=1e-9)


def test_who_is_fastest_by_size() -> None:
    for masses, found in regimes.sizes(next(s for s in results().sources if len(regimes.sizes(s)) > 1)).items():
        side = math.isqrt(masses)
        for target in (1e-1, 1e-3, 1e-5):
            (way,) = equal_error(found, [target])
            cpu, gpu = (least(curtains(side), target, backend=backend) for backend in ("cpu", "gpu"))
            assert way.speed_up == pytest.approx(cpu / gpu, rel=1e-12)


def test_no_printed_sentence_rests_on_nothing_but_marked_times_silently() -> None:
    """Every sentence that names a ratio of the sweep's times says `suspect` if all of its kind are."""
    data = book_data(results())
    if all(r.marked for r in raw()):
        assert "suspect" in data["claims"]["overtakes"]
    assert all(Path(path).suffix == ".gz" for path in committed_data())
