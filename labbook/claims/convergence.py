"""Claims of the lab book on position-based solvers; rules in labbook/claims/claim.py."""

from __future__ import annotations

from softlab.bench.experiments.accuracy.methods import XPBD
from softlab.bench.experiments.accuracy.points import method_words
from softlab.bench.experiments.convergence import colours
from softlab.bench.measure import words
from softlab.bench.measure.words import number, seconds
from softlab.labbook.claims.claim import MARK, Claim, Claims, named, suspicion
from softlab.plots.core.accuracy_points import Point, observed_order, points, reaching
from softlab.plots.core.data import Results

EQUAL = 0.1  # largest relative difference of errors that count as equal
NEAR = 0.25  # largest difference of an observed order from 1 that counts as agreement
SCENE = "S1"
PRECISIONS = ("float32", "float64")
STIFF = "S4"  # the scene on which the orderings are compared
ORDERING_TARGETS = (1.0, 0.3, 0.1, 0.03, 0.01)  # spacings


def _ordering_runs(results: Results, name: str, scene: str = SCENE) -> list[Point]:
    """Return the float64 runs of an ordering, from the first source and backend that has any.

    An error does not depend on the machine.
    """
    for source in results.everyone:
        for backend in ("cpu", "gpu"):
            runs = [
                p for p in points(source, scene) if (p.integrator, p.precision, p.backend) == (name, "float64", backend)
            ]
            if runs:
                return runs
    return []


def iterations_or_substeps(results: Results) -> Claim:
    """Effect of more iterations and of smaller steps on the error against Newton's law."""
    runs = [p for p in _ordering_runs(results, XPBD[0]) if not p.diverged and p.iterations]
    at = {(p.dt, p.iterations): p for p in runs}
    counts = sorted({p.iterations or 0 for p in runs})
    sizes = sorted({p.dt for p in runs}, reverse=True)
    if len(counts) < 3 or len(sizes) < 2 or not all((sizes[0], n) in at for n in counts):
        return Claim("The value of more xpbd iterations for a whole motion was not measured.")
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


def wrong_ordering(results: Results) -> Claim:
    """Limit to which averaged Jacobi converges."""
    wrong, right = (
        [p for p in _ordering_runs(results, name) if not p.diverged and p.iterations] for name in (XPBD[2], XPBD[1])
    )
    if not wrong or not right:
        return Claim("Averaged Jacobi was not compared with Newton's law.")
    n, dt = max(p.iterations or 0 for p in wrong), min(p.dt for p in wrong)
    pair = [next((p for p in runs if (p.iterations, p.dt) == (n, dt)), None) for runs in (wrong, right)]
    if pair[0] is None or pair[1] is None:
        return Claim("Averaged Jacobi was not compared with Newton's law.")
    off, good = pair[0].error, pair[1].error
    text = (
        f"Jacobi that averages the displacements of a mass is {number(off, 2)} spacings off in {SCENE} at {seconds(dt, 2)} "
        f"with {words.count(n)} iterations, where weights by the valence leave {number(good, 2)}"
    )
    worse = off > 2 * good
    text += ": with compliance it converges to another stiffness" if worse else ""
    return Claim(f"{text}.", {"averaged": off, "weighted": good}, worse)


def in_float32(results: Results) -> Claim:
    """Largest loss of accuracy of position-based steps in float32 by smaller substeps."""
    worst: tuple[float, Point, Point, Point] | None = None
    for source in results.everyone:
        runs = [
            p for p in points(source) if p.integrator in XPBD[:2] and not p.diverged and not p.refused and p.iterations
        ]
        methods = {(p.scene, p.integrator, p.iterations, p.backend) for p in runs}
        for method in sorted(methods, key=str):
            same_method = [p for p in runs if (p.scene, p.integrator, p.iterations, p.backend) == method]
            single, double = (
                sorted((p for p in same_method if p.precision == name), key=lambda p: p.dt) for name in PRECISIONS
            )
            least = min(single, key=lambda p: p.error, default=None)
            same = next((p for p in double if single and p.dt == single[0].dt), None)
            if least is None or same is None or least.dt <= single[0].dt or same.error > least.error:
                continue
            if worst is None or single[0].error / least.error > worst[0]:
                worst = single[0].error / least.error, least, single[0], same
        if worst is not None:
            break
    if worst is None:
        return Claim("Whether float32 bounds position-based steps was not measured.")
    ratio, least, finest, same = worst
    text = (
        f"In float32 smaller substeps can make positions worse: in {least.scene} "
        f"{method_words(least.integrator, least.iterations)} is {number(least.error, 2)} spacings off at "
        f"{seconds(least.dt, 2)} and {number(finest.error, 2)} at {seconds(finest.dt, 2)}, where float64 leaves "
        f"{number(same.error, 2)}"
    )
    return Claim(f"{text}.", {"ratio": ratio, "least": least.error, "finest": finest.error}, ratio > 2)


def against_integrators(results: Results, target: float = 1e-2) -> Claim:
    """Fastest position-based method that reaches an error, compared with the fastest integrator."""
    parts: list[str] = []
    numbers: dict[str, float] = {}
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
    if not parts:
        return Claim("Position-based methods were not timed beside integrators.")
    text = f"To an error of {number(target, 1)} spacings, {words.listed(parts)}, each by its fastest configuration."
    return Claim(text, numbers, True)


def orderings(results: Results) -> Claim:
    """Jacobi compared with coloured Gauss-Seidel on a stiff cloth, at equal error, each by its fastest configuration."""
    parts: list[str] = []
    numbers: dict[str, float] = {}
    for source in results.everyone:
        for backend in ("cpu", "gpu"):
            runs = [p for p in points(source, STIFF) if p.backend == backend]
            ratios: dict[float, float] = {}
            used: list[Point | None] = []
            for target in ORDERING_TARGETS:
                able = reaching(runs, target)
                best = [next((p for p in able if p.integrator == name), None) for name in XPBD[:2]]
                if best[0] is not None and best[1] is not None:
                    ratios[target] = (best[1].seconds or 0.0) / (best[0].seconds or 1.0)
                    used += best
            if ratios:
                low, high = min(ratios), max(ratios)
                numbers |= {f"{backend} {target:g}": ratio for target, ratio in ratios.items()}
                least, most = min(ratios.values()), max(ratios.values())
                took = words.times(least) if least == most else f"{number(least, 2)} to {words.times(most)}"
                errors = f"{number(high, 1)}" if low == high else f"{number(high, 1)} to {number(low, 1)}"
                parts.append(
                    f"on the {named(source, backend)} Jacobi takes {took} as long (errors of {errors} spacings)"
                    f"{suspicion(used, MARK)}"
                )
        if parts:
            break
    if not parts:
        return Claim("The orderings were not timed to equal errors.")
    text = (
        f"To the same error in {STIFF}, each by its fastest configuration and compared with Gauss-Seidel in {colours()} "
        f"colours: {words.listed(parts)}."
    )
    return Claim(text, numbers, True)


CLAIMS: Claims = {
    "xpbd-iterations": iterations_or_substeps,
    "xpbd-wrong": wrong_ordering,
    "xpbd-integrators": against_integrators,
    "xpbd-float32": in_float32,
    "xpbd-orderings": orderings,
}
