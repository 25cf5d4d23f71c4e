"""Answers of `softlab advise`, and the times of budgets of a scene's own solvers."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from softlab.app.driver import open_simulation
from softlab.bench.measure.costs_timing import QUICK, Measures, Record, in_turn
from softlab.bench.measure.experiment import described
from softlab.bench.measure.items import cost_sources
from softlab.bench.measure.timing import Subject, prepare
from softlab.bench.store.database import Store
from softlab.model.base.errors import SoftlabError
from softlab.model.scene.scene import Scene

NOISE = 1.1  # times whose ratio is smaller are called equal
NOTHING = "no configuration reaches this error; ask for a larger --error or a smaller method.dt"


class Chosen(Protocol):
    """A configuration of a scene: `backend`, `precision`, and the `changes` of the scene."""

    @property
    def backend(self) -> str: ...

    @property
    def precision(self) -> str: ...

    @property
    def changes(self) -> dict[str, object]:
        """Fields of a scene, by dotted path, that select it."""


class Timed(Chosen, Protocol):
    """A budget, and `seconds` per step of the scene."""

    @property
    def seconds(self) -> float: ...


B = TypeVar("B", bound=Timed)
C = TypeVar("C", bound=Chosen)


def time_in_turn(
    store: Store, run: str, scene: Scene, budgets: Sequence[B], finding: str, files: Sequence[str]
) -> tuple[list[tuple[B, Measures]], list[tuple[B, str]]]:
    """Time steps of the scene with each budget, in turn; return (budget, its costs), and (budget, why it cannot be run).

    `finding`: of the configurations; `files`: on which the times depend too.
    """
    ready, failed = [], []
    with ExitStack() as stack:
        for budget in budgets:
            asked = scene.replace(budget.changes)
            description = described(asked, budget.backend, finding, precision=budget.precision)
            try:
                simulation = stack.enter_context(
                    open_simulation(asked, budget.backend, precision=budget.precision, allow_unstable=True)
                )
                ready.append((budget, prepare(Subject(simulation, description), QUICK.seconds, QUICK.most)))
            except SoftlabError as problem:
                failed.append((budget, str(problem)))
        if not ready:
            return [], failed
        record = Record(store, run, cost_sources(ready[0][0].backend, files))
        costs = in_turn(record, [subject for _, subject in ready], QUICK.repeats)
    return [(budget, numbers) for (budget, _), numbers in zip(ready, costs, strict=True)], failed


class BaseAdvice(Generic[C]):
    """Base of all answers: the requested `scene`, `choices` that reach the error, fastest first, `why` there are
    none."""

    scene: Scene
    choices: tuple[C, ...]
    beaten: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]
    seconds: float
    why: str | None

    @property
    def best(self) -> C | None:
        return self.choices[0] if self.choices else None

    def configured(self) -> Scene:
        """Return the scene with the settings of the best choice. Raises ValueError if there is none."""
        if self.best is None:
            raise ValueError(self.why or NOTHING)
        return self.scene.replace(self.best.changes)

    def options(self) -> str:
        """Return the options of `softlab run` for the settings that a scene file does not contain."""
        assert self.best is not None
        return f"--backend {self.best.backend} --precision {self.best.precision}"

    def text(self, asked: str, bases: Sequence[str] = (), marks: Sequence[str] = (), limits: Sequence[str] = ()) -> str:
        """Return the whole text: the request `asked`, choices, what they are based on, rejections, `marks` of their times,
        notes, and the `limits`.
        """
        lines = [asked]
        if not self.choices:
            lines.append(f"no answer: {self.why or NOTHING}")
        for number, one in enumerate(self.choices):
            head = {0: "fastest    ", 1: "second     "}.get(number, "  then     ")
            over = f"; {self._over(one)}" if number == 1 else ""
            lines.append(f"{head}{self._line(one)}{over}")
            lines += [f"           {detail}" for detail in self._details(number, one)]
        lines += [f"  basis    {basis}" for basis in bases]
        lines += [f"  rejected {name}: {reason}" for name, reason in self.beaten]
        lines += [*marks, *(f"note: {note}" for note in (*self.notes, *limits))]
        return "\n".join([*lines, f"the search took {self.seconds:.0f} s"])

    def _line(self, one: C) -> str:
        """Return a choice with its time and its error."""
        raise NotImplementedError

    def _details(self, number: int, one: C) -> list[str]:
        """Return the lines below a choice, the fastest of which has the number 0."""
        raise NotImplementedError

    def _over(self, one: C) -> str:
        """Return the time of a choice over that of the fastest."""
        raise NotImplementedError


@dataclass(frozen=True)
class BudgetAdvice(BaseAdvice[B], Generic[B]):
    """BaseAdvice for one scene and error.

    `error`: relative, as requested; `time` [s]: the end time; `choices`: the budgets that reach the error, timed,
    fastest first; `beaten`: (name, why it was rejected); `notes`: remarks; `seconds`: duration of the search.
    """

    scene: Scene
    error: float
    time: float
    choices: tuple[B, ...]
    beaten: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]
    seconds: float
    why: str | None = None

    def _line(self, one: B) -> str:
        return f"{one}: {1e3 * one.seconds:.3g} ms per step, timed here; {self._errors(one)}"

    def _details(self, number: int, one: B) -> list[str]:
        fields = " ".join(f"--set {path}={value}" for path, value in self._fields(one).items())
        return [] if number else [f"{self.options()} {fields}".rstrip()]

    def _errors(self, one: B) -> str:
        """Return the remaining error of a budget, in words."""
        raise NotImplementedError

    def _fields(self, one: B) -> dict[str, object]:
        """Return the fields of the scene that have to be set for a budget."""
        return one.changes

    def _over(self, one: B) -> str:
        ratio = one.seconds / self.choices[0].seconds
        return f"{ratio:.2g} times as long" if ratio > NOISE else "no clear difference"
