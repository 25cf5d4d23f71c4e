"""The measures of bench/experiments/findings.py as rows, machine by machine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from bench.experiments.findings import ERROR, RATE
from bench.store.results import Measure, Timing
from plots.core.data import Results, Source


@dataclass(frozen=True)
class Row:
    """One measure of a finding. `scheme`: the integrator, or the variant of it that only the reference has; `offset` [m]:
    how far from the origin; `value`: error in spacings (infinite: diverged) or rate in 1/s."""

    scheme: str
    dt: float
    precision: str
    backend: str
    offset: float
    value: float


def rows(source: Source, finding: str) -> list[Row]:
    """All measures of one finding, largest step first."""
    found = [_row(m) for m in source.measures if m.name in (ERROR, RATE) and m.description.get("finding") == finding]
    return sorted(
        (row for row in found if row), key=lambda row: (row.backend, row.scheme, row.precision, row.offset, -row.dt)
    )


def _row(measure: Measure) -> Row | None:
    description = measure.description
    if measure.value is None:
        return None
    kinds = {table.get("kind", name): table for name, table in description["scene"].items() if isinstance(table, dict)}
    return Row(
        scheme=str(description.get("scheme", kinds["method"]["integrator"])),
        dt=kinds["method"]["dt"],
        precision=description["precision"],
        backend=description["backend"],
        offset=description.get("offset", 0.0),
        value=measure.value,
    )


def source_with(results: Results, holds: Callable[[Source], bool]) -> Source | None:
    """The first source that holds something, featured ones first."""
    return next((s for s in (*results.featured, *results.background) if holds(s)), None)


def of_finding(results: Results, finding: str) -> tuple[Source | None, list[Row]]:
    """The first source that has a finding, and its rows of the first backend that has them."""
    source = source_with(results, lambda s: bool(rows(s, finding)))
    found = rows(source, finding) if source else []
    return source, [row for row in found if row.backend == found[0].backend]


def exact_pairs(source: Source, backend: str, precision: str) -> list[tuple[Timing, Timing]]:
    """(fast, exact) timings of one size, smallest first."""
    held = {(t.particles, t.math): t for t in source.findings if (t.backend, t.precision) == (backend, precision)}
    sizes = sorted({particles for particles, _ in held})
    return [(held[n, "fast"], held[n, "exact"]) for n in sizes if (n, "fast") in held and (n, "exact") in held]
