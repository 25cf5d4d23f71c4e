"""Claim of the lab book on how a sheet is cut into triangles; rules in labbook/claims/claim.py."""

from __future__ import annotations

from softlab.bench.experiments.discretisation import BIAS, DIAGONALS, FINDING, RATIO, exact_ratio
from softlab.bench.measure import words
from softlab.labbook.claims.claim import Claim, Claims
from softlab.plots.core.data import Results, Source, needed

CLAIMS = Claims()


def _values(source: Source) -> dict[tuple[str, str], float]:
    """Return the measures of both cuts by (cut, name), nothing if one is missing."""
    measures = [m for m in source.measures if m.description.get("finding") == FINDING and m.value is not None]
    values = {(m.description["diagonals"], m.name): m.value or 0.0 for m in reversed(measures)}
    return values if {(cut, name) for cut in DIAGONALS for name in (BIAS, RATIO)} <= set(values) else {}


@CLAIMS.add("discretisation", "What the way of cutting a sheet into triangles does was not measured.")
def discretisation(results: Results) -> Claim:
    """Effect of cutting a sheet along one diagonal, or along alternating ones."""
    _, values = needed(results.first_with(_values))
    (one, both), ratios = ([values[cut, name] for cut in DIAGONALS] for name in (BIAS, RATIO))
    exact = [words.number(exact_ratio(cut)) for cut in DIAGONALS]
    text = (
        f"A square sheet held at its corners sags to its own mirror image. Cut along one diagonal it lies "
        f"{words.number(one, 2)} spacings off its mirror image, with alternating diagonals {words.number(both, 2)}; "
        f"against a stretch along the diagonals it is {words.times(ratios[0])} as stiff as across them (exact: "
        f"{exact[0]}), with alternating ones {words.times(ratios[1])} (exact: {exact[1]})."
    )
    numbers = {"one": one, "alternating": both, "ratio one": ratios[0], "ratio alternating": ratios[1]}
    return Claim(text, numbers, one > both)
