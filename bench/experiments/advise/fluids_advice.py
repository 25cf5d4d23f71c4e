"""What `softlab advise` answers of fluids: efforts that keep a density, the soonest first."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import Any

from bench.experiments.advise.advice import NOISE
from model.scene.scene import Scene


@dataclass(frozen=True)
class FluidBudget:
    """A scheme with `substeps` of a step and `iterations` of each; `density`: the mean density error that it left, `seconds`
    of a step of the scene; inf before."""

    scheme: str
    substeps: int
    iterations: int
    backend: str
    precision: str
    density: float = inf
    seconds: float = inf

    def with_(self, density: float, seconds: float) -> FluidBudget:
        """The same, once it was run."""
        return replace(self, density=density, seconds=seconds)

    @property
    def effort(self) -> str:
        """`4 x 5`"""
        return f"{self.substeps} x {self.iterations}"

    @property
    def changes(self) -> dict[str, Any]:
        """The fields of a scene, by dotted path, that make it be solved so."""
        return {"method.scheme": self.scheme, "method.substeps": self.substeps, "method.iterations": self.iterations}

    def __str__(self) -> str:
        return f"{self.scheme}, {self.effort}, {self.precision}, {self.backend}"


@dataclass(frozen=True)
class FluidAdvice:
    """The answer. `error`: of the mean density, relative, as asked for; `time` [s]: until then; `choices`: what reaches it,
    timed, the soonest first; `beaten`: (what, why it is none); `notes`; `seconds` that it took."""

    scene: Scene
    error: float
    time: float
    choices: tuple[FluidBudget, ...]
    beaten: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]
    seconds: float

    @property
    def best(self) -> FluidBudget | None:
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
            f"Written by softlab advise: the soonest way to a mean density error of {self.error:g} until {self.time:g} s.",
            f"Density error {best.density:.2g}; backend {best.backend}, {best.precision}, {1e3 * best.seconds:.3g} ms of "
            "wall time a step.",
        ])  # fmt: skip

    def __str__(self) -> str:
        count, method = self.scene.fluid_set.particle_count, self.scene.method
        lines = [
            f"{self.scene.title}, {count} particles: densities at most {self.error:g} over that at rest, on the mean, at "
            f"{self.time:g} s; a step of {method.dt:.4g} s"
        ]
        if not self.choices:
            lines.append("no answer: nothing reaches it; ask for a larger --error or a smaller method.dt")
        for number, one in enumerate(self.choices):
            head = {0: "soonest    ", 1: "runner-up  "}.get(number, "  then     ")
            ratio = one.seconds / self.choices[0].seconds
            over = f"; {ratio:.2g} times as long" if ratio > NOISE else "; no clear difference"
            found = f"{one}: {1e3 * one.seconds:.3g} ms a step, timed here; density error {one.density:.2g}"
            lines.append(head + found + (over if number == 1 else ""))
            if number == 0:
                fields = " ".join(f"--set {path}={value}" for path, value in one.changes.items())
                lines.append(f"           {self.options()} {fields}")
        lines += [f"  not      {name}: {reason}" for name, reason in self.beaten]
        lines += [f"note: {note}" for note in self.notes]
        lines.append(
            "note: a density kept is no motion foretold: fronts, heights and levels are told by softlab fluids --truth"
        )
        lines.append(f"{self.seconds:.0f} s")
        return "\n".join(lines)
