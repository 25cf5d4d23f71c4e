"""Times of a step behind a finding: configurations of one scene, sampled in turn."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, NamedTuple

from app.driver import open_simulation
from bench.measure.experiment import stored_samples
from bench.measure.timing import Neighbours, Subject, choose_steps, interleaved, warm_up
from bench.store.database import Store
from model.scene.scene import Scene

STAGE = "findings"  # of the samples in the store


class Timed(NamedTuple):
    """One configuration, and how the store knows it."""

    scene: Scene
    description: dict[str, Any]
    sources: str


@dataclass(frozen=True)
class StepTimes:
    """Configurations that are sampled in turn (A B A B ...), each from the start of its scene. `name`: what they are called;
    `quick`: fewer and shorter samples."""

    name: str
    group: Sequence[Timed]
    quick: bool
    worth: int = 10

    def __str__(self) -> str:
        return self.name

    @property
    def repeats(self) -> int:
        return 3 if self.quick else 5

    def held(self, store: Store, machine: str) -> bool:
        """Whether the store has all samples of the group."""
        return all(store.sample_count(c.description, machine, c.sources, STAGE) >= self.repeats for c in self.group)

    def run(self, store: Store, run: str) -> None:
        """Sample the group into the store."""
        seconds, most = (0.02, 0.5) if self.quick else (0.1, 3.0)
        with ExitStack() as stack:
            subjects = []
            for case in self.group:
                options = {name: case.description[name] for name in ("precision", "math")}
                simulation = open_simulation(case.scene, case.description["backend"], **options)
                subject = Subject(stack.enter_context(simulation), case)
                warm_up(subject)
                choose_steps(subject, seconds, most)
                subjects.append(subject)
            samples = interleaved(subjects, [self.repeats] * len(subjects), Neighbours())
            for _ in stored_samples(store, run, STAGE, samples):
                pass
