"""The committed measurements as they lie in the text exports, read without any module of the lab."""

from __future__ import annotations

import csv
import gzip
import statistics
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

DATA = Path(__file__).parents[2] / "labbook" / "data"
ENDS = {"S1": 1.5, "S4": 1.0, "S5": 0.5, "S6": 1.0, "S6-still": 12.0}  # s: when errors are judged
Row = dict[str, str]


@dataclass(frozen=True)
class Export:
    """The tables of one file: rows by name of column; configurations without their empty columns."""

    tables: dict[str, list[Row]]
    configurations: dict[str, Row]
    machine_of: dict[str, str]  # run -> machine
    started: dict[str, str]  # run -> time

    @property
    def labels(self) -> dict[str, str]:
        """Machine -> `Intel Xeon, 16 cores; NVIDIA H200`."""
        return {row["key"]: row["label"] for row in self.tables["machine"]}

    def newest(self, table: str) -> list[Row]:
        """The rows of a table, in the order of their runs."""
        return sorted(self.tables[table], key=lambda row: self.started[row["run"]])


@cache
def exports() -> tuple[Export, ...]:
    return tuple(_read(path) for path in sorted(DATA.glob("*.csv.gz")))


def _read(path: Path) -> Export:
    heads: dict[str, list[str]] = {}
    tables: dict[str, list[Row]] = defaultdict(list)
    with gzip.open(path, "rt", encoding="utf-8", newline="") as file:
        for name, *cells in csv.reader(file):
            if name.endswith(":"):
                heads[name[:-1]] = cells
            elif name in heads:
                tables[name].append(dict(zip(heads[name], cells, strict=True)))
    known = {row["hash"]: {key: value for key, value in row.items() if value} for row in tables["configuration"]}
    runs = tables["run"]
    return Export(tables, known, {r["key"]: r["machine"] for r in runs}, {r["key"]: r["started"] for r in runs})


def numbers(export: Export, name: str) -> dict[tuple[str, str], float]:
    """(machine, configuration) -> the newest value of a measure."""
    rows = (row for row in export.newest("measure") if row["name"] == name)
    return {
        (export.machine_of[r["run"]], r["configuration"]): float(r["value"]) if r["value"] else float("nan")
        for r in rows
    }


def samples(export: Export, stage: str) -> dict[tuple[str, str], tuple[list[float], str, bool]]:
    """(machine, configuration) -> (seconds a step, digest of the sources, whether only marked ones are left).

    Of the version that most configurations of a backend are of; marked samples do not count beside three clean ones.
    """
    taken: dict[tuple[str, str], dict[str, list[tuple[float, bool]]]] = defaultdict(dict)
    for row in (row for row in export.newest("sample") if row["stage"] == stage):
        key, code = (export.machine_of[row["run"]], row["configuration"]), row["sources"].partition("-")[0]
        before = taken[key].pop(code, [])
        steps = [float(seconds) / int(row["steps"]) for seconds in row["seconds"].split()]
        taken[key][code] = before + [(step, bool(row["suspect"])) for step in steps]
    versions: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    for (machine, what), by_code in taken.items():
        versions[machine, export.configurations[what]["backend"]][list(by_code)[-1]] += 1
    found = {}
    for (machine, what), by_code in taken.items():
        code, steps = list(by_code.items())[-1]
        if code == versions[machine, export.configurations[what]["backend"]].most_common(1)[0][0]:
            clean = [step for step, marked in steps if not marked]
            few = len(clean) < 3
            found[machine, what] = ([step for step, _ in steps] if few else clean, code, few)
    return found


@dataclass(frozen=True)
class Run:
    """A timed accuracy run: `second` [s] of wall time per simulated second; `whole` [s] with the copy of the end state."""

    machine: str
    label: str
    masses: int
    what: Row
    error: float
    resolved: bool
    second: float
    copy: float | None

    @property
    def whole(self) -> float | None:
        return None if self.copy is None else self.second * ENDS[self.label] + self.copy

    @property
    def method(self) -> str:
        if self.what["scene.method.solver"] != "xpbd":
            return self.what["scene.method.integrator"]
        order, many = self.what["scene.method.ordering"], int(self.what["scene.method.iterations"])
        wrong = " (to another stiffness)" if order == "averaged-jacobi" else ""
        return f"xpbd {order}{wrong}, {many} iteration{'s' if many > 1 else ''}"

    @property
    def name(self) -> tuple[str, float, str, str]:
        return self.method, float(self.what["scene.method.dt"]), self.what["backend"], self.what["precision"]


def scene_of(what: Row) -> str | None:
    """The label of an accuracy scene, by the parts that only it has; None for any other."""
    if what.get("scene.grid.pinned"):
        return "S1" if what["scene.grid.pinned"] == "top" else None
    if what.get("scene.end.mass"):
        return "S6-still" if what.get("scene.damping.coefficient") else "S6"
    return "S4" if what.get("scene.wind.lift") else "S5" if what.get("scene.sphere.radius") else None


@cache
def runs() -> tuple[Run, ...]:
    return tuple(run for export in exports() for run in _runs(export))


def _runs(export: Export) -> Iterator[Run]:
    errors, unresolved, copies = (numbers(export, n) for n in ("accuracy_error", "unresolved", "copy_seconds"))
    whole, older = samples(export, "accuracy runs"), samples(export, "accuracy")
    anew = {machine for machine, _ in whole}
    for key, (steps, _, _) in (whole | {k: v for k, v in older.items() if k[0] not in anew}).items():
        what = export.configurations[key[1]]
        label = scene_of(what)
        if label and "end" not in what and key in errors:
            sheet = "grid" if what.get("scene.grid.rows") else "cloth"
            masses = int(what[f"scene.{sheet}.rows"]) * int(what[f"scene.{sheet}.columns"])
            second = statistics.median(steps) / float(what["scene.method.dt"])
            yield Run(key[0], label, masses, what, errors[key], not unresolved.get(key), second, copies.get(key))
