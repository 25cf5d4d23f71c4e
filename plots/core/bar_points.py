"""The measures of `softlab bar` as rows: strips, jelly bars and laws, those that hang on no machine's speed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from bench.experiments.bar import BODY, LAW, STRIP
from bench.experiments.bar_body import rod_swing, standing_sag
from bench.experiments.bar_strip import ACROSS, FREQUENCY, REFUSED, SAG, beam_tip, rod_frequency, rod_sag
from bench.store.results import Measure
from plots.core.data import Results, Source, judgements


@dataclass(frozen=True)
class Bar:
    """One strip, jelly bar (`solver` JELLY) or law. `fine`: links or layers along it; `size`: region, or overlap, of the
    clusters; `law`: of a law's row, else empty; `values`: measures by name; `refused`: why there are none."""

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
        """SAG, FREQUENCY or ACROSS over what the material's closed form says; None where it was not measured."""
        value = self.values.get(name)
        return None if value is None else value / self.exact(name)

    def exact(self, name: str) -> float:
        """The closed form [m, 1/s] of the material."""
        if self.solver == JELLY:
            return standing_sag(self.fine) if name == SAG else rod_swing()
        return {SAG: rod_sag, FREQUENCY: rod_frequency, ACROSS: beam_tip}[name]()


JELLY = "jelly bar"
Key = tuple[str, str, str, int, float, int, str]  # the first fields of a Bar


def bars(results: Results) -> tuple[list[Bar], tuple[Source, ...]]:
    """All rows, of each backend one machine's, and their sources."""
    found, sources = judgements(results, lambda m: m.description.get("finding") in (STRIP, BODY, LAW))
    held: dict[Key, list[Measure]] = {}
    for measure in found:
        held.setdefault(_key(measure.description), []).append(measure)
    return [_bar(key, measures) for key, measures in held.items()], sources


def _key(told: dict[str, Any]) -> Key:
    jelly = told["finding"] == BODY
    return (
        told["backend"], told["precision"], JELLY if jelly else str(told.get("solver", "")),
        int(told.get("layers", told.get("links", 0))), float(told.get("overlap", told.get("region", 0))),
        int(told["substeps"]), str(told.get("law", "")),
    )  # fmt: skip


def _bar(key: Key, measures: list[Measure]) -> Bar:
    values = {m.name: m.value for m in measures if m.value is not None and math.isfinite(m.value)}
    reasons = [m.reason for m in measures if m.value is None and m.reason and m.reason.startswith(REFUSED)]
    return Bar(*key, values, next(iter(reasons), ""))


def first_backend(found: list[Bar]) -> list[Bar]:
    """Of rows that both backends have, one's: exact math makes them the same."""
    return [bar for bar in found if bar.backend == found[0].backend]


def series(found: list[Bar], solver: str, by: Callable[[Bar], float], **fixed: float) -> list[Bar]:
    """The rows of a solver with these fields, in the order of `by`."""
    mine = [bar for bar in found if bar.solver == solver and all(getattr(bar, k) == v for k, v in fixed.items())]
    return sorted(mine, key=by)
