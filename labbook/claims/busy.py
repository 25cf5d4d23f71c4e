"""Claims of the lab book on threads next to another program (`softlab busy`); rules in labbook/claims/claim.py."""

from __future__ import annotations

from softlab.bench.experiments.busy import ALONE, LIMIT, NICED, SAME, points
from softlab.bench.measure import words
from softlab.labbook.claims.claim import Claim, Claims
from softlab.plots.core.data import Results, needed

CLAIMS = Claims()
NAMES = {
    ALONE: "with the cores to themselves",
    NICED: "beside a niced program",
    SAME: "beside one of the same priority",
}


@CLAIMS.add("busy", "The effect of another program on threads was not measured.")
def busy(results: Results) -> Claim:
    """Largest ratio of a step's time on all threads to that on one, for each kind of other program."""
    _, measured = needed(results.first_with(lambda source: points(source.measures)))
    parts, numbers = [], {}
    for kind, name in NAMES.items():
        of_kind = [p for p in measured if p.beside == kind]
        if of_kind:
            worst = max(of_kind, key=lambda p: p.ratio)
            numbers[kind] = worst.ratio
            parts.append(f"{name} at most {words.number(worst.ratio)} times ({worst.scene})")
    policies = words.listed(sorted({p.wait_policy for p in measured}))
    scenes, threads = len({p.scene for p in measured}), words.listed(sorted({str(p.threads) for p in measured}))
    text = (
        f"Compared with one thread under the same load, a step on {threads} threads takes {words.listed(parts)} as long: the "
        f"worst of {words.count(scenes)} scenes, wait policy {policies}."
    )
    supported = all(ratio <= LIMIT for kind, ratio in numbers.items() if kind != ALONE)
    return Claim(text, numbers, supported)
