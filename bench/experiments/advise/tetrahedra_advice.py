"""What `softlab advise` answers of tetrahedral bodies: budgets that reach an error, the soonest first, and where each number
is from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import Any

from bench.experiments.advise.advice import NOISE
from model.scene.scene import Scene


@dataclass(frozen=True)
class Budget:
    """A solver with `substeps` of a step and `iterations` of each, what it leaves `at_rest` and `in_motion` (relative), and
    `basis`: which laws say so. `seconds`: of a step of the scene, timed; inf before."""

    solver: str
    substeps: int
    iterations: int
    at_rest: float
    in_motion: float
    basis: str
    backend: str = "cpu"
    precision: str = "float64"
    seconds: float = inf

    def on(self, backend: str, precision: str) -> Budget:
        """The same there."""
        return replace(self, backend=backend, precision=precision)

    def taking(self, seconds: float) -> Budget:
        """The same with the time of a step [s]."""
        return replace(self, seconds=seconds)

    @property
    def words(self) -> str:
        """`newton, 8 substeps of 1 iteration`."""
        some = "substep" if self.substeps == 1 else "substeps"
        return f"{self.solver}, {self.substeps} {some} of {self.iterations} iteration{'s' * (self.iterations > 1)}"

    def __str__(self) -> str:
        return f"{self.words}, {self.precision}, {self.backend}"

    @property
    def changes(self) -> dict[str, Any]:
        """The fields of a scene, by dotted path, that make it be solved so."""
        budget = {
            "method.solver": self.solver, "method.substeps": self.substeps, "method.iterations": self.iterations
        }  # fmt: skip
        return budget | {"method.rows": "scalar"} if self.solver == "xpbd" else budget


@dataclass(frozen=True)
class TetrahedraAdvice:
    """The answer. `error`: relative, as asked for; `time` [s]: half of the slowest vibration; `choices`: the budgets that
    reach it, timed, the soonest first; `beaten`: (what, why it is none); `notes`; `seconds` that it took."""

    scene: Scene
    error: float
    time: float
    choices: tuple[Budget, ...]
    beaten: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]
    seconds: float

    @property
    def best(self) -> Budget | None:
        return self.choices[0] if self.choices else None

    def configured(self) -> Scene:
        """The scene with the best budget. Raises ValueError where there is none."""
        if self.best is None:
            raise ValueError("nothing reaches it")
        return self.scene.replace(self.best.changes)

    def options(self) -> str:
        """What to pass to `softlab run` beside a scene that is configured so: a scene does not hold it."""
        assert self.best is not None
        return f"--backend {self.best.backend} --precision {self.best.precision}"

    def heading(self) -> str:
        """For the file that the scene is written to."""
        best = self.best
        assert best is not None
        return "\n".join([
            f"Written by softlab advise: the soonest way to a solver's error of {self.error:g}, relative, by its laws.",
            f"At rest {best.at_rest:.2g}, in motion {best.in_motion:.2g}: {best.basis}.",
            f"Backend {best.backend}, {best.precision}, {1e3 * best.seconds:.3g} ms of wall time a step.",
        ])  # fmt: skip

    def __str__(self) -> str:
        found = self.scene.tetrahedra_set
        lines = [
            f"{self.scene.title}, {found}: at most {self.error:g} of the sag at rest, and of the way made in half of the "
            f"slowest vibration ({self.time:.3g} s); a step of {self.scene.method.dt:.4g} s"
        ]
        if not self.choices:
            lines.append("no answer: nothing reaches it; ask for a larger --error or a smaller method.dt")
        for number, one in enumerate(self.choices):
            head = {0: "soonest    ", 1: "runner-up  "}.get(number, "  then     ")
            lines.append(head + self._line(one) + (f"; {self._over(one)}" if number == 1 else ""))
            if number == 0:
                fields = " ".join(f"--set {path}={value}" for path, value in self._fields(one).items())
                lines.append(f"           {self.options()} {fields}".rstrip())
        for basis in dict.fromkeys(f"{one.solver} of {one.iterations}: {one.basis}" for one in self.choices):
            lines.append(f"  basis    {basis}")
        lines += [f"  not      {name}: {reason}" for name, reason in self.beaten]
        lines += [f"note: {note}" for note in self.notes]
        lines.append(
            "note: the mesh's own error is none of it: softlab tetrahedra tells how far linear tetrahedra bend"
        )
        lines.append(f"{self.seconds:.0f} s")
        return "\n".join(lines)

    def _fields(self, one: Budget) -> dict[str, Any]:
        """What differs from the scene as it was asked about."""
        held = {f"method.{field}": value for field, value in self.scene.method.model_dump().items()}
        return {path: value for path, value in one.changes.items() if held.get(path) != value}

    def _line(self, one: Budget) -> str:
        errors = f"{one.at_rest:.2g} at rest, {one.in_motion:.2g} in motion"
        return f"{one}: {1e3 * one.seconds:.3g} ms a step, timed here; {errors}"

    def _over(self, one: Budget) -> str:
        ratio = one.seconds / self.choices[0].seconds
        return f"{ratio:.2g} times as long" if ratio > NOISE else "no clear difference"
