"""Claims of the lab book on threads next to another program (`softlab busy`); rules in labbook/claims/claim.py."""

from __future__ import annotations

from softlab.bench.experiments.busy import ALONE, LIMIT, NICED, SAME, BusyPoint, points
from softlab.labbook import words
from softlab.labbook.claims.claim import Claim, Claims
from softlab.plots.core.data import Results

NAMES = {
    ALONE: "with the cores to themselves",
    NICED: "beside a niced program",
    SAME: "beside one of the same priority",
}


def busy(results: Results) -> Claim:
    """Largest ratio of a step's time on all threads to that on one, for each kind of other program."""
    found: list[BusyPoint] = []
    for source in results.everyone:
        found = found or points(source.measures)
    if not found:
        return Claim("What another program costs threads was not measured.")
    parts, numbers = [], {}
    for kind, name in NAMES.items():
        mine = [p for p in found if p.beside == kind]
        if mine:
            worst = max(mine, key=lambda p: p.ratio)
            numbers[kind] = worst.ratio
            parts.append(f"{name} at most {words.number(worst.ratio)} times ({worst.scene})")
    policies = words.listed(sorted({p.wait_policy for p in found}))
    scenes, threads = len({p.scene for p in found}), words.listed(sorted({str(p.threads) for p in found}))
    text = (
        f"Compared with one thread under the same load, a step on {threads} threads takes {words.listed(parts)} as long: the "
        f"worst of {words.count(scenes)} scenes, wait policy {policies}."
    )
    supported = all(ratio <= LIMIT for kind, ratio in numbers.items() if kind != ALONE)
    return Claim(text, numbers, supported)


CLAIMS: Claims = {"busy": busy}
