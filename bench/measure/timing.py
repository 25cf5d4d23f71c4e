"""Timing of one configuration, so that two of them may be compared.

- Compilation and warm-up come first and are reported separately.
- Every repeat starts from the same state, loaded outside the timed region; the device is waited for inside it.
- Compared configurations are interleaved (A B A B ...), so that a slow minute of the machine affects all of them.
- A sample is as many steps as fill a given time, or (where an error belongs to the time) whole runs of the interval
  over which the error is judged, each from the start; raw repeats are kept, never only their mean.
- Doubtful samples are marked with the reason, not dropped: a sample under 1 ms, other programs on the cores it used, a
  state that is not finite or incomplete (contacts lost, elements inverted or caught). (A spread over 10 % is seen when
  the repeats are summed up, in bench/store/results.py.)

With graphics, every DRAW_EVERY steps are followed by one off-screen picture, inside the timed region; the cost of
drawing is the difference to the same configuration without graphics.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import psutil

from softlab.app.outcome import fault_words
from softlab.bench.store.marks import INCOMPLETE
from softlab.cpu_backend.core.threads import allowed_cores, core_count
from softlab.cpu_backend.mass_spring.grid.choice import LEVELS
from softlab.model.base.errors import Diverged
from softlab.model.contact.shortfalls import can_fall_short, shortfalls
from softlab.model.core.simulation import Simulation, State

PASSES = 4  # of a kernel that does several steps in a pass, in a sample at least
MEASUREMENT = 1  # part of every resume key: raise it when what a sample means changes
DRAW_EVERY = 10  # steps, as the hand-out suggests
SHORTEST_SAMPLE = 1e-3  # s
DISTURBED = "load: other programs ran on the cores in use"  # a mark of a sample
MAX_RETAKES = 2
BUSY_NEIGHBOUR = 0.25  # cores that others may use before a sample is suspect
WATCH_SECONDS = 0.25  # over which the neighbours are watched: the kernel counts in hundredths of a second


class Renderer(Protocol):
    """Interface of app/output/offscreen.py's OffscreenRenderer."""

    def show(self, simulation: Simulation) -> object:
        """Draw the state that a simulation holds; return when the picture is done."""


@dataclass(frozen=True)
class Sample:
    """Duration `seconds` [s] of `steps` steps; `suspect`: reason to doubt it, or None."""

    seconds: float
    steps: int
    suspect: str | None


class Neighbours:
    """Use of this program's cores by other programs."""

    def __init__(self) -> None:
        self._seen = self._now()
        self._busy = 0.0

    @staticmethod
    def _now() -> tuple[float, float, float]:
        """Return (clock, core seconds that all programs used, those of this one)."""
        used = 0.0
        for core, times in enumerate(psutil.cpu_times(percpu=True)):
            if core in allowed_cores():
                idle = times.idle + getattr(times, "iowait", 0.0)
                guests = getattr(times, "guest", 0.0) + getattr(
                    times, "guest_nice", 0.0
                )  # which user and nice hold, too
                used += sum(times) - idle - guests
        return time.perf_counter(), used, time.process_time()

    def cores(self) -> float:
        """Cores that other programs used recently."""
        clock, used, process = self._now()
        passed = clock - self._seen[0]
        if passed >= WATCH_SECONDS:
            self._busy = max(0.0, (used - self._seen[1]) - (process - self._seen[2])) / passed
            self._seen = clock, used, process
        return self._busy

    def suspicion(self, threads: int) -> str | None:
        """The reason to mark a sample that ran on `threads` threads, or None."""
        cores = core_count()
        busy = self.cores()
        spare = cores - min(threads, cores)
        if busy > spare + BUSY_NEIGHBOUR:
            return DISTURBED
        return None


