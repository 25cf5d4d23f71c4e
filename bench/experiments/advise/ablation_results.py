"""Results of `softlab ablate`: a verdict on each change, as a table and as one sentence."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

from softlab.bench.experiments.accuracy.judgement import RESOLVED
from softlab.bench.experiments.advise.ablation import ARITHMETIC, COARSER, FINER, FULL, INTEGRATOR, PART
from softlab.bench.experiments.advise.budgets import NOISE
from softlab.bench.experiments.advise.search import FLOOR
from softlab.bench.experiments.growth import MAX_GROWTH, growth_words
from softlab.bench.measure.experiment import Summary
from softlab.bench.reference.cache import TOLERANCE
from softlab.bench.store.method_name import name_of
from softlab.bench.store.results import Measure
from softlab.bench.store.schema import Description, tables_by_kind

PREFIX = "ablation_"
# spacings: root mean square over the free masses, to the end state of the full scene's own run
CHANGE = "ablation_change"
SECONDS = "ablation_seconds"  # s of wall time per simulated second, the minimum of the repeats
SUSPECT = "ablation_suspect"
NEEDED, NOT_NEEDED, UNTOLD, GAINS = "needed", "not needed", "unknown", "finer"  # verdicts on what was left out
REPLACED = {NEEDED: "not enough", NOT_NEEDED: "enough"}  # the same verdicts, on the replacement
FINER_STEP = {GAINS: "more accurate", NOT_NEEDED: "gains nothing"}
WIDE = 100  # columns; wider terminals show the reasons
STYLES = {NEEDED: "bold", NOT_NEEDED: "green", UNTOLD: "yellow", GAINS: "cyan"}


@dataclass(frozen=True)
class AblationRow:
    """Result of one change.

    `name`, `kind`, `spares`: as in `Ablation`; `why`: as there, or how the run diverged. `error` [spacings]: root mean
    square over the free masses, against the full scene's converged reference, infinite if the run diverged or the
    motion is chaotic. `change` [spacings]: distance to the full scene's own run. `estimate` [spacings]: the reference's
    own error. `growth`: factor of a disturbance. `energy_off` [J], `mean_off` [spacings]: energy and centre of mass
    minus the reference's. `seconds`: wall time per simulated second, None if the run diverged. `suspect`: why that time
    may be wrong.
    """

    name: str
    kind: str
    spares: str
    why: str
    error: float
    change: float
    estimate: float
    growth: float
    energy_off: float | None
    mean_off: float | None
    seconds: float | None
    suspect: str | None

    @property
    def broke(self) -> bool:
        return not math.isfinite(self.change)

    @property
    def chaotic(self) -> bool:
        return not self.growth <= MAX_GROWTH


@dataclass(frozen=True)
class Ablated:
    """All rows of one scene on one backend: `full`, and `rows`, sorted by the time saved.

    `title`, `dt` [s] and `integrator` are those of the full scene; `end` [s] is the time at which errors are
    computed.
    """

    title: str
    dt: float
    integrator: str
    backend: str
    end: float
    full: AblationRow
    rows: tuple[AblationRow, ...]

    @property
    def floor(self) -> float:
        """Largest change [spacings] of a part that is not needed: the method's own error, or the resolution of the
        reference.
        """
        return max(self.full.error, RESOLVED * max(self.full.estimate, TOLERANCE))

    def saving(self, row: AblationRow) -> float | None:
        """Return the full scene's time over that of the row; None if it was not timed."""
        return self.full.seconds / row.seconds if self.full.seconds and row.seconds else None

    def quotable_saving(self, row: AblationRow) -> float | None:
        """Return the saving, or None if one of the two times is suspect and must not be quoted."""
        return None if row.suspect or self.full.suspect else self.saving(row)

    def verdict(self, row: AblationRow) -> str:
        """Return the verdict on a row.

        A part is needed if the run without it diverges, or differs by more than the full scene's own error. A finer
        step gets a verdict on the accuracy that it gains. A chaotic motion has no verdict.
        """
        if row.broke:
            return NEEDED
        if self.full.chaotic:
            return UNTOLD
        if row.kind == FINER:
            resolved = self.full.error >= self.floor
            return GAINS if resolved and row.error <= FLOOR * self.full.error else NOT_NEEDED
        return NEEDED if row.change > self.floor else NOT_NEEDED

    def printed_verdict(self, row: AblationRow) -> str:
        """Return the verdict on the row's subject: the part left out, or the cheaper replacement."""
        words = {PART: {}, FINER: FINER_STEP}.get(row.kind, REPLACED)
        verdict = self.verdict(row)
        return words.get(verdict, verdict)

    # ------------------------------------------------------------------ sentences

    def sentence(self) -> str:
        """Return a sentence on what the scene needs, from the data."""
        head = f"{self.title} at dt {self.dt:g} s with {self.integrator}, on the {self.backend.upper()}"
        if self.full.chaotic:
            broke = [row.name for row in self.rows if row.broke]
            text = (
                f"{head}: unknown what it needs at {self.end:g} s, because a perturbation has grown "
                f"{self.full.growth:.1e} times (over {MAX_GROWTH:g}); use a shorter --time, or compare the statistics"
            )
            return text + (f"; it diverges {_listed(broke)}." if broke else ".")
        writers = {PART: self._parts_words, INTEGRATOR: self._method_words, ARITHMETIC: self._method_words,
                 COARSER: self._step_words, FINER: self._step_words}  # fmt: skip
        phrases = [writers[kind]([row for row in self.rows if row.kind == kind]) for kind in writers if self._any(kind)]
        opening = f"{head}, error {self.full.error:.1e} spacings at {self.end:g} s"
        return f"{opening}: {'; '.join(filter(None, phrases)) or 'nothing was left out'}."

    def _any(self, kind: str) -> bool:
        return any(row.kind == kind for row in self.rows)

    def _of(self, rows: Sequence[AblationRow], verdict: str) -> list[AblationRow]:
        return [row for row in rows if self.verdict(row) == verdict]

    def _parts_words(self, rows: Sequence[AblationRow]) -> str:
        needed = sorted(self._of(rows, NEEDED), key=lambda row: -row.change)
        text = f"it needs {_listed([row.spares for row in needed])}" if needed else "it needs none of its parts"
        spare = [f"{row.spares} (without it {self._price(row)})" for row in self._of(rows, NOT_NEEDED)]
        return text + (f", not {_listed(spare)}" if spare else "")

    def _method_words(self, rows: Sequence[AblationRow]) -> str:
        enough = self._of(rows, NOT_NEEDED)
        phrases = [f"{row.name} is enough ({self._price(row)})" for row in enough]
        spared = {row.spares for row in enough}
        needed = [
            f"{what} is needed ({', '.join(f'{row.name} {self._harm(row)}' for row in rows if row.spares == what)})"
            for what in dict.fromkeys(row.spares for row in rows)
            if what not in spared
        ]
        return "; ".join([*phrases, *needed])

    def _step_words(self, rows: Sequence[AblationRow]) -> str:
        phrases = []
        for row in rows:
            verdict, saving = self.verdict(row), self.quotable_saving(row)
            cost = f" for {1 / saving:.2g} times the time" if saving else ""
            if verdict == GAINS:
                phrases.append(f"{row.name} would make the error {self.full.error / row.error:.2g} times smaller{cost}")
            elif row.kind == FINER:
                phrases.append(f"{row.name} gains nothing{cost}")
            elif verdict == NOT_NEEDED:
                phrases.append(f"{row.name} is enough ({self._price(row)})")
            else:
                phrases.append(f"{row.name} is too long ({self._harm(row)})")
        return "; ".join(phrases)

    def _price(self, row: AblationRow) -> str:
        """Return e.g. `changes 3.1e-06, 1.4 times as fast`."""
        return f"changes {row.change:.1e}{_speed(self.quotable_saving(row))}"

    @staticmethod
    def _harm(row: AblationRow) -> str:
        return "diverges" if row.broke else f"changes {row.change:.1e}"


