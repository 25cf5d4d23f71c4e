"""Results of the hard cases: verdicts read from the store, compared, and printed.

A verdict is `pass`, `fail`, `refused` (with a diagnosis, before or during the run), or `known`: a failure that is
inherent in the method, which no program could avoid. A failure is a bug of this lab, and so is a verdict that differs
between backends.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from softlab.bench.experiments.accuracy.methods import FLUIDS, MATCHING, METHODS, TETRAHEDRAL
from softlab.bench.measure.experiment import Summary
from softlab.bench.store.method_name import name_of
from softlab.bench.store.results import Measure
from softlab.bench.store.schema import tables_by_kind
from softlab.bench.stress.cases import CASES

VERDICT, CHECK, SHAPE = "hard_verdict", "hard_check: ", "hard_shape"  # names of measures; CHECK is a prefix
AIM = "aim <="
CODES = {"fail": 0.0, "pass": 1.0, "refused": 2.0, "known": 3.0}  # verdict -> its value in the store
WORDS = {"pass": "pass", "fail": "FAIL", "refused": "refused", "known": "fails"}
STYLES = {"pass": "green", "fail": "bold red", "refused": "cyan", "known": "yellow"}
TITLES = {case.name: case.title for case in CASES}
SAME = "the same"  # prefix of the title of a variant of the preceding case
BASES = {case.name: case.basis for case in CASES}
BODIES = {case.name for case in CASES if case.of_bodies}
OF_TETRAHEDRA = {case.name for case in CASES if case.of_tetrahedra}
OF_FLUIDS = {case.name for case in CASES if case.of_fluids}
NAMES = (*METHODS, MATCHING, *TETRAHEDRAL[1:], *FLUIDS)
ORDER = {case.name: place for place, case in enumerate(CASES)}


def _in_full() -> Iterator[tuple[str, str]]:
    title = ""
    for case in CASES:
        varied = case.title.startswith(SAME)
        title = title if varied else case.title
        yield case.name, case.title.replace(SAME, title, 1) if varied else title


IN_FULL = dict(_in_full())  # name -> complete title: `mass ratio 1:1000`, `two masses in one place, no rest length`


@dataclass(frozen=True)
class StoredCheck:
    """A check as stored: `bound` as text (`< 1e-09 N`, `aim <= 1.5`), empty if there is none."""

    name: str
    value: float | None
    unit: str
    bound: str

    @property
    def over_aim(self) -> bool:
        """True if the value exceeds a bound that is an aim, and not part of the verdict."""
        return self.bound.startswith(AIM) and (self.value is None or self.value > float(self.bound.split()[2]))

    def __str__(self) -> str:
        value = "not finite" if self.value is None else f"{self.value:.3g} {self.unit}".rstrip()
        return f"{self.name} {value}" + (f" ({self.bound})" if self.bound else "")


@dataclass(frozen=True)
class Shape:
    """End state, thinned for pictures: `position` [m], a list of rows of (x, y) or, in space, (x, y, z).

    `of_bodies`: the rows are the particles of each body, not rows of a sheet.
    """

    position: list[list[tuple[float, ...]]]
    of_bodies: bool = False


@dataclass(frozen=True)
class HardRow:
    """Result of one case by one method (`integrator`: its name), backend and precision.

    `dt` [s]: step size of the run; `verdict`: one of CODES; `diagnosis`: its reason, empty for a plain pass; `checks`:
    the decisive one first; `shape`: of runs that are drawn; `configuration`: the store's key of the run.
    """

    case: str
    integrator: str
    backend: str
    precision: str
    dt: float
    verdict: str
    diagnosis: str
    checks: tuple[StoredCheck, ...]
    shape: Shape | None = None
    configuration: str = ""

    @property
    def title(self) -> str:
        return TITLES.get(self.case, self.case)

    @property
    def in_full(self) -> str:
        """Complete title, also for a case whose `title` refers to the case before it."""
        return IN_FULL.get(self.case, self.case)

    @property
    def basis(self) -> str:
        """Source of the decisive check's bound, in words; empty if the law itself gives it."""
        return BASES.get(self.case, "")

    @property
    def of_bodies(self) -> bool:
        return self.case in BODIES

    @property
    def kind(self) -> str:
        """Kind of the case, `sheet`, `body`, `tetrahedra` or `fluid`; each has a table of its own."""
        kinds = {"body": BODIES, "tetrahedra": OF_TETRAHEDRA, "fluid": OF_FLUIDS}
        return next((kind for kind, names in kinds.items() if self.case in names), "sheet")

    def __str__(self) -> str:
        return f"{self.case}, {self.integrator}, {self.precision}, {self.backend}"