@dataclass
class Subject:
    """One opened simulation that is timed, with or without drawing. `name` is the caller's.

    `steps` a sample and the `wanted_seconds` of one are set by `choose_steps`. `run_steps`: steps of a whole run, if a
    sample is whole runs (`prepare_runs`), else 0.
    `host_threads`: threads of this process that stepping keeps busy.
    """

    simulation: Simulation
    name: Any = None
    renderer: Renderer | None = None
    steps: int = 0
    run_steps: int = 0
    wanted_seconds: float = 0.0
    seconds_per_step: float = math.nan
    restore_seconds: float = 0.0
    start: State | None = None
    _snapshot: int = field(default=-1, repr=False)

    @property
    def host_threads(self) -> int:
        return self.simulation.threads if self.simulation.backend == "cpu" else 1

    @property
    def least_steps(self) -> int:
        """Number of steps of which a sample has whole multiples: those of a picture, or of an exchange between windows."""
        return DRAW_EVERY if self.renderer else int(getattr(self.simulation, "whole_steps", 1))

    def restore(self) -> None:
        """Restore the state that every repeat starts from, by a copy on the device if there is one."""
        simulation = self.simulation
        if simulation.snapshots == self._snapshot:
            simulation.rewind()
        elif self.start is None:
            simulation.reset()
        else:
            simulation.load(self.start)
        self._snapshot = simulation.snapshots
        simulation.synchronize()

    def run(self, steps: int) -> float:
        """Run `steps` steps (and their pictures) from the current state, and return the seconds. Raises Diverged."""
        simulation = self.simulation
        if self.renderer is None:
            begin = time.perf_counter()
            simulation.advance(steps)
            simulation.synchronize()
            return time.perf_counter() - begin
        begin = time.perf_counter()
        for done in range(0, steps, DRAW_EVERY):
            simulation.advance(min(DRAW_EVERY, steps - done))
            self.renderer.show(simulation)
        simulation.synchronize()
        return time.perf_counter() - begin

    def _timed(self) -> tuple[float, str | None]:
        """Return (seconds of `steps` steps from the start, the fault of their end state or None)."""
        begin = seconds = 0.0
        try:
            for _ in range(self.steps // self.run_steps if self.run_steps else 1):
                self.restore()
                begin = time.perf_counter()
                seconds += self.run(self.run_steps or self.steps)
            self.simulation.check(snapshot=False)
        except Diverged as error:
            return time.perf_counter() - begin, f"state not finite: {error}"
        return seconds, None

    def sample(self, neighbours: Neighbours) -> Sample:
        """Return one repeat from the start, with its marks.

        A far too short one (its steps were chosen while other programs used the cores) is repeated with more steps.
        """
        for retakes_left in range(MAX_RETAKES, -1, -1):
            seconds, broken = self._timed()
            if broken or seconds >= self.wanted_seconds / 4 or not retakes_left:
                break
            self.steps *= min(64, math.ceil(self.wanted_seconds / max(seconds, 1e-6)))
        reasons = [broken] if broken else incomplete(self.simulation)
        if seconds < SHORTEST_SAMPLE:
            reasons.append("sample under 1 ms")
        load = neighbours.suspicion(self.host_threads)
        if load:
            reasons.append(load)
        return Sample(seconds, self.steps, "; ".join(reasons) or None)


def incomplete(simulation: object) -> list[str]:
    """Return the mark of a sample of the lab that ended with lost contacts or inverted or caught elements."""
    if not isinstance(simulation, Simulation) or not can_fall_short(simulation.scene):
        return []
    counts = shortfalls(simulation, simulation.read("position"), simulation.body.inverse_mass)
    faults = fault_words(counts)
    return [f"{INCOMPLETE}: {faults}"] if faults else []


def warm_up(subject: Subject) -> tuple[float, float]:
    """Return (first, second): seconds of the shortest run; the first includes the remaining compilation and loading.

    Raises Diverged, and the backend's error if it cannot run.
    """
    subject.restore()
    first = subject.run(subject.least_steps)
    begin = time.perf_counter()
    subject.restore()
    subject.restore_seconds = time.perf_counter() - begin
    second = subject.run(subject.least_steps)
    subject.seconds_per_step = second / subject.least_steps
    return first, second


def choose_steps(subject: Subject, seconds: float, most_seconds: float) -> int:
    """Set and return the number of steps of a sample that takes about `seconds` and, by estimate, never `most_seconds`.
    It is rounded to two digits and whole pictures; at least one, and at least PASSES passes of a kernel with several
    steps per pass (as far as `most_seconds` allows), which needs that many to be efficient. Call `warm_up` first.
    """
    steps, least = subject.least_steps, subject.least_steps
    taken = subject.seconds_per_step * steps
    while taken < seconds / 4 and 8 * taken < most_seconds:
        steps *= min(8, max(2, math.ceil(seconds / 3 / max(taken, 1e-9))))
        for _ in range(2):  # the quicker of two: one that a neighbour held up would make every sample too short
            subject.restore()
            taken = subject.run(steps)
            subject.seconds_per_step = min(subject.seconds_per_step, taken / steps)
        taken = subject.seconds_per_step * steps
    subject.wanted_seconds = min(1.1 * seconds, max(most_seconds, 0))
    wanted = subject.wanted_seconds / max(subject.seconds_per_step, 1e-12)
    subject.steps = max(least, _two_digits(wanted) // least * least)
    together = steps_together(subject.simulation)
    if subject.steps < PASSES * together:
        affordable = int(most_seconds / max(subject.seconds_per_step, 1e-12)) // together * together
        subject.steps = max(subject.steps, min(PASSES * together, affordable))
    return subject.steps


def prepare(subject: Subject, seconds: float, most_seconds: float) -> Subject:
    """Warm up a subject and choose the steps of samples of `seconds` [s], at most `most_seconds` [s]. Raises Diverged."""
    warm_up(subject)
    choose_steps(subject, seconds, most_seconds)
    return subject


def prepare_runs(subject: Subject, steps: int, seconds: float) -> Subject:
    """Return the subject, warmed up, with samples of whole runs of `steps` steps: as many as fill `seconds` [s], or one.

    Times and errors are then of the same interval. Raises Diverged.
    """
    warm_up(subject)
    subject.restore()
    once = subject.run(steps)
    subject.seconds_per_step, subject.run_steps = once / steps, steps
    subject.wanted_seconds = seconds
    subject.steps = steps * math.ceil(seconds / max(once, 1e-6))
    return subject


def steps_together(simulation: Any) -> int:
    """Steps that a kernel does in one pass over memory: several of the CPU's `tiled`; a peer has its own number."""
    return LEVELS if simulation.kernel == "tiled" else int(simulation.steps_together)


def _two_digits(number: float) -> int:
    """Rounded up to two significant digits, so that repeats on other days have the same steps more often."""
    if number <= 10:
        return math.ceil(number)
    unit = 10 ** (math.floor(math.log10(number)) - 1)
    return math.ceil(number / unit) * unit


def interleaved(
    subjects: Sequence[Subject], repeats: Sequence[int], neighbours: Neighbours | None = None, again: int = 0
) -> Iterator[tuple[Subject, Sample]]:
    """Yield samples in the order A B A B ..., `repeats[k]` of subject k, as they are finished. `again`: number of
    further turns in which disturbed samples are repeated, until there are enough undisturbed ones.
    """
    watch = neighbours or Neighbours()
    left = list(repeats)
    for turn in range(max(repeats, default=0) + again):
        for k, (subject, wanted) in enumerate(zip(subjects, repeats, strict=True)):
            if turn < wanted or (left[k] > 0 and turn >= max(repeats)):
                sample = subject.sample(watch)
                left[k] -= DISTURBED not in (sample.suspect or "")
                yield subject, sample
