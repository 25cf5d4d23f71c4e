"""Answer of `softlab advise` for tetrahedral bodies: budgets that reach an error, fastest first, with their basis."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from softlab.bench.experiments.advise.budgets import BudgetAdvice
from softlab.bench.experiments.tetrahedral.cantilever import SECOND
from softlab.model.formulas.elastic.stages import STAGE


@dataclass(frozen=True)
class Budget:
    """A solver of an `order` in time, with `substeps` per step and `iterations` per substep.

    `at_rest`, `in_motion`: its relative errors; `basis`: the laws that they follow from; `seconds`: of a step of the
    scene, inf before it was timed.
    """

    solver: str
    substeps: int
    iterations: int
    at_rest: float
    in_motion: float
    basis: str
    backend: str = "cpu"
    precision: str = "float64"
    seconds: float = inf
    order: int = 1

    @property
    def name(self) -> str:
        """Name of the solver, `newton` or `newton order 2`."""
        return SECOND if self.order > 1 else self.solver

    def solve(self, dt: float) -> float:
        """Return the time [s] that one solve of a step of `dt` [s] spans."""
        return dt / self.substeps * (STAGE if self.order > 1 else 1)

    @property
    def words(self) -> str:
        """Text of the budget, e.g. `newton, 8 substeps of 1 iteration`."""
        some = "substep" if self.substeps == 1 else "substeps"
        return f"{self.name}, {self.substeps} {some} of {self.iterations} iteration{'s' * (self.iterations > 1)}"

    def __str__(self) -> str:
        return f"{self.words}, {self.precision}, {self.backend}"

    @property
    def changes(self) -> dict[str, object]:
        """Fields of a scene, by dotted path, that select this budget."""
        budget = {
            "method.solver": self.solver, "method.substeps": self.substeps, "method.iterations": self.iterations
        }  # fmt: skip
        if self.solver == "newton":  # order 1 too, where a scene sets 2
            return budget | {"method.order": self.order}
        return budget | {"method.rows": "scalar"} if self.solver == "xpbd" else budget


@dataclass(frozen=True)
class TetrahedraAdvice(BudgetAdvice[Budget]):
    """Answer for tetrahedral bodies; `time` [s]: half of the slowest vibration."""

    def heading(self) -> str:
        """Return the heading of the scene file that is written."""
        best = self.best
        assert best is not None
        return "\n".join([
            f"Written by softlab advise: fastest with a relative solver error of {self.error:g}, by its error law.",
            f"At rest {best.at_rest:.2g}, in motion {best.in_motion:.2g}: {best.basis}.",
            f"Backend {best.backend}, {best.precision}, {1e3 * best.seconds:.3g} ms of wall time per step.",
        ])  # fmt: skip

    def __str__(self) -> str:
        asked = (
            f"{self.scene.title}, {self.scene.tetrahedra_set}: solver error at most {self.error:g} of the sag at rest and "
            f"of the way in half of the slowest vibration ({self.time:.3g} s); time step {self.scene.method.dt:.4g} s"
        )
        bases = list(dict.fromkeys(f"{one.name} of {one.iterations}: {one.basis}" for one in self.choices))
        limits = "the error of the mesh is not included; softlab tetrahedra measures how stiffly linear tetrahedra bend"
        return self.text(asked, bases, limits=[limits])

    def _fields(self, one: Budget) -> dict[str, object]:
        """Return the fields that differ from the requested scene."""
        current = {f"method.{field}": value for field, value in self.scene.method.model_dump().items()}
        return {path: value for path, value in one.changes.items() if current.get(path) != value}

    def _errors(self, one: Budget) -> str:
        return f"{one.at_rest:.2g} at rest, {one.in_motion:.2g} in motion"
