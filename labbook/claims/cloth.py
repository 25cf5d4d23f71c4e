"""Claim of the lab book on how a sheet is cut into triangles; rules in labbook/claims/claim.py."""

from __future__ import annotations

from softlab.bench.experiments.discretisation import BIAS, DIAGONALS, FINDING, RATIO, exact_ratio
from softlab.bench.measure import words
from softlab.labbook.claims.claim import Claim, Claims
from softlab.plots.core.data import Results


def discretisation(results: Results) -> Claim:
    """Effect of cutting a sheet along one diagonal, or along alternating ones."""
    for source in results.everyone:
        measures = [m for m in source.measures if m.description.get("finding") == FINDING and m.value is not None]
        values = {(m.description["diagonals"], m.name): m.value for m in reversed(measures)}
        if {(cut, name) for cut in DIAGONALS for name in (BIAS, RATIO)} <= set(values):
            one, both = (values[cut, BIAS] or 0.0 for cut in DIAGONALS)
            ratios = [values[cut, RATIO] or 0.0 for cut in DIAGONALS]
            exact = [words.number(exact_ratio(cut)) for cut in DIAGONALS]
            return Claim(
                f"A square sheet held at its corners sags to its own mirror image. Cut along one diagonal it lies "
                f"{words.number(one, 2)} spacings off its mirror image, with alternating diagonals {words.number(both, 2)}; "
                f"against a stretch along the diagonals it is {words.times(ratios[0])} as stiff as across them (exact: "
                f"{exact[0]}), with alternating ones {words.times(ratios[1])} (exact: {exact[1]}).",
                {"one": one, "alternating": both, "ratio one": ratios[0], "ratio alternating": ratios[1]}, one > both,
            )  # fmt: skip
    return Claim("The effect of a sheet's diagonals was not measured.")


CLAIMS: Claims = {"discretisation": discretisation}