@dataclass
class HardSummary(Summary):
    """Summary of `run_hard`.

    `rows`: all verdicts, with those that the store had before; `ends`: the runs of now whose end state is drawn, with their
    outcomes; `pictures`: number of pictures, `no_pictures`: why there are none.
    """

    rows: list[HardRow] = field(default_factory=list)
    ends: list[Any] = field(default_factory=list, repr=False)
    pictures: int = 0
    no_pictures: str = ""


def rows_of(measures: Iterable[Measure]) -> list[HardRow]:
    """Return the hard cases among the measures of one machine, in the order of the collection and of the integrators."""
    gathered: dict[str, list[Measure]] = {}
    for measure in measures:
        if measure.description.get("hard") is not None and measure.name.startswith("hard_"):
            gathered.setdefault(measure.configuration, []).append(measure)
    rows = [_row(named) for named in gathered.values()]
    names = list(NAMES)
    return sorted(
        (row for row in rows if row is not None),
        key=lambda r: (
            ORDER.get(r.case, len(ORDER)), r.case,
            names.index(r.integrator) if r.integrator in names else len(names), r.backend, r.precision,
        ),
    )  # fmt: skip


def _row(measures: list[Measure]) -> HardRow | None:
    newest = next((m for m in measures if m.name == VERDICT), None)
    verdict = next((word for word, code in CODES.items() if newest and newest.value == code), None)
    if newest is None or verdict is None:
        return None
    # checks of earlier sources belong to another version of the law
    named = [m for m in measures if m.sources == newest.sources]
    description = newest.description
    method = tables_by_kind(description["scene"])["method"]
    checks = [StoredCheck(m.name.removeprefix(CHECK)[3:], m.value, m.unit, m.reason or "")
            for m in sorted(named, key=lambda m: m.name) if m.name.startswith(CHECK)]  # fmt: skip
    shape = next((m.reason for m in named if m.name == SHAPE and m.reason), None)
    bodies = method.get("solver") == MATCHING
    return HardRow(
        case=description["hard"],
        integrator=name_of(method),
        backend=description["backend"],
        precision=description["precision"],
        dt=method["dt"],
        verdict=verdict,
        diagnosis=newest.reason or "",
        checks=tuple(checks),
        shape=Shape([[tuple(place) for place in line] for line in json.loads(shape)], bodies) if shape else None,
        configuration=newest.configuration,
    )


Naming = Callable[[HardRow], str]


def short(row: HardRow) -> str:
    """Return the name of the case, as `softlab hard` lists it."""
    return row.case


def in_full(row: HardRow) -> str:
    """Return its complete title, for a text without the names."""
    return row.in_full


def disagreements(rows: Iterable[HardRow], named: Naming = short) -> list[str]:
    """Return texts on different verdicts of the backends, which are bugs of the lab."""
    return _differing(rows, named, lambda verdicts: verdicts != {"known", "pass"})


def rounding_differences(rows: Iterable[HardRow], named: Naming = short) -> list[str]:
    """Return texts on failures inherent in the method that appear on one backend only.

    In `fast` math the GPU rounds a product and a sum once, the CPU twice, and the loss by rounding depends on that.
    """
    return _differing(rows, named, lambda verdicts: verdicts == {"known", "pass"})


def _differing(rows: Iterable[HardRow], named: Naming, counts: Callable[[set[str]], bool]) -> list[str]:
    groups: dict[tuple[str, str, str], dict[str, str]] = {}
    for row in rows:
        groups.setdefault((named(row), row.integrator, row.precision), {})[row.backend] = row.verdict
    return [
        f"{', '.join(key)}: " + ", ".join(f"{verdict} on the {backend}" for backend, verdict in verdicts.items())
        for key, verdicts in groups.items()
        if len(set(verdicts.values())) > 1 and counts(set(verdicts.values()))
    ]


def failed(summary: HardSummary) -> bool:
    """True if a bug of softlab was detected."""
    return any(row.verdict == "fail" for row in summary.rows) or bool(disagreements(summary.rows))
