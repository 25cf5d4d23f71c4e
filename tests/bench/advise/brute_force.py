"""Check of an advice by brute force: run the whole grid of methods and step sizes, and time the best of it.

It is slow on purpose and does not use the assumptions of `softlab advise` (that errors fall by their order, that a
method with many more forces cannot win): every integrator and precision runs at step sizes a fixed factor apart, up to
the stability limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, inf

from softlab.bench.experiments.accuracy.methods import newton
from softlab.bench.experiments.accuracy.references import converged_of, growth_of, references
from softlab.bench.experiments.advise.advice import NOISE, Advice, Choice
from softlab.bench.experiments.advise.experiment import ADVISED, iterations_of
from softlab.bench.experiments.advise.search import MIN_STEPS, Kind, Search, Task
from softlab.bench.measure.experiment import backends_here
from softlab.bench.store.database import Store
from softlab.model.core.simulation import PRECISIONS


@dataclass(frozen=True)
class Check:
    """Result: `judged` configurations, `reaching` of which reach the error.

    `advised`: the advice, timed in turn with `rivals`, the largest step size of each method that reaches the error,
    fastest first.
    """

    judged: int
    reaching: int
    advised: Choice
    rivals: tuple[Choice, ...]

    def cheaper(self, factor: float = NOISE) -> list[Choice]:
        """Return the rivals that take less than 1 / `factor` of the advised configuration's time."""
        return [rival for rival in self.rivals if rival.seconds < self.advised.seconds / factor]


def grid_steps(least: int, per_octave: int, octaves: int) -> list[int]:
    """Return numbers of steps from the fewest stable one to 2^octaves times as many, `per_octave` to a doubling."""
    return sorted({ceil(least * 2 ** (k / per_octave)) for k in range(per_octave * octaves + 1)})


def brute_force(
    store: Store,
    advice: Advice,
    *,
    backends: Sequence[str] | None = None,
    integrators: Sequence[str] = ADVISED,
    precisions: Sequence[str] = tuple(PRECISIONS),
    per_octave: int = 2,
    octaves: int = 5,
) -> Check:
    """Run the whole grid up to the time of the advice, and time what reaches the error in turn with the advice.

    Raises ValueError for an advice without an answer, BackendUnavailable, SceneError.
    """
    best = advice.best
    if best is None:
        raise ValueError(advice.why or "no choice")
    scene, end = advice.scene, advice.time
    motion = newton(scene)
    growth = growth_of(motion, end, references(store))
    right = converged_of(motion, end, references(store))
    run = store.start_run(advice.machine, "brute force")
    search = Search(store, Task(scene, advice.error, end, growth, right, advice.machine, run, inf))
    kinds = [
        kind
        for backend in backends_here(backends)
        for precision in precisions
        for name in integrators
        for iterations in iterations_of(name)
        if search.limit(kind := Kind(name, precision, backend, iterations)) > 0
    ]
    judged, reaching, fewest = 0, 0, []
    for kind in kinds:
        limit = search.limit(kind)
        least = MIN_STEPS if limit == inf else ceil(end / limit * (1 - 1e-12))
        errors = {steps: search.error(kind, steps) for steps in grid_steps(least, per_octave, octaves)}
        able = [steps for steps, error in errors.items() if error <= advice.error]
        judged, reaching = judged + len(errors), reaching + len(able)
        if able:
            fewest.append((kind, min(able), errors[min(able)]))
    advised = (Kind(best.integrator, best.precision, best.backend, best.iterations), best.steps, best.error)
    timed = search.time([advised, *(entry for entry in fewest if entry != advised)])
    key = (best.integrator, best.precision, best.backend, best.iterations, best.steps)
    mine = next(c for c in timed if (c.integrator, c.precision, c.backend, c.iterations, c.steps) == key)
    return Check(judged, reaching, mine, tuple(choice for choice in timed if choice is not mine))
