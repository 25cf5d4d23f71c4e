"""Search of `softlab advise`: the largest step size of each method that reaches an error, then the times of all."""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from math import ceil, inf, isfinite

import numpy as np

from softlab.bench.experiments.accuracy.cases import Case, make_case
from softlab.bench.experiments.accuracy.experiment import copy_seconds
from softlab.bench.experiments.accuracy.judgement import ERROR, judge
from softlab.bench.experiments.accuracy.methods import changes, order_of, sweeps
from softlab.bench.experiments.accuracy.points import COPY, method_words
from softlab.bench.experiments.advise.advice import Choice
from softlab.bench.experiments.advise.bracket import TIGHT, Tried, next_steps
from softlab.bench.experiments.growth import Growth
from softlab.bench.measure.case_timing import ready
from softlab.bench.measure.experiment import store_measures
from softlab.bench.measure.samples import in_turns
from softlab.bench.reference.cache import Converged
from softlab.bench.reference.mass_spring import start
from softlab.bench.store.database import Store
from softlab.bench.store.results import Timing, measures, timings
from softlab.bench.store.schema import configuration_hash
from softlab.model.base.errors import Diverged, SoftlabError
from softlab.model.core.families import stability_limit
from softlab.model.core.simulation import Simulation, State
from softlab.model.scene.scene import Scene

STAGE = "advise"  # stage of the samples in the store
MAX_RUNS = 12  # largest number of runs of one integrator, precision and backend
FLOOR = 0.75  # an error has stopped falling if twice the steps leave more than this fraction of it
HOPELESS = 10  # times the forces of the best so far: not compiled, not run
REPEATS, SAMPLE_SECONDS, MAX_SAMPLE = 9, 0.02, 1.0  # many short samples: their minimum counts
MAX_ROUNDS = 3  # rounds of samples, while they are disturbed
DISTURBED = 1.5  # a median above this multiple of the minimum: other programs used the cores
MIN_STEPS = 4  # if the step size has no limit


@dataclass(frozen=True)
class Kind:
    """Method, precision, backend and iterations whose step size is searched."""

    integrator: str  # the method's name
    precision: str
    backend: str
    iterations: int | None = None  # of a position-based method

    def __str__(self) -> str:
        return f"{self.method}, {self.precision}, {self.backend}"

    @property
    def method(self) -> str:
        """Name of the method in words."""
        return method_words(self.integrator, self.iterations)

    @property
    def sweeps(self) -> int:
        """Cost of a step in force evaluations or equivalents."""
        return sweeps(self.integrator, self.iterations or 1)

    @property
    def order(self) -> int:
        return order_of(self.integrator)

    def changes(self, dt: float) -> dict[str, object]:
        """Return the fields of a scene that select this kind with step size `dt` [s]."""
        return changes(self.integrator, self.iterations or 1) | {"method.dt": dt}


@dataclass(frozen=True)
class Task:
    """Request: at most `error` spacings at `end` [s], against the reference `newton`.

    `machine`, `run`: where it is stored; nothing new begins after `deadline` (time.perf_counter).
    """

    scene: Scene
    error: float
    end: float
    growth: Growth
    newton: Converged
    machine: str
    run: str
    deadline: float


class _OutOfTime(Exception):
    """The time for the search was used up, or would be before a run ends."""


