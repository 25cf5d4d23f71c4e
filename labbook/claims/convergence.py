"""Claims of the lab book on position-based solvers; rules in labbook/claims/claim.py."""

from __future__ import annotations

from softlab.bench.experiments.accuracy.methods import XPBD
from softlab.bench.experiments.accuracy.points import method_words
from softlab.bench.experiments.convergence import colours
from softlab.bench.measure import words
from softlab.bench.measure.words import number, seconds
from softlab.labbook.claims.claim import MARK, Claim, Claims, named, suspicion
from softlab.plots.core.accuracy_points import Point, observed_order, points, reaching
from softlab.plots.core.data import Results, Source, needed

CLAIMS = Claims()
EQUAL = 0.1  # largest relative difference of errors that count as equal
NEAR = 0.25  # largest difference of an observed order from 1 that counts as agreement
SCENE = "S1"
PRECISIONS = ("float32", "float64")
STIFF = "S4"  # the scene on which the orderings are compared
ORDERING_TARGETS = (1.0, 0.3, 0.1, 0.03, 0.01)  # spacings


def _ordering_runs(results: Results, name: str) -> list[Point]:
    """Return the float64 runs of an ordering that did not diverge, from the first source and backend that has any.

    An error does not depend on the machine.
    """
    for source in results.everyone:
        runs = [p for p in points(source, SCENE) if (p.integrator, p.precision) == (name, "float64")]
        for backend in ("cpu", "gpu"):
            if on_one := [p for p in runs if p.backend == backend]:
                return [p for p in on_one if not p.diverged and p.iterations]
    return []


@CLAIMS.add("xpbd-iterations", "The value of more xpbd iterations for a whole motion was not measured.")
def iterations_or_substeps(results: Results) -> Claim:
    """Effect of more iterations and of smaller steps on the error against Newton's law."""
    runs = _ordering_runs(results, XPBD[0])
    at = {(p.dt, p.iterations): p for p in runs}
    counts = sorted({p.iterations or 0 for p in runs})
    sizes = sorted({p.dt for p in runs}, reverse=True)
    needed(len(counts) > 2 and len(sizes) > 1 and all((sizes[0], n) in at for n in counts))
    few, some, many = (at[sizes[0], n] for n in (counts[0], counts[-2], counts[-1]))
    same = abs(some.error / many.error - 1) < EQUAL
    text = (
        f"In {SCENE} at {seconds(sizes[0], 2)}, coloured Gauss-Seidel is {number(few.error, 2)} spacings off with "
        f"{words.count(counts[0])} iteration{'s' if counts[0] > 1 else ''} a step, {number(some.error, 2)} with "
        f"{words.count(counts[-2])} and {number(many.error, 2)} with {words.count(counts[-1])}"
    )
    text += ": more iterations gain nothing there" if same else ""
    numbers = {"few": few.error, "some": some.error, "many": many.error}
    if many.solver is not None and some.solver is not None:
        numbers |= {"solver some": some.solver, "solver many": many.solver}
        text += (
            f" (the error of the iterations falls from {number(some.solver, 2)} to {number(many.solver, 2)}; the rest is the "
            "error of the scheme)"
        )
    order = observed_order([(p.dt, p.error) for p in runs if p.iterations == counts[-1] and p.resolved])
    if order is not None:
        numbers["order"] = order
        text += f". With smaller steps the error falls by order {order:.2f}"
        text += ", as implicit Euler's does" if abs(order - 1) < NEAR else ""
    return Claim(f"{text}.", numbers, same)


@CLAIMS.add("xpbd-wrong", "Averaged Jacobi was not compared with Newton's law.")
def wrong_ordering(results: Results) -> Claim:
    """Limit to which averaged Jacobi converges."""
    wrong, right = (needed(_ordering_runs(results, name)) for name in (XPBD[2], XPBD[1]))
    n, dt = max(p.iterations or 0 for p in wrong), min(p.dt for p in wrong)
    off, good = (
        needed(next((p for p in runs if (p.iterations, p.dt) == (n, dt)), None)).error for runs in (wrong, right)
    )
    text = (
        f"Jacobi that averages the displacements of a mass is {number(off, 2)} spacings off in {SCENE} at {seconds(dt, 2)} "
        f"with {words.count(n)} iterations, where weights by the valence leave {number(good, 2)}"
    )
    worse = off > 2 * good
    text += ": with compliance it converges to another stiffness" if worse else ""
    return Claim(f"{text}.", {"averaged": off, "weighted": good}, worse)


