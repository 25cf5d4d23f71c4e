"""A panel a backend: which machine stands for it, what it is called, where the figure is from."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Protocol, TypeVar

from bench.store.results import Measure
from plots.core.data import Results, Source

PRECISION = "float32"


class Timed(Protocol):
    """What was timed on a backend."""

    @property
    def backend(self) -> str: ...

    @property
    def precision(self) -> str: ...


Point = TypeVar("Point", bound=Timed)


def panels(
    results: Results, points: Callable[[Iterable[Measure]], list[Point]]
) -> list[tuple[str, Source, list[Point]]]:
    """(backend, the machine that stands for it, own ones first, its `points` in float32) of the backends that were timed."""
    found = []
    for backend in ("cpu", "gpu"):
        for source in (*results.featured, *results.background):
            mine = [p for p in points(source.measures) if (p.backend, p.precision) == (backend, PRECISION)]
            if mine:
                found.append((backend, source, mine))
                break
    return found


def name_of(backend: str, source: Source) -> str:
    """`GPU: NVIDIA H200`."""
    return f"GPU: {source.gpu}" if backend == "gpu" else f"CPU: {source.processor}"


def sources_of(chosen: Sequence[tuple[str, Source, Any]]) -> tuple[Source, ...]:
    """The machines of the panels, each once."""
    return tuple({id(source): source for _, source, _ in chosen}.values())
