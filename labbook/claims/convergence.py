"""What the lab book may say about position-based solvers; see labbook/claims/claim.py for the rules."""

from __future__ import annotations

from collections.abc import Callable

from bench.experiments.accuracy.methods import XPBD
from bench.experiments.accuracy.points import method_words
from bench.experiments.convergence import colours
from labbook import words
from labbook.claims.claim import Claim, on_gpu
from labbook.words import number, seconds
from plots.core.accuracy_points import Point, observed_order, points, reaching
from plots.core.data import Results
from plots.figures.convergence import Converging, converging, least_common, seconds_to, source_of
from plots.figures.work_precision import accurate_source

NAMES = {"xpbd gauss-seidel": "Gauss-Seidel", "xpbd jacobi": "Jacobi", "xpbd averaged-jacobi": "averaged Jacobi"}
EQUAL = 0.1  # errors that differ by less of themselves count as the same
NEAR = 0.25  # how far an observed order may be from 1 to count as it
SCENE = "S1"


def _ways(results: Results, name: str, scene: str = SCENE) -> list[Point]:
    """The runs in float64 on the first backend of an ordering, of the source that the accuracy chapter is about."""
    source = accurate_source(results)
    found = points(source, scene) if source else []
    for backend in ("cpu", "gpu"):
        mine = [p for p in found if (p.integrator, p.precision, p.backend) == (name, "float64", backend)]
        if mine:
            return mine
    return []


def iterations_or_substeps(results: Results) -> Claim:
    """What more iterations and what smaller steps do to the error against Newton's law."""
    mine = [p for p in _ways(results, XPBD[0]) if not p.diverged and p.iterations]
    at = {(p.dt, p.iterations): p for p in mine}
    counts = sorted({p.iterations or 0 for p in mine})
    sizes = sorted({p.dt for p in mine}, reverse=True)
    if len(counts) < 3 or len(sizes) < 2 or not all((sizes[0], n) in at for n in counts):
        return Claim("What iterations of xpbd are worth was not measured.")
    few, some, many = (at[sizes[0], n] for n in (counts[0], counts[-2], counts[-1]))
    same = abs(some.error / many.error - 1) < EQUAL
    text = (
        f"In {SCENE} at {seconds(sizes[0], 2)}, coloured Gauss-Seidel is {number(few.error, 2)} spacings off with "
        f"{words.count(counts[0])} iteration{'s' if counts[0] > 1 else ''} a step, {number(some.error, 2)} with "
        f"{words.count(counts[-2])} and {number(many.error, 2)} with {words.count(counts[-1])}"
    )
    text += ": more of them buy nothing there" if same else ""
    numbers = {"few": few.error, "some": some.error, "many": many.error}
    if many.solver is not None and some.solver is not None:
        numbers |= {"solver some": some.solver, "solver many": many.solver}
        text += (
            f" (what the iterations leave over falls from {number(some.solver, 2)} to {number(many.solver, 2)}; the rest is "
            "the scheme's own error)"
        )
    order = observed_order([(p.dt, p.error) for p in mine if p.iterations == counts[-1] and p.resolved])
    if order is not None:
        numbers["order"] = order
        text += f". With smaller steps the error falls by order {order:.2f}"
        text += ", as implicit Euler's does" if abs(order - 1) < NEAR else ""
    return Claim(f"{text}.", numbers, same)


def wrong_ordering(results: Results) -> Claim:
    """What averaged Jacobi converges to."""
    wrong, right = ([p for p in _ways(results, name) if not p.diverged and p.iterations] for name in (XPBD[2], XPBD[1]))
    if not wrong or not right:
        return Claim("Averaged Jacobi was not held against Newton's law.")
    n, dt = max(p.iterations or 0 for p in wrong), min(p.dt for p in wrong)
    pair = [next((p for p in found if (p.iterations, p.dt) == (n, dt)), None) for found in (wrong, right)]
    if pair[0] is None or pair[1] is None:
        return Claim("Averaged Jacobi was not held against Newton's law.")
    off, good = pair[0].error, pair[1].error
    text = (
        f"Jacobi that averages the displacements of a mass is {number(off, 2)} spacings off in {SCENE} at {seconds(dt, 2)} "
        f"with {words.count(n)} iterations, where weights by the valence leave {number(good, 2)}"
    )
    worse = off > 2 * good
    text += ": with compliance it converges to another stiffness" if worse else ""
    return Claim(f"{text}.", {"averaged": off, "weighted": good}, worse)


def against_integrators(results: Results, target: float = 1e-2) -> Claim:
    """The soonest position-based way to an error against the soonest integrator."""
    source = accurate_source(results)
    parts: list[str] = []
    numbers: dict[str, float] = {}
    for scene in ("S1", "S2", "S4", "S5"):
        able = reaching(points(source, scene), target) if source else []
        ways = [next((p for p in able if (p.integrator in XPBD) is xpbd), None) for xpbd in (True, False)]
        if ways[0] is None or ways[1] is None:
            continue
        ratio = (ways[0].seconds or 0.0) / (ways[1].seconds or 1.0)
        numbers[scene] = ratio
        way = method_words(ways[0].integrator, ways[0].iterations)
        parts.append(f"in {scene} {way} takes {words.times(ratio)} as long as {ways[1].integrator}")
    if not parts:
        return Claim("Position-based ways were not timed beside integrators.")
    text = f"To an error of {number(target, 1)} spacings, {words.listed(parts)}, each by its soonest configuration."
    return Claim(text, numbers, True)


def orderings(results: Results) -> Claim:
    """Which ordering is first at the residual that all reach, size by size, on each backend."""
    parts: list[str] = []
    numbers: dict[str, float] = {}
    busy = False
    for backend in ("cpu", "gpu"):
        source = source_of(results, backend)
        if source is None:
            continue
        found = converging(source, backend)
        told = [_first(found, side, backend, numbers) for side in sorted({e.side for e in found})]
        busy = busy or any(e.suspect for e in found)
        where = on_gpu(source) if backend == "gpu" else "On the CPU"
        parts.append(f"{where}, {words.listed([text for text in told if text])}")
    if not parts:
        return Claim("The orderings were not compared at equal residuals.")
    text = (
        f"At equal residuals (the least that all three reach) coloured Gauss-Seidel, in {colours()} colours, and Jacobi "
        f"compare so. {'. '.join(parts)}."
    )
    text += " Some of it was measured on a busy machine." if busy else ""
    return Claim(text, numbers, not busy)


def _first(found: list[Converging], side: int, backend: str, numbers: dict[str, float]) -> str:
    """`at 64 x 64 Jacobi takes 2.1 times as long as Gauss-Seidel to 12 % of the stretch`."""
    mine = {name: [e for e in found if (e.name, e.side) == (name, side)] for name in NAMES}
    held = {name: entries for name, entries in mine.items() if entries}
    if XPBD[0] not in held or len(held) < 2:
        return ""
    left = least_common(list(held.values()))
    base = seconds_to(held[XPBD[0]], left)
    told = []
    for name, entries in held.items():
        its = seconds_to(entries, left)
        if name != XPBD[0] and its and base:
            numbers[f"{backend} {side} {name}"] = its / base
            told.append(f"{NAMES[name]} {words.times(its / base)}")
    return f"at {side} x {side}, down to {words.percent(left)} of the stretch, {words.listed(told)} Gauss-Seidel's time"


CLAIMS: dict[str, Callable[[Results], Claim]] = {
    "xpbd-iterations": iterations_or_substeps,
    "xpbd-wrong": wrong_ordering,
    "xpbd-integrators": against_integrators,
    "xpbd-orderings": orderings,
}
