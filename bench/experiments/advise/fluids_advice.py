"""Answer of `softlab advise` for fluids: configurations that keep a density, fastest first."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from softlab.bench.experiments.advise.budgets import BudgetAdvice


@dataclass(frozen=True)
class FluidBudget:
    """A scheme with `substeps` per step and `iterations` per substep.

    `density`: the mean density error that it leaves; `seconds`: per step of the scene; inf before it was run.
    """

    scheme: str
    substeps: int
    iterations: int
    backend: str
    precision: str
    density: float = inf
    seconds: float = inf

    @property
    def effort(self) -> str:
        """Text of the effort, e.g. `4 x 5`."""
        return f"{self.substeps} x {self.iterations}"

    @property
    def changes(self) -> dict[str, object]:
        """Fields of a scene, by dotted path, that select this budget."""
        return {"method.scheme": self.scheme, "method.substeps": self.substeps, "method.iterations": self.iterations}

    def __str__(self) -> str:
        return f"{self.scheme}, {self.effort}, {self.precision}, {self.backend}"


@dataclass(frozen=True)
class FluidAdvice(BudgetAdvice[FluidBudget]):
    """Answer for a fluid; `error`: of the mean density."""

    def heading(self) -> str:
        """Return the heading of the scene file that is written."""
        best = self.best
        assert best is not None
        return "\n".join([
            f"Written by softlab advise: fastest with a mean density error of {self.error:g} until {self.time:g} s.",
            f"Density error {best.density:.2g}; backend {best.backend}, {best.precision}, {1e3 * best.seconds:.3g} ms of "
            "wall time per step.",
        ])  # fmt: skip

    def __str__(self) -> str:
        count, method = self.scene.fluid_set.particle_count, self.scene.method
        asked = (
            f"{self.scene.title}, {count} particles: mean density error at most {self.error:g} at "
            f"{self.time:g} s; time step {method.dt:.4g} s"
        )
        limits = (
            "a small density error is no accurate motion; softlab fluids --truth measures fronts, heights and levels"
        )
        return self.text(asked, limits=[limits])

    def _errors(self, one: FluidBudget) -> str:
        return f"density error {one.density:.2g}"
