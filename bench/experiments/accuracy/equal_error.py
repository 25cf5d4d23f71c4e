"""Fastest configuration that reaches an error, and the speed-up of the GPU over the CPU at equal error.

Only a speed-up at equal error is worth quoting. The functions accept any point that has a speed and an error: the
points of bench/experiments/accuracy/points.py and those of the figures.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Generic, Protocol, TypeVar

TARGETS = (1e-1, 1e-2, 1e-3, 1e-4)  # spacings


class Judged(Protocol):
    """A run whose error was measured, and its `seconds` of wall time per simulated second, without copies between host
    and device, None where they were not. `resolved`: the reference is accurate enough for the error.
    """

    @property
    def error(self) -> float: ...
    @property
    def seconds(self) -> float | None: ...
    @property
    def resolved(self) -> bool: ...


class Timed(Judged, Protocol):
    """A run on a backend. `copied`: `seconds` with the copy of the end state to the host."""

    @property
    def backend(self) -> str: ...
    @property
    def copied(self) -> float | None: ...


Candidate = TypeVar("Candidate", bound=Timed)


@dataclass(frozen=True)
class Fastest(Generic[Candidate]):
    """Fastest configurations with an error of at most `target` spacings, by backend, without and with the copy.

    None where no configuration reaches the error.
    """

    target: float
    cpu: Candidate | None
    gpu: Candidate | None
    cpu_copied: Candidate | None
    gpu_copied: Candidate | None

    @property
    def best(self) -> Candidate | None:
        """Faster one of both backends, without copies."""
        return fastest([p for p in (self.cpu, self.gpu) if p is not None], self.target)

    @property
    def speed_up(self) -> float | None:
        """Time of the CPU over that of the GPU at equal error, without copies; None if one of them does not reach it."""
        if self.cpu is None or self.gpu is None:
            return None
        return _ratio(self.cpu.seconds, self.gpu.seconds)

    @property
    def speed_up_copied(self) -> float | None:
        """Time of the CPU over that of the GPU at equal error, both with the copy of the end state to the host."""
        if self.cpu_copied is None or self.gpu_copied is None:
            return None
        return _ratio(self.cpu_copied.copied, self.gpu_copied.copied)


def _ratio(cpu: float | None, gpu: float | None) -> float | None:
    return cpu / gpu if cpu and gpu else None


def fastest(points: Iterable[Candidate], target: float, *, copied: bool = False) -> Candidate | None:
    """Return the cheapest point with a resolved error of at most `target` spacings; None if no timed point has one."""

    def cost(point: Candidate) -> float | None:
        return point.copied if copied else point.seconds

    able = [p for p in points if p.error <= target and p.resolved and cost(p) is not None]
    return min(able, key=lambda p: cost(p) or 0.0, default=None)


def equal_error(points: Sequence[Candidate], targets: Sequence[float] = TARGETS) -> list[Fastest[Candidate]]:
    """Return a row for each target error: the fastest configurations among points of one scene and machine."""
    rows = []
    for target in targets:
        pairs = product((False, True), ("cpu", "gpu"))  # the order of the fields of Fastest
        chosen = (
            fastest([p for p in points if p.backend == backend], target, copied=copied) for copied, backend in pairs
        )
        rows.append(Fastest(target, *chosen))
    return rows