class Search:
    """State of the search.

    `reached`: kind -> (steps, error) with the fewest steps found to reach the error; `beaten`: (method, why it was left
    out).
    """

    def __init__(self, store: Store, task: Task):
        self.store, self.task = store, task
        self.reached: dict[Kind, Tried] = {}
        self.beaten: list[tuple[str, str]] = []
        self._closest: tuple[float, str] = (inf, "")
        self._seconds: dict[Kind, float] = {}  # per step, from the runs so far
        self._errors = {
            (m.configuration, m.sources): m.value for m in measures(store, ERROR, task.machine) if m.value is not None
        }

    def case(self, kind: Kind, steps: int) -> Case:
        """Return the configuration, whose description includes the time at which errors are computed, which is not part
        of the scene."""
        scene = self.task.scene.replace(kind.changes(self.task.end / steps))
        base = make_case("", scene, kind.backend, kind.precision)
        return replace(base, description=base.description | {"end": self.task.end})

    def limit(self, kind: Kind) -> float:
        return stability_limit(self.task.scene.replace(kind.changes(self.task.end)))

    def find(self, kind: Kind) -> None:
        """Add the kind to `reached` with the fewest steps that reach the error, or to `beaten` with the reason."""
        limit = self.limit(kind)
        if limit == 0:
            self._leave(kind.method, "unstable at every step size in this scene")
            return
        least = max(MIN_STEPS if limit == inf else 1, ceil(self.task.end / limit * (1 - 1e-12)))
        forces = kind.sweeps
        best = min((n * k.sweeps for k, (n, _) in self.reached.items()), default=None)
        if best is not None and least * forces > HOPELESS * best:
            times = f"{least * forces / best:.0f} times as many force evaluations"
            self._leave(kind.method, f"its stability limit of {limit:.3g} s requires {times} as the best configuration")
            return
        most = None if best is None else int(HOPELESS * best / forces)
        same = [n for k, (n, _) in self.reached.items() if k.method == kind.method]
        try:
            self._close_in(kind, least, most, same[0] if same else None)
        except _OutOfTime as late:
            self._leave(str(kind), str(late))
        except SoftlabError as problem:
            self._leave(str(kind), str(problem))

    def _leave(self, name: str, reason: str) -> None:
        if (name, reason) not in self.beaten:
            self.beaten.append((name, reason))

    def _close_in(self, kind: Kind, least: int, most: int | None, seed: int | None) -> None:
        order = kind.order
        low: Tried | None = None  # most steps that miss the error
        high: Tried | None = None  # fewest steps that reach it
        steps = max(least, seed or least)
        for turn in range(MAX_RUNS):
            error = self.error(kind, steps)
            if error <= self.task.error:
                high = steps, error
            else:
                if low is not None and steps >= 1.9 * low[0] and isfinite(low[1]) and error > FLOOR * low[1]:
                    least_error = min(error, low[1])
                    self._leave(str(kind), f"its error stops falling at {least_error:.1e} spacings")
                    return
                low = steps, error
            if high and (high[0] == least or (low and (high[0] - low[0] <= 1 or high[0] <= TIGHT * low[0]))):
                break
            steps = next_steps(low, high, self.task.error, order, least, turn)
            if most is not None and high is None and steps > most:
                needed = steps * kind.sweeps
                self._leave(
                    str(kind), f"needs about {needed} force evaluations, more than {HOPELESS} times those of the best"
                )
                return
        if high:
            self.reached[kind] = high
        else:
            self._leave(str(kind), f"did not reach the error in {MAX_RUNS} runs, the last of {steps} steps")

    def error(self, kind: Kind, steps: int) -> float:
        """Return the error [spacings] at the end, from the store if it is there; infinite if the run diverged."""
        case = self.case(kind, steps)
        key = self._key(case)
        if key not in self._errors:
            self._errors[key] = self._run(kind, case, steps)
        rms = self._errors[key]
        if rms < self._closest[0]:
            self._closest = rms, f"{kind}, dt {self.task.end / steps:.4g} s"
        return rms

    def _run(self, kind: Kind, case: Case, steps: int) -> float:
        expected, left = steps * self._seconds.get(kind, 0.0), self.task.deadline - clock.perf_counter()
        if left <= 0:
            raise _OutOfTime("not tried: the time of --total-seconds was used up")
        if expected > left:
            raise _OutOfTime(
                f"not finished: {steps} steps take about {expected:.0f} s, and {left:.0f} s of --total-seconds are left"
            )
        with case.open() as simulation:
            if kind not in self._seconds:
                _compile(simulation)
            begin = clock.perf_counter()
            try:
                simulation.advance(steps)
                outcome: State | Diverged = simulation.state()
            except Diverged as diverged:
                outcome = diverged
            self._seconds[kind] = (clock.perf_counter() - begin) / steps
            numbers = judge(case.scene, outcome, self.task.newton, self.task.growth)
            if not isinstance(outcome, Diverged):
                numbers[COPY] = (copy_seconds(simulation), "s", "the whole state")
        store_measures(self.store, self.task.run, case.description, case.sources, numbers)
        return numbers[ERROR][0]

    # ------------------------------------------------------------------ times

    def timed(self) -> list[Choice]:
        """Return the choices that reach the error, fastest first, timed in turn unless the store has the times of all."""
        return self.time([(kind, *tried) for kind, tried in self.reached.items()])

    def time(self, wanted: Sequence[tuple[Kind, int, float]]) -> list[Choice]:
        """Time each (kind, steps, error) in turn, unless the store has sound samples of all; fastest first.

        Samples that other programs disturbed (shown by the cores' load, or by their spread) are repeated: the minimum
        of all samples counts, so more samples can only improve it.
        """
        cases = [self.case(kind, steps) for kind, steps, _ in wanted]
        known = self._timings()
        for _ in range(MAX_ROUNDS):
            if all(self._sound(known.get(self._key(case))) for case in cases):
                break
            self._sample(cases)
            known = self._timings()
        copies = {m.configuration: m.value for m in measures(self.store, COPY, self.task.machine)}
        choices = []
        for (kind, steps, error), case in zip(wanted, cases, strict=True):
            key = self._key(case)
            timing, dt = known[key], case.scene.method.dt
            choices.append(
                Choice(
                    kind.integrator, dt, kind.precision, kind.backend, case.math, timing.kernel, timing.threads, steps,
                    error, timing.low / dt, timing.median / dt, copies.get(key[0]) or 0.0,
                    self.limit(kind), "; ".join(timing.suspect) or None, kind.iterations,
                )
            )  # fmt: skip
        return sorted(choices, key=lambda choice: choice.seconds)

    @staticmethod
    def _key(case: Case) -> tuple[str, str]:
        return configuration_hash(case.description), case.sources

    def _timings(self) -> dict[tuple[str, str], Timing]:
        return {(t.configuration, t.sources): t for t in timings(self.store, self.task.machine, STAGE)}

    @staticmethod
    def _sound(timing: Timing | None) -> bool:
        return timing is not None and timing.count >= REPEATS and timing.median <= DISTURBED * timing.low

    def _sample(self, cases: Sequence[Case]) -> None:
        """Time the cases in turn (A B A B ...)."""
        run = self.task.run
        with ExitStack() as stack:
            subjects = [ready(stack, case, SAMPLE_SECONDS, MAX_SAMPLE) for case in cases]
            for case, subject in zip(cases, subjects, strict=True):
                kernel = subject.simulation.kernel
                self.store.add_measure(run, case.description, case.sources, "kernel", None, "", kernel)
            list(in_turns(self.store, run, STAGE, subjects, REPEATS))

    # ------------------------------------------------------------------ texts

    def failure(self) -> str:
        """Return the reason why nothing reaches the error."""
        error, name = self._closest
        closest = f"the closest is {name} with {error:.1e}" if isfinite(error) else "every run diverged"
        return f"no configuration reaches {self.task.error:g} spacings: {closest}; ask for a larger --error"

    def notes(self) -> list[str]:
        """Return remarks on the result."""
        task = self.task
        displacement = np.linalg.norm(task.newton.position - start(task.scene)[0], axis=1)
        moved = displacement.max() / task.scene.grid.spacing
        if moved < task.error:
            return [f"nothing moves by more than {moved:.1e} spacings until then, so every method reaches the error"]
        return []


def _compile(simulation: Simulation) -> None:
    """Run a step and restore the state, so that compile time is not part of a step's time."""
    begin = simulation.state()
    with suppress(Diverged):
        simulation.advance(1)
    simulation.load(begin)


def disturbed(choices: Sequence[Choice]) -> list[str]:
    """Return a note if other programs ran while the choices were timed, else nothing."""
    if any("load" in (c.suspect or "") or c.median > DISTURBED * c.seconds for c in choices):
        return ["other programs ran during the timing; repeat it on a quiet machine before relying on close times"]
    return []
