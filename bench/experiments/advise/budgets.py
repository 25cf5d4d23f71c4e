"""What answers of `softlab advise` share whose choices are budgets of a scene's own solvers, timed on the scene itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from bench.experiments.advise.advice import NOISE
from model.scene.scene import Scene


class Timed(Protocol):
    """A budget: `backend`, `precision`, and the `seconds` of a step of the scene."""

    @property
    def backend(self) -> str: ...

    @property
    def precision(self) -> str: ...

    @property
    def seconds(self) -> float: ...

    @property
    def changes(self) -> dict[str, Any]:
        """The fields of a scene, by dotted path, that make it be solved so."""


B = TypeVar("B", bound=Timed)


@dataclass(frozen=True)
class BudgetAdvice(Generic[B]):
    """The answer. `error`: relative, as asked for; `time` [s]: until then; `choices`: the budgets that reach it, timed, the
    fastest first; `beaten`: (what, why it is none); `notes`; `seconds` that it took."""

    scene: Scene
    error: float
    time: float
    choices: tuple[B, ...]
    beaten: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]
    seconds: float

    @property
    def best(self) -> B | None:
        return self.choices[0] if self.choices else None

    def configured(self) -> Scene:
        """The scene with the best budget. Raises ValueError where there is none."""
        if self.best is None:
            raise ValueError("no configuration reaches this error")
        return self.scene.replace(self.best.changes)

    def options(self) -> str:
        """What to pass to `softlab run` beside a scene that is configured so: a scene does not hold it."""
        assert self.best is not None
        return f"--backend {self.best.backend} --precision {self.best.precision}"

    def _told(self, asked: str, bases: Sequence[str], limits: str) -> str:
        """All of it: what was `asked`, choices, what they are based on, what is none, notes, the `limits` of the answer."""
        lines = [asked]
        if not self.choices:
            lines.append(
                "no answer: no configuration reaches this error; ask for a larger --error or a smaller method.dt"
            )
        for number, one in enumerate(self.choices):
            head = {0: "fastest    ", 1: "second     "}.get(number, "  then     ")
            over = f"; {self._over(one)}" if number == 1 else ""
            lines.append(f"{head}{one}: {1e3 * one.seconds:.3g} ms per step, timed here; {self._errors(one)}{over}")
            if number == 0:
                fields = " ".join(f"--set {path}={value}" for path, value in self._fields(one).items())
                lines.append(f"           {self.options()} {fields}".rstrip())
        lines += [f"  basis    {basis}" for basis in bases]
        lines += [f"  rejected {name}: {reason}" for name, reason in self.beaten]
        lines += [f"note: {note}" for note in (*self.notes, limits)]
        return "\n".join([*lines, f"the search took {self.seconds:.0f} s"])

    def _errors(self, one: B) -> str:
        """What a budget leaves."""
        raise NotImplementedError

    def _fields(self, one: B) -> dict[str, Any]:
        """What of the scene has to be set for a budget."""
        return one.changes

    def _over(self, one: B) -> str:
        ratio = one.seconds / self.choices[0].seconds
        return f"{ratio:.2g} times as long" if ratio > NOISE else "no clear difference"
