"""Times of a step behind a finding: configurations of one scene, sampled in turn."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

from app.driver import open_simulation
from bench.measure.machine import gpu_simulated
from bench.measure.timing import Neighbours, Subject, choose_steps, interleaved, warm_up
from bench.store.database import Store
from model.scene.scene import Scene

STAGE = "findings"  # of the samples in the store

Timed = tuple[Scene, dict[str, Any], str]  # scene, description, sources


class StepTimes:
    """How often, and where to. `quick`: fewer and shorter samples."""

    def __init__(self, store: Store, machine: str, quick: bool):
        self.store, self.machine = store, machine
        self.repeats, self.seconds, self.most = (3, 0.02, 0.5) if quick else (5, 0.1, 3.0)

    def holds(self, group: Sequence[Timed]) -> bool:
        """Whether the store has all samples of the group."""
        return all(
            self.store.sample_count(description, self.machine, sources, STAGE) >= self.repeats
            for _, description, sources in group
        )


def time_steps(times: StepTimes, run: str, group: Sequence[Timed]) -> None:
    """Sample the group in turn (A B A B ...), from the start of its scene, into the store."""
    with ExitStack() as stack:
        subjects = []
        for scene, description, sources in group:
            simulation = open_simulation(
                scene, description["backend"], precision=description["precision"], math=description["math"]
            )
            subject = Subject(stack.enter_context(simulation), (description, sources))
            warm_up(subject)
            choose_steps(subject, times.seconds, times.most)
            subjects.append(subject)
        for subject, sample in interleaved(subjects, [times.repeats] * len(subjects), Neighbours()):
            description, sources = subject.name
            simulated = "CUDA simulator, no GPU" if description["backend"] == "gpu" and gpu_simulated() else None
            suspect = "; ".join(filter(None, (sample.suspect, simulated))) or None
            times.store.add_sample(
                run, description, sources, sample.seconds, sample.steps, stage=STAGE, suspect=suspect
            )
