"""Rows of `softlab bar` from the store: strips, bars of jelly and of tetrahedra, laws; none depends on speed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from rich.console import Console

from softlab.bench.experiments.bar import BODY, ELEMENTS, LAW, STRIP, items
from softlab.bench.experiments.bar_body import rod_swing, standing_sag
from softlab.bench.experiments.bar_strip import ACROSS, FREQUENCY, REFUSED, SAG, beam_tip, rod_frequency, rod_sag
from softlab.bench.measure.items import Items
from softlab.bench.measure.tables import columns, print_table
from softlab.bench.store.database import Store
from softlab.bench.store.results import Measure, measures
from softlab.bench.store.schema import Description


@dataclass(frozen=True)
class Bar:
    """One strip, jelly bar (`solver` JELLY) or law.

    `fine`: links or layers along it; `size`: region or overlap of the clusters; `law`: name of the law, empty for other
    rows; `values`: measures by name; `refused`: the reason why there are none.
    """

    backend: str
    precision: str
    solver: str
    fine: int
    size: float
    substeps: int
    law: str = ""
    values: dict[str, float] = field(default_factory=dict)
    refused: str = ""

    def part(self, name: str) -> float | None:
        """Return SAG, FREQUENCY or ACROSS over the material's closed form; None where it was not measured."""
        value = self.values.get(name)
        return None if value is None else value / self.exact(name)

    def exact(self, name: str) -> float:
        """Return the closed form [m, 1/s] of the material."""
        if self.solver == JELLY:
            return standing_sag(self.fine) if name == SAG else rod_swing()
        return {SAG: rod_sag, FREQUENCY: rod_frequency, ACROSS: beam_tip}[name]()


JELLY = "jelly bar"
Key = tuple[str, str, str, int, float, int, str]  # the first fields of a Bar


def is_bar(measure: Measure) -> bool:
    """True if the measure belongs to this experiment."""
    return measure.description.get("finding") in (STRIP, BODY, LAW, ELEMENTS)


def rows(stored: Iterable[Measure]) -> list[Bar]:
    """Return the strips, bars and laws of the measures, in the order of their first one."""
    by_key: dict[Key, list[Measure]] = {}
    for measure in stored:
        by_key.setdefault(_key(measure.description), []).append(measure)
    return [_bar(key, of) for key, of in by_key.items()]


def _first(description: Description, names: Sequence[str]) -> float:
    """Return the first of these fields that a configuration has, else 0."""
    return next((description[name] for name in names if name in description), 0)


def _key(description: Description) -> Key:
    jelly = description["finding"] == BODY
    return (
        description["backend"], description["precision"], JELLY if jelly else str(description.get("solver", "")),
        int(_first(description, ("layers", "links"))),
        float(_first(description, ("overlap", "region"))),
        int(description["substeps"]), str(description.get("law", "")),
    )  # fmt: skip


def _bar(key: Key, measures: list[Measure]) -> Bar:
    values = {m.name: m.value for m in measures if m.value is not None and math.isfinite(m.value)}
    reasons = [m.reason for m in measures if m.value is None and m.reason and m.reason.startswith(REFUSED)]
    return Bar(*key, values, next(iter(reasons), ""))


def first_backend(bars: list[Bar]) -> list[Bar]:
    """Return the rows of the backend that has most: exact math makes the values of both equal."""
    names = [bar.backend for bar in bars]
    chosen = max(names, key=names.count) if names else ""
    return [bar for bar in bars if bar.backend == chosen]


def series(bars: list[Bar], solver: str, by: Callable[[Bar], float], fixed: Mapping[str, float]) -> list[Bar]:
    """Return the rows of a solver with these fields, in the order of `by`."""
    selected = [bar for bar in bars if bar.solver == solver and all(getattr(bar, k) == v for k, v in fixed.items())]
    return sorted(selected, key=by)


def print_bar(console: Console, store: Store, machine: str) -> None:
    """Print a table of what was measured on a machine: each number over the material's closed form."""
    bars = rows(m for m in measures(store, machine=machine) if is_bar(m))
    shown = sorted((bar for bar in bars if not bar.law), key=lambda b: (b.solver, b.fine, b.size, b.substeps))
    lines = []
    for bar in shown:
        parts = (bar.part(name) for name in (SAG, FREQUENCY, ACROSS))
        cells = ["-" if part is None else f"{part:.3f}" for part in parts]
        size = f"{bar.size:g}" if bar.solver in (JELLY, "shape-matching") else ""
        lines.append([bar.solver, bar.backend, str(bar.fine), size, str(bar.substeps), *cells])
    heads = columns(("solver", "on"), ("links", "clusters", "substeps", "sag", "frequency", "shear"))
    print_table(console, heads, lines, title="over what the material's closed form says")
    for bar in shown:
        if bar.refused:
            where = f"{bar.solver}, {bar.fine} links, {bar.substeps} substeps on the {bar.backend}"
            console.print(f"{where}: {bar.refused}", soft_wrap=True, markup=False)
    console.print(
        "clusters: half-width of a window, of the jelly bar radius over spacing; softlab figures draws it, "
        "softlab labbook describes it and the laws",
        soft_wrap=True,
    )


class BarMaterial(Items):
    """Compare sag, frequency and shear of one bar under every method with the theory of its material; also the cost."""

    name = command = "bar"
    example = "softlab bar --quick   (softlab bar --backend cpu)"
    quick_help = "Few spacings, substeps and clusters, no bending, float64 only: under a minute on two cores."
    in_lab = True
    items = staticmethod(items)
    show = staticmethod(print_bar)
