"""Measures of bench/experiments/findings as rows, machine by machine."""

from __future__ import annotations

from dataclasses import dataclass

from softlab.bench.experiments.findings.costs import CHECK_FRACTION, CHECKS, INTERVAL
from softlab.bench.experiments.findings.determinism import DIFFERENT, GATHER
from softlab.bench.experiments.findings.experiment import ERROR, RATE
from softlab.bench.measure.costs_timing import LEAST, MOST, RATIO
from softlab.bench.store.results import Measure, Result, Timing, results_of
from softlab.bench.store.schema import tables_by_kind
from softlab.plots.core.data import Results, Source


@dataclass(frozen=True)
class Row:
    """One measure of a finding.

    `scheme`: the integrator, or a variant of it that only the reference has; `offset` [m]: distance from the origin;
    `value`: error in spacings (infinite: diverged) or rate in 1/s.
    """

    scheme: str
    dt: float
    precision: str
    backend: str
    offset: float
    value: float


def rows(source: Source, finding: str) -> list[Row]:
    """Return all measures of one finding, largest step first."""
    entries = [_row(m) for m in source.measures if m.name in (ERROR, RATE) and m.description.get("finding") == finding]
    return sorted(
        (row for row in entries if row), key=lambda row: (row.backend, row.scheme, row.precision, row.offset, -row.dt)
    )


def _row(measure: Measure) -> Row | None:
    description = measure.description
    if measure.value is None:
        return None
    method = tables_by_kind(description["scene"])["method"]
    return Row(
        str(description.get("scheme", method["integrator"])), method["dt"], description["precision"],
        description["backend"], description.get("offset", 0.0), measure.value,
    )  # fmt: skip


def of_finding(results: Results, finding: str) -> tuple[Source | None, list[Row]]:
    """Return the first source that has a finding, and its rows of the first backend that has them."""
    source = results.first(lambda s: rows(s, finding))
    of_source = rows(source, finding) if source else []
    return source, [row for row in of_source if row.backend == of_source[0].backend]


def exact_pairs(source: Source, backend: str, precision: str = "float32") -> list[tuple[Timing, Timing]]:
    """Return (fast, exact) timings of one size, smallest first."""
    by_size = {(t.particles, t.math): t for t in source.findings if (t.backend, t.precision) == (backend, precision)}
    sizes = sorted({particles for particles, _ in by_size})
    return [
        (by_size[n, "fast"], by_size[n, "exact"]) for n in sizes if (n, "fast") in by_size and (n, "exact") in by_size
    ]


# ---------------------------------------------------------------------- costs


@dataclass(frozen=True)
class Cost:
    """Cost of one variant of the same steps.

    `variant`: value of the field `sums`, empty for checks; `ratio`, `least`, `most`: time of a step over that of the first
    variant; `check_fraction`, `interval`: of checks; `different`: runs whose end state differs in bits; `suspect`: a
    sample is doubtful (other programs ran, it was short).
    """

    backend: str
    precision: str
    variant: str
    particles: int
    ratio: float
    least: float
    most: float
    check_fraction: float | None
    interval: int
    different: int | None
    suspect: bool


def costs(source: Source, finding: str, backend: str | None = None) -> list[Cost]:
    """Return the costs of a finding (of one backend), small grids first, without the first variant of each comparison."""
    entries = [cost for one in results_of(source.measures, finding, backend) if (cost := _cost(one))]
    return sorted(entries, key=lambda cost: (cost.backend, cost.precision, cost.variant, cost.particles))


def _cost(one: Result) -> Cost | None:
    description, value = one.description, one.values
    variant = description.get("sums", "")
    if RATIO not in value or variant == GATHER or description.get("looks") is False:
        return None
    grid = next(table for table in one.tables.values() if "rows" in table)
    different = value.get(DIFFERENT)
    return Cost(
        description["backend"], description["precision"], variant, grid["rows"] * grid["columns"], value[RATIO],
        value[LEAST], value[MOST], value.get(CHECK_FRACTION), int(value.get(INTERVAL, 0)),
        None if different is None else int(different), one.is_suspect(RATIO),
    )  # fmt: skip


def check_costs(source: Source, backend: str | None = None) -> list[Cost]:
    """Return the costs of the check for a diverged state."""
    return [cost for cost in costs(source, CHECKS, backend) if cost.check_fraction is not None]
