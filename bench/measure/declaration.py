"""Declarations of an experiment: its options, table, figure and sentences. Everything else is derived from them.

An experiment is a class in one file, named in bench/experiments/registry.py. From it follow its command
(bench/declared_commands.py), its table (here), its figure (plots/core/declared.py), and its sentences in the lab book
(labbook/claims/declared.py).
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar, Generic, TypeVar

from rich.console import Console
from rich.table import Column

from softlab.bench.measure.compile_ahead import Job
from softlab.bench.measure.experiment import Report, Summary, backends_here, resume
from softlab.bench.measure.tables import print_table
from softlab.bench.measure.words import listed
from softlab.bench.store.database import Store
from softlab.bench.store.results import Measure, measures
from softlab.model.base.errors import SceneError
from softlab.model.core.simulation import PRECISIONS

Value = str | int | float
Choices = Mapping[str, Any]  # argument of an experiment -> its values
CaseType = TypeVar("CaseType")
RowType = TypeVar("RowType")


@dataclass(frozen=True)
class Option:
    """An option of an experiment, which may be repeated on the command line, or (`type` bool) a switch.

    `values`: all that are allowed, if they are known; `usual`: those without the option (None: all; of a switch: off),
    `quick`: in a quick run (None: the same); `rows`: a first word stands for all values that begin with it; `words`: name
    of values that are given without the flag, too.
    """

    flag: str
    help: str
    type: type = str
    values: Sequence[Value] = ()
    usual: Sequence[Value] | None = None
    quick: Sequence[Value] | None = None
    rows: bool = False
    words: str = ""

    def chosen(self, wanted: Any, quick: bool) -> bool | list[Value]:
        """Return the wanted values, each once, or the usual ones. Raises SceneError for a value that is not allowed."""
        if self.type is bool:
            return bool(self.usual if wanted is None else wanted)
        usual = self.values if self.usual is None else self.usual
        wanted = wanted or (self.quick if quick and self.quick is not None else usual)
        return list(dict.fromkeys(one for value in wanted for one in self._allowed(value)))

    def _allowed(self, value: Value) -> Sequence[Value]:
        """Return the allowed values that a value stands for. Raises SceneError if there is none."""
        name = str(value).lower()
        names = {one: (str(one).lower(), str(one).lower().split()[0] if self.rows else None) for one in self.values}
        same = [one for one in self.values if one == value or name in names[one]]
        if self.values and not same:
            allowed = ", ".join(one if isinstance(one, str) else f"{one:g}" for one in self.values)
            raise SceneError(self.flag, value, f"must be one of {allowed}")
        return same or [value]


PRECISION = Option(
    "--precision", "float32 (the default), or float64. Repeatable.", values=tuple(PRECISIONS), usual=("float32",)
)


WITH_FINDINGS = Option(
    "--findings", "Also run the small experiments behind single findings (default: only if nothing is selected).", bool
)
METHODS_HELP = 'Only this integrator or position-based method ("xpbd jacobi"; xpbd: all orderings). Repeatable.'
PRECISIONS_HELP = "Only float32, or float64. Repeatable."

Cell = str | Callable[[Any], str]  # an attribute of a row, in a column of words, or the text of a number


@dataclass(frozen=True)
class Lines:
    """A figure with a panel per backend and logarithmic axes: lines of `y` against `x`, both attributes of rows.

    `styles`: key of a line -> (label, colour, marker); `dashes`: second key -> line style, of which solid lines are in the
    legend; `keys(row)`: both keys; `select(row)`: False for rows that are not drawn. Colours have the names of
    plots/core/colours.py, in lower case.
    """

    title: str
    caption: str
    y_label: str
    styles: Mapping[Hashable, tuple[str, str, str]]
    keys: Callable[[Any], tuple[Hashable, Hashable]]
    x: str = "particles"
    y: str = "rate"
    x_label: str = "particles"
    dashes: Mapping[Hashable, str] = field(default_factory=lambda: {0: "-"})
    select: Callable[[Any], bool] = lambda row: True


Part = tuple[str, Mapping[str, float]]  # the words on one backend, and their numbers


@dataclass(frozen=True)
class Sentence:
    """A sentence of the lab book on every backend that was measured.

    `text`: with {} for the parts; `part(rows)`: the part of one backend, None if its rows lack the numbers; `form`: of a
    part with its place; `join`: of several; `missing`: the sentence if no backend has the numbers.
    """

    text: str
    part: Callable[[Sequence[Any]], Part | None]
    missing: str
    form: str = "{part} on {place}"
    join: Callable[[list[str]], str] = listed

    def of(self, backends: Iterable[tuple[str, str, Sequence[Any]]]) -> tuple[str, dict[str, float]]:
        """Return (sentence, numbers) of (backend, its place in words, rows); without numbers it is `missing`."""
        parts: list[str] = []
        numbers: dict[str, float] = {}
        for backend, place, rows in backends:
            if (part := self.part(rows)) is not None:
                parts.append(self.form.format(part=part[0], place=place))
                numbers |= {f"{backend} {name}".strip(): value for name, value in part[1].items()}
        return (self.text.format(self.join(parts)), numbers) if parts else (self.missing, {})


class Experiment(Generic[CaseType, RowType]):
    """Base of all experiments, of cases and rows of results; an instance measures when it is called. The docstring of a class
    is the help of its command.

    `name`: of its summary and of its versions (bench/keys/versions.py); `command`: the sub-command that measures it, in
    turn with the others of that command; `switch`: the option that selects it instead of the others; `extra`: the option
    that adds it to what others select, or with --no- leaves it out; `example`, `quick_help`: texts of the command;
    `options`: argument -> Option; `on_backends`: whether it has --backend; `on_workers`: whether it has --cluster, with a
    machine for each worker if it is `timed`; `whole`: a group is measured anew if any of its cases is missing; `in_lab`:
    measured by `softlab lab`. `table`: head -> cell of a row, with the words `note` below.
    """

    name: ClassVar[str]
    command: ClassVar[str] = ""
    switch: ClassVar[Option | None] = None
    extra: ClassVar[Option | None] = None
    example: ClassVar[str] = ""
    quick_help: ClassVar[str] = "Fewer and smaller cases."
    options: ClassVar[Mapping[str, Option]] = {}
    summary: ClassVar[type[Summary]] = Summary
    report: ClassVar[Callable[..., None] | None] = None  # prints the summary; None: as text
    on_backends: ClassVar[bool] = True
    on_workers: ClassVar[bool] = False
    timed: ClassVar[bool] = True
    whole: ClassVar[bool] = False
    in_lab: ClassVar[bool] = False
    table: ClassVar[Mapping[str, Cell]] = {}
    note: ClassVar[str] = ""
    figure: ClassVar[Lines | None] = None
    sentences: ClassVar[Mapping[str, Sentence]] = {}

    def __call__(
        self,
        store: Store,
        *,
        quick: bool = False,
        progress: bool = True,
        command: str = "",
        backends: Sequence[str] | None = None,
        **how: Any,
    ) -> Summary:
        """Measure what the store lacks, group by group, and return a summary. Ctrl-C ends cleanly.

        `quick`: fewer and smaller cases; `backends`: None for all of this machine; `how`: `options`. Raises SceneError (an
        impossible choice), BackendUnavailable, InputError (the store).
        """
        options = self.picked(how, quick)
        groups = self.plan(store, backends_here(backends), quick, options)
        summary = self.summary.begun(store, self.name)
        resume(
            store, summary, groups, partial(self.is_stored, store, summary.machine, quick),
            partial(self.measure, store, summary, quick), progress=progress, command=command or self.asked_by(),
            worth=lambda case: getattr(case, "worth", 1), whole=self.whole, before=partial(self.before, store),
        )  # fmt: skip
        self.finish(store, summary, [case for group in groups for case in group], options, progress)
        summary.stop()
        return summary

    def plan(
        self, store: Store, backends: Sequence[str], quick: bool, options: Choices
    ) -> Sequence[Sequence[CaseType]]:
        """Return the groups of cases."""
        raise NotImplementedError

    def is_stored(self, store: Store, machine: str, quick: bool, case: CaseType) -> bool:
        """Return True if the store has all results of a case."""
        raise NotImplementedError

    def measure(self, store: Store, summary: Any, quick: bool, group: Sequence[CaseType], report: Report) -> None:
        """Measure the cases of a group, and store their results."""
        raise NotImplementedError

    def before(self, store: Store, cases: Sequence[CaseType]) -> Iterable[Job]:
        """Return jobs beside compiling that are done before these cases are measured."""
        return ()

    def finish(self, store: Store, summary: Any, cases: Sequence[CaseType], options: Choices, progress: bool) -> None:
        """Complete the summary with what the store has of these cases."""

    def rows(self, stored: Iterable[Measure], every: bool = False) -> Sequence[RowType]:
        """Return the results among the measures; with `every`, those of incomplete states too."""
        raise NotImplementedError

    def show(self, console: Console, store: Store, machine: str) -> None:
        """Print a table of what was measured on a machine."""
        if not self.table:
            return
        cells = [
            [str(getattr(row, cell)) if isinstance(cell, str) else cell(row) for cell in self.table.values()]
            for row in self.rows(measures(store, machine=machine), every=True)
        ]
        heads = [
            Column(head, no_wrap=True) if isinstance(cell, str) else Column(head, justify="right")
            for head, cell in self.table.items()
        ]
        print_table(console, heads, cells, self.note)

    def exit_status(self, summary: Any) -> int:
        """Return the exit status of the command after a measurement that was not interrupted."""
        return 0

    def asked_by(self) -> str:
        """Return the command that measures it, as a user types it."""
        return " ".join(filter(None, ("softlab", self.command, self.switch.flag if self.switch else "")))

    def picked(self, how: Choices, quick: bool) -> Choices:
        """Return the arguments of `options` with their values. Raises SceneError for a value that is not allowed."""
        if unknown := set(how) - set(self.options):
            raise TypeError(f"{self.name} has no options {', '.join(sorted(unknown))}")
        return {name: option.chosen(how.get(name), quick) for name, option in self.options.items()}
