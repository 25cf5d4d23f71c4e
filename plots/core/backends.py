"""Selection per backend: the machine that represents it, its name, and the sources of a figure."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Protocol, TypeVar

from softlab.bench.store.results import Measure
from softlab.plots.core.data import Results, Source

BACKENDS = ("cpu", "gpu")
PRECISION = "float32"


class Timed(Protocol):
    """A point that was timed on a backend."""

    @property
    def backend(self) -> str: ...

    @property
    def precision(self) -> str: ...


Point = TypeVar("Point", bound=Timed)
Selection = TypeVar("Selection")


def on_backends(results: Results, select: Callable[[Source, str], Selection]) -> list[tuple[str, Source, Selection]]:
    """Return (backend, machine, result of `select`) for each backend, from the first machine with a non-empty result."""
    chosen = []
    for backend in BACKENDS:
        for source in results.everyone:
            selection = select(source, backend)
            if selection:
                chosen.append((backend, source, selection))
                break
    return chosen


def timed(points: Callable[[Iterable[Measure]], Sequence[Point]]) -> Callable[[Source, str], list[Point]]:
    """Make the function that returns the `points` of a machine's measures on a backend in float32."""
    return lambda source, backend: [
        p for p in points(source.measures) if (p.backend, p.precision) == (backend, PRECISION)
    ]


def name_of(backend: str, source: Source) -> str:
    """Return e.g. `GPU: NVIDIA H200`."""
    return f"{backend.upper()}: {source.device(backend)}"


def sources_of(chosen: Sequence[tuple[object, ...]]) -> tuple[Source, ...]:
    """Return the machines of the panels without repetition."""
    return tuple(dict.fromkeys(entry for one in chosen for entry in one if isinstance(entry, Source)))
