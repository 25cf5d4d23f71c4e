"""Configurations of a sweep (`Case`), the effort of each, and the summary."""

from __future__ import annotations

from dataclasses import dataclass, field

from softlab.app.driver import open_simulation
from softlab.bench.measure.experiment import Summary
from softlab.bench.measure.timing import DRAW_EVERY
from softlab.bench.store.database import Store
from softlab.bench.store.results import ITEM_BYTES
from softlab.bench.store.schema import Description
from softlab.model.core.simulation import Simulation
from softlab.model.scene.scene import Scene

LADDER = ("stages", "launch", "graph", "one-block", "resident", "tiles", "fused", "tiled", "team")  # plainest first

Kind = tuple[object, ...]  # what cases have in common
Costs = dict[Kind, tuple[int, float, float]]  # kind of case -> (particles, seconds a step, to restore)


@dataclass(frozen=True)
class Effort:
    """`repeats` samples of `min_seconds` [s] each; `max_seconds`: limit for one configuration; `total_seconds`: limit
    for the sweep; `energy_seconds`: duration of an energy measurement, 0 for none; `again`: additional turns for
    disturbed samples."""

    repeats: int
    min_seconds: float
    max_seconds: float
    total_seconds: float | None
    energy_seconds: float = 0.0
    again: int = 0

    def repeats_of(self, case: Case) -> int:
        """Return the number of samples of a case."""
        return min(self.repeats, case.most_repeats or self.repeats)


@dataclass
class SweepSummary(Summary):
    """Result of a sweep: `samples` new ones, `suspect` of them; `skipped`: (configuration in words, reason); `wrong`:
    (configuration, failed check); `compile_seconds`: of `seconds` to compile or load kernels."""

    samples: int = 0
    suspect: int = 0
    skipped: list[tuple[str, str]] = field(default_factory=list)
    wrong: list[tuple[str, str]] = field(default_factory=list)
    compile_seconds: float = 0.0


@dataclass(frozen=True)
class Case:
    """One configuration to time. `word`, `threads`: 1x and the number it means here, None on the GPU; `sources`: hash
    of the measured code; `description`: configuration as in the store; `kernel`: a forced one, None for the backend's
    choice; `most_repeats`: limit of samples for slow kernels; `energy`: joules are measured, too."""

    scene: Scene
    backend: str
    word: str | None
    threads: int | None
    precision: str
    graphics: bool
    description: Description
    sources: str
    kernel: str | None = None
    most_repeats: int | None = None
    energy: bool = False

    def __str__(self) -> str:
        grid = self.scene.grid
        words = [f"{grid.rows} x {grid.columns}", self.backend, self.kernel, self.word, self.precision]
        return " ".join(filter(None, words)) + (" with graphics" if self.graphics else "")

    @property
    def particles(self) -> int:
        return self.scene.grid.particle_count

    @property
    def least_steps(self) -> int:
        return DRAW_EVERY if self.graphics else 1

    @property
    def simulation_kind(self) -> Kind:
        """Key of the cases that can share one opened simulation."""
        return (self.backend, self.threads, self.precision, self.kernel)

    @property
    def kind(self) -> Kind:
        """Key of the cases whose costs predict each other's: backend, threads, precision, kernel, graphics."""
        return (*self.simulation_kind, self.graphics)

    @property
    def host_bytes(self) -> int:
        """Return the approximate main memory of its simulation: the body, the copies made when a state is loaded, and
        the state. Many forced kernels are open at once and use one body; for them, the memory of each alone.
        """
        if self.kernel is not None:
            return self.particles * (8 + (16 * ITEM_BYTES[self.precision] if self.backend == "cpu" else 0))
        return self.particles * (72 + (20 if self.backend == "cpu" else 16) * ITEM_BYTES[self.precision])

    def open(self) -> Simulation:
        return open_simulation(
            self.scene, self.backend, threads=self.word or "1x", precision=self.precision, kernel=self.kernel
        )


def record_skip(store: Store, summary: SweepSummary, case: Case, reason: str) -> None:
    """Put the reason why a case was not measured into the store and the summary."""
    summary.skipped.append((str(case), reason))
    store.add_measure(summary.run, case.description, case.sources, "skipped", None, "", reason)
