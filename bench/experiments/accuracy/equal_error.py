"""The fastest way to an error, and GPU against CPU at equal error: the only speed-up worth quoting.

Works on anything that is a point of speed against error: those of bench/experiments/accuracy/points.py, and of the figures.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

TARGETS = (1e-1, 1e-2, 1e-3, 1e-4)  # spacings


class Timed(Protocol):
    """A run that was judged and timed. `seconds`: wall time per simulated second, without copies between host and
    device; `copied`: with the copy of the end state to the host; None where not measured."""

    @property
    def backend(self) -> str: ...
    @property
    def error(self) -> float: ...
    @property
    def seconds(self) -> float | None: ...
    @property
    def copied(self) -> float | None: ...


Candidate = TypeVar("Candidate", bound=Timed)


@dataclass(frozen=True)
class Fastest(Generic[Candidate]):
    """The fastest ways to an error of `target` spacings: of each backend, without and with the copy; None: none does."""

    target: float
    cpu: Candidate | None
    gpu: Candidate | None
    cpu_copied: Candidate | None
    gpu_copied: Candidate | None

    @property
    def best(self) -> Candidate | None:
        """The faster of both backends, without copies."""
        return fastest([p for p in (self.cpu, self.gpu) if p is not None], self.target)

    @property
    def speed_up(self) -> float | None:
        """How many times as fast as the CPU the GPU reaches the error, without copies; None where one does not."""
        if self.cpu is None or self.gpu is None:
            return None
        return _ratio(self.cpu.seconds, self.gpu.seconds)

    @property
    def speed_up_copied(self) -> float | None:
        """The same with the copy of the end state to the host in both times."""
        if self.cpu_copied is None or self.gpu_copied is None:
            return None
        return _ratio(self.cpu_copied.copied, self.gpu_copied.copied)


def _ratio(cpu: float | None, gpu: float | None) -> float | None:
    return cpu / gpu if cpu and gpu else None


def fastest(points: Iterable[Candidate], target: float, *, copied: bool = False) -> Candidate | None:
    """The cheapest of the points with at most `target` spacings of error; None where none has, or none was timed."""

    def cost(point: Candidate) -> float | None:
        return point.copied if copied else point.seconds

    able = [p for p in points if p.error <= target and cost(p) is not None]
    return min(able, key=lambda p: cost(p) or 0.0, default=None)


def equal_error(points: Sequence[Candidate], targets: Sequence[float] = TARGETS) -> list[Fastest[Candidate]]:
    """A row for each target: the fastest ways there, among points of one scene and machine."""
    rows = []
    for target in targets:
        ways = {
            (backend, copied): fastest([p for p in points if p.backend == backend], target, copied=copied)
            for backend in ("cpu", "gpu")
            for copied in (False, True)
        }
        rows.append(Fastest(target, ways["cpu", False], ways["gpu", False], ways["cpu", True], ways["gpu", True]))
    return rows
