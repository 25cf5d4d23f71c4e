"""BaseAdvice of `softlab advise`: the fastest configuration for an error, the second, and the rejected ones with reasons."""

from __future__ import annotations

from dataclasses import dataclass, field

from softlab.bench.experiments.accuracy.methods import changes
from softlab.bench.experiments.accuracy.points import method_words
from softlab.bench.experiments.advise.budgets import NOISE, BaseAdvice
from softlab.bench.experiments.growth import DISTURBANCE, growth_words
from softlab.model.scene.scene import Scene


@dataclass(frozen=True)
class Choice:
    """One configuration that reaches the error and was timed.

    `dt` [s]: the largest step size found to reach it, in `steps` steps up to the time of judgement. `error`: spacings.
    `seconds`: wall time per simulated second, the minimum of the repeats, since disturbances only make a sample longer;
    `median`: their median. `copy_seconds` [s]: one copy of the state to the host. `limit` [s]: the largest stable step
    size in any state of the net. `suspect`: why the times may be wrong, or None. `integrator`: the name of the method;
    `iterations`: of a position-based one.
    """

    integrator: str
    dt: float
    precision: str
    backend: str
    math: str
    kernel: str
    threads: int | None
    steps: int
    error: float
    seconds: float
    median: float
    copy_seconds: float
    limit: float
    suspect: str | None = None
    iterations: int | None = None

    @property
    def limit_fraction(self) -> float:
        """Step size as a fraction of the stability limit."""
        return self.dt / self.limit

    @property
    def name(self) -> str:
        method = method_words(self.integrator, self.iterations)
        return f"{method}, dt {self.dt:.4g} s, {self.precision}, {self.backend}"

    @property
    def changes(self) -> dict[str, object]:
        """Fields of a scene, by dotted path, that select this configuration."""
        return changes(self.integrator, self.iterations or 1) | {"method.dt": self.dt}

    def copied(self, time: float) -> float:
        """Return the wall time per simulated second with a copy of the state to the host every `time` seconds [s]."""
        return self.seconds + self.copy_seconds / time


@dataclass(frozen=True)
class Advice(BaseAdvice[Choice]):
    """BaseAdvice for one scene and error.

    `scene`: as requested; `error` [spacings]: requested at `time` [s]. `growth`: the factor by which a disturbance of
    1e-9 has grown by then. `choices`: every configuration that reaches the error and was timed, fastest first.
    `beaten`: (method in words, why it was not timed). `why`: why there is no answer, with a remedy, None if there is
    one. `notes`: remarks on the answer. `seconds`: duration of the search.
    """

    scene: Scene
    error: float
    time: float
    growth: float
    choices: tuple[Choice, ...] = ()
    beaten: tuple[tuple[str, str], ...] = ()
    why: str | None = None
    notes: tuple[str, ...] = ()
    seconds: float = 0.0
    machine: str = field(default="", compare=False)

    def heading(self) -> str:
        """Return the heading of the scene file that is written: the result, and the settings that a scene does not
        contain.
        """
        best = self.best
        assert best is not None
        return "\n".join(
            [
                f"Written by softlab advise: fastest with an error of {self.error:g} spacings at {self.time:g} s.",
                f"Its error is {best.error:.2e} spacings, "
                f"its dt {best.limit_fraction:.0%} of the stability limit {best.limit:.6g} s.",
                f"Backend {best.backend}, {best.precision}, {1e3 * best.seconds:.3g} ms of wall time per simulated second.",
            ]
        )

    def __str__(self) -> str:
        grid = self.scene.grid
        asked = (
            f"{self.scene.title}, {grid.rows} x {grid.columns} masses: at most {self.error:g} spacings of error at "
            f"{self.time:g} s (a perturbation of {DISTURBANCE:g} {growth_words(self.growth)} by then)"
        )
        reasons = dict.fromkeys(choice.suspect for choice in self.choices if choice.suspect)
        return self.text(asked, marks=[f"? marks a time that may be too long: {reason}" for reason in reasons])

    def _details(self, number: int, one: Choice) -> list[str]:
        return [_margin(one), f"{self.options()} {self._settings(one)}"][: max(0, 2 - number)]

    def _over(self, one: Choice) -> str:
        best = self.choices[0]
        clear = one.seconds > min(best.median, NOISE * best.seconds)
        return f"{one.seconds / best.seconds:.2g} times as long" if clear else "no difference beyond measurement noise"

    def _settings(self, choice: Choice) -> str:
        """Return the options that change the requested scene to this choice."""
        current = {f"method.{field}": value for field, value in self.scene.method.model_dump().items()}
        # left out where the scene has these values already
        same = ("method.solver", "method.substeps", "method.iterations")
        changed = {
            path: value for path, value in choice.changes.items() if path not in same or current.get(path, 1) != value
        }
        return " ".join(f"--set {path}={value}" for path, value in changed.items())

    def _line(self, one: Choice) -> str:
        cost, copied = 1e3 * one.seconds, 1e3 * one.copied(self.time)
        mark = "?" if one.suspect else ""
        return (
            f"{one.name}: {cost:.3g}{mark} ms per simulated second ({copied:.3g} with a copy of the state to the host), "
            f"error {one.error:.2e} spacings"
        )


def _margin(choice: Choice) -> str:
    if choice.limit_fraction == 0:
        return "stable at any dt"
    return f"dt is {choice.limit_fraction:.0%} of the stability limit {choice.limit:.4g} s"
