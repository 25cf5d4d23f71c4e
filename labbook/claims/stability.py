"""Claims of the lab book on stability; rules in labbook/claims/claim.py."""

from __future__ import annotations

from math import isfinite

from softlab.bench.experiments.stability.points import Edge, MapPoint, disagreements
from softlab.bench.measure import words
from softlab.bench.measure.words import percent, seconds, times
from softlab.labbook.claims.claim import Claim, Claims, committed_of
from softlab.plots.core.data import Results, needed
from softlab.plots.figures.stability import stability_runs

CLAIMS = Claims()
CLOSE = 0.01  # largest relative difference of a measured edge from the analytic one
TRAP, REPAIR = "taylor", "semi-implicit-euler"


def chapter_runs(results: Results) -> tuple[list[MapPoint], list[Edge]]:
    """Return the map and the edges of the chapter."""
    points, edges, _ = stability_runs(results)
    return points, edges


def _where(results: Results, entries: list[Edge] | list[MapPoint]) -> str:
    """Return e.g. `on the CPU and the GPU (committed), in float32 and float64`."""
    sources = stability_runs(results)[2]
    backends = [
        name.upper() + committed_of(sources, name)
        for name in ("cpu", "gpu")
        if any(e.place.backend == name for e in entries)
    ]
    precisions = [name for name in ("float32", "float64") if any(e.place.precision == name for e in entries)]
    return f"on the {words.listed(backends).replace(' and ', ' and the ')}, in {words.listed(precisions)}"


@CLAIMS.add("stability-edges", "The edges of the linear chain were not measured.")
def edges(results: Results) -> Claim:
    """Largest difference of the measured edges of the chain from the analytic limits."""
    chain = needed([e for e in chapter_runs(results)[1] if e.place.chain])
    worst = max(chain, key=lambda e: abs(e.off))
    numbers = {"worst": abs(worst.off), "edges": len(chain)}
    names = dict.fromkeys(e.place.integrator for e in chain)
    if not isfinite(worst.off) or abs(worst.off) > CLOSE:
        text = (
            f"Of the {len(chain)} edges measured {_where(results, chain)}, that of {worst.place.integrator} lies "
            f"{percent(abs(worst.off))} off the analytic one, farther than the {percent(CLOSE)} that bisection allows for."
        )
        return Claim(text, numbers, False)
    text = (
        f"The edges found by bisection on the chain, {len(chain)} of them for {len(names)} integrators "
        f"{_where(results, chain)}, lie within {percent(abs(worst.off))} of the analytic limits."
    )
    return Claim(text, numbers, True)


@CLAIMS.add("stability-under", "The map of stability was not measured.")
def under(results: Results) -> Claim:
    """Runs that diverged at or below their limit."""
    safe = [p for p in needed(chapter_runs(results)[0]) if not p.over]
    lost = [p for p in safe if p.lost]
    numbers = {"under": len(safe), "diverged": len(lost)}
    if lost:
        names = words.listed(list(dict.fromkeys(p.place.integrator for p in lost)))
        text = (
            f"Of the {len(safe)} runs at or under the limit, {len(lost)} grew or diverged all the same, with {names}."
        )
        return Claim(text, numbers, True)
    return Claim(f"Not one of the {len(safe)} runs at or under the limit grew or diverged.", numbers, bool(safe))


@CLAIMS.add("stability-over", "No run was over its limit.")
def over(results: Results) -> Claim:
    """Runs above the limit that stayed bounded: the margin of the bound for any state on this grid."""
    points = needed([p for p in chapter_runs(results)[0] if p.over and p.place.limit > 0])
    lost = [p for p in points if p.lost]
    numbers: dict[str, float] = {"over": len(points), "diverged": len(lost)}
    bounded = [p for p in points if not p.diverged]
    text = f"Of the {len(points)} runs over it, {len(lost)} diverged or grew"
    if not bounded:
        return Claim(f"{text}: here the bound for any state is the edge itself.", numbers, True)
    farthest = max(bounded, key=lambda p: p.place.dt / p.place.limit)
    numbers["farthest"] = farthest.place.dt / farthest.place.limit
    text += (
        f"; the others stayed bounded, with step sizes up to {times(numbers['farthest'])} the limit "
        f"({farthest.place.integrator}): near rest, a bound that holds in any state leaves a margin."
    )
    return Claim(text, numbers, True)


@CLAIMS.add("stability-backends", "", ("backend", "on one backend"))
@CLAIMS.add("stability-precisions", "", ("precision", "in one precision"))
def agreement(results: Results, between: str, one: str) -> Claim:
    """Number of points at which backends, or precisions, differ."""
    differing, shared = disagreements(chapter_runs(results)[0], between)
    needed(shared, f"The map was run {one} only, so {between}s were not compared.")
    differ = f"{differing} of {shared} points differ" if differing else f"none of {shared} points differs"
    numbers = {"differing": differing, "shared": shared}
    return Claim(f"Between {between}s, {differ} on what diverged.", numbers, True)


@CLAIMS.add("stability-trap", f"The edges of {TRAP} and {REPAIR} were not both measured, or do not differ as expected.")
def trap(results: Results) -> Claim:
    """Step size at the edge of taylor and of semi-implicit Euler, damped: the cost of the plausible repair."""
    chain = [e for e in chapter_runs(results)[1] if e.place.chain and e.place.damping > 0]
    first = {name: next((e for e in chain if e.place.integrator == name), None) for name in (TRAP, REPAIR)}
    short, long = needed(first[TRAP]), needed(first[REPAIR])
    needed(0 < short.measured < long.measured)
    ratio = long.measured / short.measured
    text = (
        f"On the damped chain, {TRAP} breaks at {seconds(short.measured)} and {REPAIR}, at the same cost, at "
        f"{seconds(long.measured)}: {times(ratio)} the step size."
    )
    return Claim(text, {"ratio": ratio}, True)


@CLAIMS.add("stability-first-loss", "No run of the map was made.")
def first_loss(results: Results) -> Claim:
    """Number of steps until divergence is detected."""
    diverged = [p.step for p in needed(chapter_runs(results)[0]) if p.step is not None]
    steps = sorted(needed(diverged, "No run of the map diverged."))
    middle, last = steps[len(steps) // 2], steps[-1]
    text = (
        f"Half of the runs that diverge do so within {words.count(middle)} steps, the last after {words.count(last)}."
    )
    return Claim(text, {"median": middle, "last": last}, True)
