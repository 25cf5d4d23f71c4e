"""Selection per backend: the machine that represents it, its name, and the sources of a figure."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Protocol, TypeVar

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
Found = TypeVar("Found")


def on_backends(results: Results, found: Callable[[Source, str], Found]) -> list[tuple[str, Source, Found]]:
    """Return (backend, machine, result of `found`) for each backend, from the first machine with a non-empty result."""
    chosen = []
    for backend in BACKENDS:
        for source in results.everyone:
            mine = found(source, backend)
            if mine:
                chosen.append((backend, source, mine))
                break
    return chosen


def timed(points: Callable[[Iterable[Measure]], list[Point]]) -> Callable[[Source, str], list[Point]]:
    """Make the function that returns the `points` of a machine's measures on a backend in float32."""
    return lambda source, backend: [
        p for p in points(source.measures) if (p.backend, p.precision) == (backend, PRECISION)
    ]


def draw_rates(
    ax: Any,
    found: Sequence[Any],
    looks: Mapping[Any, tuple[str, str, str]],
    lines: Mapping[int, str],
    kind: Callable[[Any], tuple[Any, int]],
) -> None:
    """Draw the `rate` of the points against their `particles`.

    A line for each of `looks` (label, colour, marker) and of `lines`, through the points of that `kind`. Solid lines
    are in the legend.
    """
    for look, (label, colour, marker) in looks.items():
        for number, line in lines.items():
            mine = [p for p in found if kind(p) == (look, number)]
            if mine:
                x, y = [p.particles for p in mine], [p.rate for p in mine]
                ax.plot(x, y, line, color=colour, marker=marker, label=label if line == "-" else None)


def name_of(backend: str, source: Source) -> str:
    """Return e.g. `GPU: NVIDIA H200`."""
    return f"{backend.upper()}: {source.device(backend)}"


def sources_of(chosen: Sequence[tuple[Any, ...]]) -> tuple[Source, ...]:
    """Return the machines of the panels, each once."""
    return tuple(dict.fromkeys(entry for one in chosen for entry in one if isinstance(entry, Source)))