def _losses(source: Source) -> list[tuple[float, Point, Point, Point]]:
    """Return (finest error over least, least, finest, finest in float64) of the methods that float32 makes worse."""
    runs = [p for p in points(source) if p.integrator in XPBD[:2] and not p.diverged and not p.refused and p.iterations]
    methods = {(p.scene, p.integrator, p.iterations, p.backend) for p in runs}
    losses = []
    for method in sorted(methods, key=str):
        same_method = [p for p in runs if (p.scene, p.integrator, p.iterations, p.backend) == method]
        single, double = (
            sorted((p for p in same_method if p.precision == name), key=lambda p: p.dt) for name in PRECISIONS
        )
        least = min(single, key=lambda p: p.error, default=None)
        same = next((p for p in double if single and p.dt == single[0].dt), None)
        if least is not None and same is not None and least.dt > single[0].dt and same.error <= least.error:
            losses.append((single[0].error / least.error, least, single[0], same))
    return losses


@CLAIMS.add("xpbd-float32", "Whether float32 bounds position-based steps was not measured.")
def in_float32(results: Results) -> Claim:
    """Largest loss of accuracy of position-based steps in float32 by smaller substeps."""
    _, losses = needed(results.first_with(_losses))
    ratio, least, finest, same = max(losses, key=lambda loss: loss[0])
    text = (
        f"In float32 smaller substeps can make positions worse: in {least.scene} "
        f"{method_words(least.integrator, least.iterations)} is {number(least.error, 2)} spacings off at "
        f"{seconds(least.dt, 2)} and {number(finest.error, 2)} at {seconds(finest.dt, 2)}, where float64 leaves "
        f"{number(same.error, 2)}"
    )
    return Claim(f"{text}.", {"ratio": ratio, "least": least.error, "finest": finest.error}, ratio > 2)


@CLAIMS.add("xpbd-integrators", "Position-based methods were not timed beside integrators.")
def against_integrators(results: Results, target: float = 1e-2) -> Claim:
    """Fastest position-based method that reaches an error, compared with the fastest integrator."""
    parts, numbers = list[str](), dict[str, float]()
    for scene in ("S1", "S2", "S4", "S5"):
        for source in results.everyone:
            able = reaching(points(source, scene), target)
            best = [next((p for p in able if (p.integrator in XPBD) is xpbd), None) for xpbd in (True, False)]
            if best[0] is not None and best[1] is not None:
                numbers[scene] = ratio = (best[0].seconds or 0.0) / (best[1].seconds or 1.0)
                method, _, effort = method_words(best[0].integrator, best[0].iterations).rpartition(", ")
                text = f"in {scene} {method} ({effort}) takes {words.times(ratio)} as long as {best[1].integrator}"
                text += f" ({source.place})"
                parts.append(text + suspicion(best, MARK))
                break
    text = f"To an error of {number(target, 1)} spacings, {words.listed(needed(parts))}, each by its fastest configuration."
    return Claim(text, numbers, True)


def _ordered_pairs(source: Source) -> dict[str, dict[float, list[Point]]]:
    """Return backend -> error -> the fastest run of each ordering that reaches it, where both do."""
    pairs: dict[str, dict[float, list[Point]]] = {}
    for backend in ("cpu", "gpu"):
        runs = [p for p in points(source, STIFF) if p.backend == backend]
        for target in ORDERING_TARGETS:
            able = reaching(runs, target)
            best = [p for name in XPBD[:2] for p in [q for q in able if q.integrator == name][:1]]
            if len(best) == 2:
                pairs.setdefault(backend, {})[target] = best
    return pairs


@CLAIMS.add("xpbd-orderings", "The orderings were not timed to equal errors.")
def orderings(results: Results) -> Claim:
    """Jacobi compared with coloured Gauss-Seidel on a stiff cloth, at equal error, each by its fastest configuration."""
    parts, numbers = list[str](), dict[str, float]()
    source, pairs = needed(results.first_with(_ordered_pairs))
    for backend, by_target in pairs.items():
        ratios = {target: (one.seconds or 0.0) / (base.seconds or 1.0) for target, (base, one) in by_target.items()}
        numbers |= {f"{backend} {target:g}": ratio for target, ratio in ratios.items()}
        low, high = min(ratios), max(ratios)
        least, most = min(ratios.values()), max(ratios.values())
        took = words.times(least) if least == most else f"{number(least, 2)} to {words.times(most)}"
        errors = f"{number(high, 1)}" if low == high else f"{number(high, 1)} to {number(low, 1)}"
        mark = suspicion([point for pair in by_target.values() for point in pair], MARK)
        parts.append(f"on the {named(source, backend)} Jacobi takes {took} as long (errors of {errors} spacings){mark}")
    text = (
        f"To the same error in {STIFF}, each by its fastest configuration and compared with Gauss-Seidel in {colours()} "
        f"colours: {words.listed(parts)}."
    )
    return Claim(text, numbers, True)