def _speed(saving: float | None) -> str:
    if saving is None:
        return ""
    if 1 / NOISE < saving < NOISE:
        return ", saves nothing"
    return f", {saving:.2g} times as fast" if saving > 1 else f", takes {1 / saving:.2g} times as long"


def _listed(names: Sequence[str]) -> str:
    """Return `a`, `a and b`, or `a, b and c`."""
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


@dataclass
class AblationSummary(Summary):
    """Summary of `ablate`; `tables`: one per backend; `notes`: remarks on the results."""

    tables: list[Ablated] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def tables_of(measures: Iterable[Measure]) -> list[Ablated]:
    """Return the ablations among the measures of one machine, one for each full scene and backend, newest last."""
    groups: dict[str, dict[str, dict[str, Measure]]] = {}
    for measure in measures:
        ablation = measure.description.get("ablation")
        if ablation is not None and measure.name.startswith(PREFIX):
            of_group = groups.setdefault(ablation["full"], {})
            of_group.setdefault(ablation["name"], {})[measure.name] = measure
    tables = [_table(group) for group in groups.values()]
    return [table for table in tables if table is not None]


def _table(group: Mapping[str, Mapping[str, Measure]]) -> Ablated | None:
    """Return the table of one full scene; None if it is incomplete, or from several versions of the sources."""
    rows = [_row(named) for named in group.values() if CHANGE in named]
    full = next((row for row in rows if row.name == FULL.name), None)
    if full is None:
        return None
    head: Description = group[FULL.name][CHANGE].description
    method = tables_by_kind(head["scene"])["method"]
    newest = group[FULL.name][CHANGE].sources
    current = {name for name, named in group.items() if CHANGE in named and named[CHANGE].sources == newest}
    less = [row for row in rows if row is not full and row.name in current]
    return Ablated(
        head["ablation"]["title"], method["dt"], name_of(method), head["backend"], head["end"], full,
        tuple(sorted(less, key=lambda row: math.inf if row.seconds is None else row.seconds)),
    )  # fmt: skip


