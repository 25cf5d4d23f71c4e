"""The measures of bench/experiments/findings_costs.py and bench/experiments/findings_determinism.py as rows."""

from __future__ import annotations

from dataclasses import dataclass

from bench.experiments.findings_costs import INTERVAL, LOOKS, SHARE
from bench.experiments.findings_determinism import DIFFERENT, GATHER
from bench.measure.costs_timing import LEAST, MOST, RATIO
from bench.store.results import Measure, by_configuration
from plots.core.data import Results, Source
from plots.findings.points import source_with


@dataclass(frozen=True)
class Cost:
    """What one way of doing the same steps takes. `way`: of the field `sums`, empty for looks; `ratio`, `least`, `most`:
    time of a step over the first way's; `share`, `interval`: of looks; `different`: runs that ended in other bits;
    `suspect`: something is wrong with a sample (other programs ran, it was short)."""

    backend: str
    precision: str
    way: str
    particles: int
    ratio: float
    least: float
    most: float
    share: float | None
    interval: int
    different: int | None
    suspect: bool


def costs(source: Source, finding: str, backend: str | None = None) -> list[Cost]:
    """The costs of a finding (of one backend), small grids first, without the first way of each comparison."""
    held = by_configuration(
        m for m in source.measures if m.description.get("finding") == finding and backend in (None, m.backend)
    )
    found = [cost for numbers in held if (cost := _cost(numbers))]
    return sorted(found, key=lambda cost: (cost.backend, cost.precision, cost.way, cost.particles))


def _cost(numbers: dict[str, Measure]) -> Cost | None:
    if RATIO not in numbers or numbers[RATIO].value is None:
        return None
    description = numbers[RATIO].description
    way = description.get("sums", "")
    if way == GATHER or description.get("looks") is False:
        return None
    grid = next(t for t in description["scene"].values() if isinstance(t, dict) and "rows" in t)
    value = {name: measure.value for name, measure in numbers.items() if measure.value is not None}
    different = value.get(DIFFERENT)
    return Cost(
        backend=description["backend"],
        precision=description["precision"],
        way=way,
        particles=grid["rows"] * grid["columns"],
        ratio=value[RATIO],
        least=value[LEAST],
        most=value[MOST],
        share=value.get(SHARE),
        interval=int(value.get(INTERVAL, 0)),
        different=None if different is None else int(different),
        suspect="; " in (numbers[RATIO].reason or ""),
    )


def source_of(results: Results, finding: str, backend: str | None = None) -> Source | None:
    """The first source that holds a finding (of a backend), featured ones first."""
    return source_with(results, lambda source: bool(costs(source, finding, backend)))


def look_costs(source: Source, backend: str | None = None) -> list[Cost]:
    """Those of looking for a diverged state."""
    return [cost for cost in costs(source, LOOKS, backend) if cost.share is not None]
