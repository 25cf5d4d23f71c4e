"""Claims of the lab book on position-based cloth (`softlab projections`); rules in labbook/claims/claim.py."""

from __future__ import annotations

from softlab.bench.experiments.discretisation import BIAS, DIAGONALS, FINDING, RATIO, exact_ratio
from softlab.bench.experiments.projections import ProjectionPoint
from softlab.bench.measure import words
from softlab.labbook.claims.claim import Claim, Claims, where
from softlab.plots.core.data import Results
from softlab.plots.figures.projections import panels

SIZE = 256  # rows and columns of the sheet whose rates are quoted
NAMES = {"gauss-seidel": "coloured Gauss-Seidel", "jacobi": "Jacobi"}


def _point(rows: list[ProjectionPoint], ordering: str, neighbours: int, iterations: int) -> ProjectionPoint | None:
    wanted = (SIZE, SIZE, ordering, neighbours, 10, iterations)
    keys = ((p.rows, p.columns, p.ordering, p.neighbours, p.substeps, p.iterations) for p in rows)
    return next((p for p, key in zip(rows, keys, strict=True) if key == wanted), None)


def _rate(value: float) -> str:
    """Return e.g. `2 420 million projections a second`."""
    return f"{words.number(value / 1e6)} million projections a second"


def rates(results: Results) -> Claim:
    """Projections per second of both orderings on each backend, at one size."""
    parts: list[str] = []
    numbers: dict[str, float] = {}
    for backend, source, rows in panels(results):
        texts = []
        for ordering, name in NAMES.items():
            point = _point(rows, ordering, 4, 1)
            if point:
                numbers[f"{backend} {ordering}"] = point.rate
                texts.append(f"{name} does {_rate(point.rate)}")
        if texts:
            parts.append(f"on {where(backend, source)} {words.listed(texts)}")
    if not parts:
        return Claim("Projections were not timed at this size.")
    size = f"{SIZE}{words.SPACE}{words.TIMES}{words.SPACE}{SIZE}"
    return Claim(
        f"With springs to four neighbours, {size} masses and 10 substeps of one iteration: {'; '.join(parts)}.",
        numbers,
        True,
    )


def per_projection(results: Results) -> Claim:
    """Rate of Jacobi, all constraints at once, over that of Gauss-Seidel in colours, over all sizes."""
    parts: list[str] = []
    numbers: dict[str, float] = {}
    for backend, source, rows in panels(results):
        pairs: dict[tuple[int, ...], dict[str, float]] = {}
        for p in rows:
            if p.rows == p.columns and p.substeps == 10:
                pairs.setdefault((p.rows, p.neighbours, p.iterations), {})[p.ordering] = p.rate
        ratios = [both["jacobi"] / both["gauss-seidel"] for both in pairs.values() if set(NAMES) <= set(both)]
        if ratios:
            numbers |= {f"{backend} least": min(ratios), f"{backend} most": max(ratios)}
            parts.append(
                f"{words.number(min(ratios), 2)} to {words.times(max(ratios))} as many on {where(backend, source)}"
            )
    if not parts:
        return Claim("The two orderings were not timed side by side.")
    return Claim(
        f"Jacobi projects {words.listed(parts)} as Gauss-Seidel does in the same time, over sizes and neighbours; what its "
        "iterations are worth is another question.",
        numbers, True,
    )  # fmt: skip


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
    return Claim("What the way of cutting a sheet into triangles does was not measured.")


CLAIMS: Claims = {
    "projection-rates": rates,
    "projection-orderings": per_projection,
    "discretisation": discretisation,
}
