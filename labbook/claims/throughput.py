"""Claims of the lab book on the speed of bodies (`softlab throughput`); rules in labbook/claims/claim.py."""

from __future__ import annotations

from softlab.bench.experiments.throughput import ThroughputPoint
from softlab.bench.measure import words
from softlab.labbook.claims.claim import Claim, Claims, where
from softlab.plots.core.data import Results
from softlab.plots.figures.throughput import panels


def heaps(results: Results) -> Claim:
    """Frames per second of heaps that collide, the smallest and the largest."""
    parts: list[str] = []
    numbers: dict[str, float] = {}
    for backend, source, rows in panels(results):
        of_kind = [p for p in rows if p.kind == "heap"]
        texts = []
        for point in of_kind[:: max(1, len(of_kind) - 1)]:
            numbers[f"{backend} {point.bodies}"] = 1 / point.step
            texts.append(
                f"{words.count(point.bodies)} bodies of {words.count(point.particles)} particles do "
                f"{words.number(1 / point.step)} frames a second"
            )
        if texts:
            parts.append(f"on {where(backend, source)} {words.listed(texts)}")
    if not parts:
        return Claim("Heaps of bodies were not timed.")
    return Claim(f"In a heap, with contacts and two substeps a frame: {'; '.join(parts)}.", numbers, True)


def clusters(results: Results) -> Claim:
    """Time of a step of bodies without contacts: the cost of clusters."""
    parts: list[str] = []
    numbers: dict[str, float] = {}
    for backend, source, rows in panels(results):
        both = {p.kind: p for p in rows if p.bodies == 50 and p.kind in ("soft", "rigid")}
        if set(both) == {"soft", "rigid"}:
            numbers |= {f"{backend} {kind}": p.step for kind, p in both.items()}
            parts.append(
                f"{words.seconds(both['rigid'].step)} as rigid ones and {words.seconds(both['soft'].step)} as soft ones "
                f"on {where(backend, source)}"
            )
    if not parts:
        return Claim("Clusters alone were not timed.")
    return Claim(f"A step of fifty free bodies takes {words.listed(parts)}.", numbers, True)


def contacts(results: Results) -> Claim:
    """Cost of contacts: a substep of a heap over one of the same bodies without contacts."""
    parts: list[str] = []
    numbers: dict[str, float] = {}
    for backend, source, rows in panels(results):
        ratios = [(heap.bodies, _ratio(heap, rows)) for heap in rows if heap.kind == "heap"]
        by_bodies = {bodies: ratio for bodies, ratio in ratios if ratio is not None}
        if by_bodies:
            numbers |= {f"{backend} {bodies}": ratio for bodies, ratio in by_bodies.items()}
            span = sorted({min(by_bodies.values()), max(by_bodies.values())})
            parts.append(f"{' to '.join(words.times(ratio) for ratio in span)} on {where(backend, source)}")
    if not parts:
        return Claim("What contacts cost was not timed.")
    return Claim(f"With contacts a substep takes {words.listed(parts)} as long as without.", numbers, True)


def _ratio(heap: ThroughputPoint, rows: list[ThroughputPoint]) -> float | None:
    free = next((p for p in rows if p.kind == "soft" and p.bodies == heap.bodies), None)
    return free.rate / heap.rate if free else None


CLAIMS: Claims = {
    "throughput-heaps": heaps,
    "throughput-clusters": clusters,
    "throughput-contacts": contacts,
}