def _row(named: Mapping[str, Measure]) -> AblationRow:
    ablation = named[CHANGE].description["ablation"]

    def value(name: str) -> float | None:
        measure = named.get(f"{PREFIX}{name}")
        return measure.value if measure and measure.sources == named[CHANGE].sources else None

    error, change, estimate, growth = (value(name) for name in ("error", "change", "reference_estimate", "growth"))
    suspect = named.get(SUSPECT)
    return AblationRow(
        ablation["name"], ablation["kind"], ablation["spares"], named[CHANGE].reason or "",
        math.inf if error is None else error, math.inf if change is None else change, estimate or 0.0, growth or 0.0,
        value("energy_off"), value("mean_off"), value("seconds"), (suspect.reason or None) if suspect else None,
    )  # fmt: skip


def print_ablation(console: Console, summary: AblationSummary) -> None:
    """Print a table for each backend, sorted by saving, and its sentence."""
    for table in summary.tables:
        growth = f"a perturbation {growth_words(table.full.growth)} by then"
        console.print(
            f"{table.title}, on the {table.backend}, judged at {table.end:g} s; {growth}", markup=False, soft_wrap=True
        )
        console.print(_printed(table, console.width >= WIDE or not console.is_terminal))
        for row in table.rows:
            if row.broke:
                console.print(f"{row.name}: {row.why}", markup=False, soft_wrap=True)
        console.print(table.sentence(), markup=False, soft_wrap=True)
    for note in summary.notes:
        console.print(f"note: {note}", markup=False, soft_wrap=True)
    console.print(summary.counts() + summary.ending())


def _printed(ablated: Ablated, wide: bool) -> Table:
    """Return the table of one backend. A chaotic motion has statistics instead of error and change. `wide`: with
    reasons.
    """
    chaotic = ablated.full.chaotic
    heads = ("energy off, J", "centre off, spacings") if chaotic else ("error, spacings", "change, spacings")
    numeric = (Column(head, justify="right") for head in ("times as fast", "ms a simulated s", *heads))
    last = Column("", no_wrap=True)
    table = Table(
        Column("", no_wrap=True), *numeric, Column("verdict", no_wrap=True), *([last] if wide else []), box=None
    )
    for row in (ablated.full, *ablated.rows):
        numbers = (
            (row.energy_off, row.mean_off) if chaotic else (row.error, None if row is ablated.full else row.change)
        )
        shown = [f"{number:.1e}" if number is not None and math.isfinite(number) else "-" for number in numbers]
        saving = ablated.saving(row)
        cost = "-" if row.seconds is None else f"{1e3 * row.seconds:.3g}{'?' if row.suspect else ''}"
        style = "" if row is ablated.full else STYLES[ablated.verdict(row)]
        cells = [escape(row.name), "-" if saving is None else f"{saving:.2f}", cost, *shown]
        cells.append(f"[{style}]{ablated.printed_verdict(row)}[/]" if style else "")
        table.add_row(*cells, *(["diverged" if row.broke else escape(row.why)] if wide else []))
    return table
