"""Base of the answers of `softlab advise` whose choices are budgets of a scene's own solvers, timed on the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from softlab.bench.experiments.advise.advice import NOISE
from softlab.model.scene.scene import Scene


class Timed(Protocol):
    """A budget: `backend`, `precision`, and `seconds` per step of the scene."""

    @property
    def backend(self) -> str: ...

    @property
    def precision(self) -> str: ...

    @property
    def seconds(self) -> float: ...

    @property
    def changes(self) -> dict[str, Any]:
        """Fields of a scene, by dotted path, that select this budget."""


B = TypeVar("B", bound=Timed)


@dataclass(frozen=True)
class BudgetAdvice(Generic[B]):
    """Answer for one scene and error.

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

    @property
    def best(self) -> B | None:
        return self.choices[0] if self.choices else None

    def configured(self) -> Scene:
        """Return the scene with the best budget. Raises ValueError if there is none."""
        if self.best is None:
            raise ValueError("no configuration reaches this error")
        return self.scene.replace(self.best.changes)

    def options(self) -> str:
        """Return the options of `softlab run` for the settings that a scene file does not contain."""
        assert self.best is not None
        return f"--backend {self.best.backend} --precision {self.best.precision}"

    def _text(self, asked: str, bases: Sequence[str], limits: str) -> str:
        """Return the whole text: the request `asked`, choices, what they are based on, rejections, notes, and the
        `limits`.
        """
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
        """Return the remaining error of a budget, in words."""
        raise NotImplementedError

    def _fields(self, one: B) -> dict[str, Any]:
        """Return the fields of the scene that have to be set for a budget."""
        return one.changes

    def _over(self, one: B) -> str:
        ratio = one.seconds / self.choices[0].seconds
        return f"{ratio:.2g} times as long" if ratio > NOISE else "no clear difference"
