"""Claims of the lab book on accuracy; rules in labbook/claims/claim.py."""

from __future__ import annotations

from softlab.bench.experiments.accuracy.equal_error import Fastest
from softlab.bench.experiments.accuracy.equal_error import equal_error as ways_to
from softlab.bench.experiments.accuracy.methods import admitted
from softlab.bench.experiments.accuracy.points import CLOTHS, SIZES
from softlab.bench.measure import words
from softlab.bench.measure.words import number, seconds
from softlab.labbook.claims.claim import MARK, Claim, Claims, named, on_gpu, suspicion
from softlab.labbook.claims.comparison import NOT_COMPARED
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.scene.scene import load_scene
from softlab.plots.core.accuracy_points import SIDE, Point, observed_order, order_points, points, reaching
from softlab.plots.core.apart import small
from softlab.plots.core.data import Results, Source, needed
from softlab.plots.figures.work_precision import accurate_source

CLAIMS = Claims()
NEAR = 0.25  # largest difference between an observed and the declared order that still counts as agreement
FAMILIES = ("explicit", "position-based", "implicit")
FRAME = 1 / 60  # s
SCENE = "S1"  # the scene whose numbers the text quotes; tables have both


def quoted_points(results: Results) -> list[Point]:
    """Return the accuracy runs of the chapter's source, for the scene that the text quotes."""
    source = accurate_source(results)
    return points(source, SCENE) if source else []


@CLAIMS.add("lab-newton", "The hand-out's step was not compared with Newton's law.")
def lab_newton(results: Results) -> Claim:
    """Error and order of the hand-out's step against Newton's law."""
    runs = order_points(quoted_points(results), "lab")
    order = needed(observed_order([(p.dt, p.error) for p in runs]))
    coarse, fine = max(runs, key=lambda p: p.dt), min(runs, key=lambda p: p.dt)
    flat = abs(order) < NEAR
    text = (
        f"In {SCENE}, its error against Newton's law is {number(coarse.error, 2)} spacings at "
        f"{seconds(coarse.dt, 2)} and {number(fine.error, 2)} at {seconds(fine.dt, 2)}: observed order {_order(order)}, "
    )
    text += "so smaller steps do not help." if flat else "so the step size does change it."
    return Claim(text, {"order": order, "coarse": coarse.error, "fine": fine.error}, flat)


def _order(order: float) -> str:
    return f"{order:.2f}".replace("-", words.MINUS)


@CLAIMS.add("lab-half", "It was not compared with the equation with half the acceleration.")
def lab_half(results: Results) -> Claim:
    """Error and order of the hand-out's step against the equation with half the acceleration."""
    runs = [p for p in order_points(quoted_points(results), "lab") if p.half]
    order = needed(observed_order([(p.dt, p.half or 0.0) for p in runs]))
    fine = min(runs, key=lambda p: p.dt)
    first = abs(order - 1) < NEAR
    text = (
        f"Against the equation with half the acceleration it is {number(fine.half or 0.0, 2)} spacings at "
        f"{seconds(fine.dt, 2)}, observed order {order:.2f}"
    )
    text += ": this is the equation it solves." if first else "; first order was expected and is not seen here."
    return Claim(text, {"order": order, "fine": fine.half or 0.0}, first)


@CLAIMS.add("orders", "The orders of the other integrators were not measured.")
def orders(results: Results) -> Claim:
    """Observed and declared orders of the integrators that have a declared order."""
    runs = quoted_points(results)
    parts, numbers, near = [], {}, True
    for name in ("semi-implicit-euler", "velocity-verlet", "rk4"):
        order = observed_order([(p.dt, p.error) for p in order_points(runs, name) if p.resolved])
        if order is not None:
            parts.append(f"{order:.2f} for {name} (declared {INTEGRATORS[name].order})")
            numbers[name] = order
            near = near and abs(order - INTEGRATORS[name].order) < NEAR
    verdict = "" if near else "; not all of them are near what they declare"
    text = f"In {SCENE}, in float64, the observed orders are {words.listed(needed(parts))}{verdict}."
    return Claim(text, numbers, near)


@CLAIMS.add("broken", "No accuracy runs were measured.")
def broken(results: Results) -> Claim:
    """Number of diverged runs, and their integrators."""
    runs = needed(quoted_points(results))
    lost = [p for p in runs if p.diverged]
    names = list(dict.fromkeys(p.integrator for p in lost))
    if not lost:
        return Claim(f"None of the {len(runs)} runs of {SCENE} diverged.", {"diverged": 0}, True)
    text = f"Of the {len(runs)} runs of {SCENE}, {len(lost)} diverged, all with {words.listed(names)}."
    return Claim(text, {"diverged": len(lost)}, True)


@CLAIMS.add("float32-floor", "Where float32 stops to gain was not measured.")
def float32_floor(results: Results) -> Claim:
    """Resolution of float32: the smallest errors of rk4 in float32 and in float64."""
    runs = [p for p in quoted_points(results) if p.integrator == "rk4" and not p.diverged and p.backend == "cpu"]
    least = {
        precision: min((p for p in runs if p.precision == precision), key=lambda p: p.error, default=None)
        for precision in ("float32", "float64")
    }
    single, double = needed(least["float32"]), needed(least["float64"])
    numbers = {"float32": single.error, "float64": double.error}
    if single.error < 2 * double.error:
        return Claim("At these step sizes, float32 and float64 reach about the same error.", numbers, False)
    text = (
        f"The smallest error of rk4 in float32 is {number(single.error, 2)} spacings, against "
        f"{number(double.error, 2)} in float64: below that, rounding dominates."
    )
    return Claim(text, numbers, True)


@CLAIMS.add("fastest", "No costs were measured.")
def fastest(results: Results, target: float = 1e-3) -> Claim:
    """Fastest configuration that reaches an error, and whether the next integrator is clearly slower."""
    source, runs = needed(accurate_source(results)), needed(quoted_points(results))
    at = f"An error of {number(target, 1)} spacings in {SCENE}"
    able = needed(reaching(runs, target), f"{at} was reached by no timed configuration.")
    best = able[0]
    other = next((p for p in able if p.integrator != best.integrator), None)
    text = (
        f"On the {named(source, best.backend)}, {at[0].lower()}{at[1:]} is reached fastest by {best.name}: "
        f"{seconds(best.seconds or 0.0)} of wall time per simulated second{suspicion([best], MARK)}"
    )
    numbers = {"seconds": best.seconds or 0.0, "error": best.error}
    if other is None:
        return Claim(f"{text}; no other integrator reaches it at these step sizes.", numbers, True)
    clear = best.high is not None and other.low is not None and best.high < other.low
    clear = clear and not small((other.seconds or 0.0) / (best.seconds or 1.0))
    numbers["next"] = other.seconds or 0.0
    after = f"the next integrator is {other.integrator} with {seconds(other.seconds or 0.0)}{suspicion([other], MARK)}"
    text += f"; {after}." if clear else f"; {after}, no difference beyond measurement noise."
    return Claim(text, numbers, clear)


@CLAIMS.add("equal-error", f"GPU and CPU were not compared at equal error: {NOT_COMPARED}.")
def equal_error(results: Results, target: float = 1e-3) -> Claim:
    """Speed of the GPU over that of the CPU at equal error, without and with the copy of the end state, by size."""
    labels = sorted((SCENE, *SIZES), key=lambda label: SIZES.get(label, (label, SIDE))[1])

    def compared(source: Source) -> dict[str, Fastest[Point]]:
        rows = {label: ways_to(points(source, label), [target])[0] for label in labels}
        return {label: row for label, row in rows.items() if row.cpu is not None and row.gpu is not None}

    source, rows = needed(results.first_with(compared))
    parts, numbers = list[str](), dict[str, float]()
    for label, row in rows.items():
        assert row.cpu is not None and row.gpu is not None and row.speed_up is not None
        ratio, name = row.speed_up, "" if label == SCENE else f" {label}"
        numbers[f"ratio{name}"] = ratio
        bounds = (row.cpu.low, row.cpu.high, row.gpu.low, row.gpu.high)
        clear = (
            None not in bounds
            and not small(ratio)
            and ((row.cpu.low or 0) > (row.gpu.high or 0) or (row.cpu.high or 0) < (row.gpu.low or 0))
        )
        comparison = _times_as_fast(ratio) if clear else "GPU and CPU differ by no more than measurement noise"
        if row.speed_up_copied is not None:
            numbers[f"copied{name}"] = row.speed_up_copied
            whole = "" if parts else " of the end state to the host"
            marked = suspicion([row.cpu, row.gpu, row.cpu_copied, row.gpu_copied], "; suspect")
            comparison += f" ({words.times(row.speed_up_copied)} with the copy{whole}{marked})"
        else:
            comparison += suspicion([row.cpu, row.gpu], MARK)
        parts.append(f"{words.masses(SIZES.get(label, (label, SIDE))[1] ** 2)}: {comparison}")
    text = (
        f"{on_gpu(source)} and the {source.processor}, at an error of {number(target, 1)} spacings in {SCENE} and with the "
        f"fastest configuration of each, at {'; at '.join(parts)}."
    )
    return Claim(text, numbers, True)


@CLAIMS.add("families", "Methods of several families were not timed on the stiff cloth.")
def families(results: Results, scene: str = "S4", target: float = 1e-1) -> Claim:
    """Fastest explicit, position-based and implicit method on a stiff cloth, at equal error."""

    def by_family(source: Source) -> dict[str, Point]:
        fastest: dict[str, Point] = {}
        for point in reaching(points(source, scene), target):
            fastest.setdefault(_family(point), point)
        return fastest if len(fastest) > 1 else {}

    source, fastest = needed(results.first_with(by_family))
    best = next(iter(fastest.values()))
    numbers = {name: (point.seconds or 0.0) / (best.seconds or 1.0) for name, point in fastest.items()}
    others = [
        f"{name} methods take {words.times(numbers[name])} as long ({point.name}){suspicion([point], MARK)}"
        for name, point in fastest.items()
        if point is not best
    ]
    others += [f"{name} methods do not reach it" for name in FAMILIES if name not in fastest]
    reached = f"an error of {number(target, 1)} spacings in {scene} is reached fastest by {best.name}"
    text = f"On {_machines(source)}, {reached}{suspicion([best], MARK)}; {words.listed(others)}."
    return Claim(text, numbers, True)


@CLAIMS.add("game-cloth", "No timed method reached such an error on the stiff cloth.")
def game_cloth(results: Results, scene: str = "S4", target: float = 1e-1) -> Claim:
    """Method, step and processor for a cloth whose error may be seen but not noticed, and the time of a frame of a game."""
    source, (best, *_) = needed(results.first_with(lambda source: reaching(points(source, scene), target)))
    frame = (best.seconds or 0.0) * FRAME
    masses = words.masses(load_scene(CLOTHS[scene]).grid.particle_count)
    text = (
        f"Within {number(target, 1)} spacings in {scene}, a cloth of {masses}: {best.name}, "
        f"{seconds(frame, 2)} of wall time for a frame of 1/60{words.SPACE}s on the {named(source, best.backend)}"
        f"{suspicion([best], MARK)}."
    )
    return Claim(text, {"frame": frame, "error": best.error}, True)


def _family(point: Point) -> str:
    if point.iterations is not None:
        return "position-based"
    return "explicit" if point.integrator in INTEGRATORS else "implicit"


def _machines(source: Source) -> str:
    """Return e.g. `the NVIDIA H200 and the Intel Xeon, 16 cores (committed)`: the processors that were timed."""
    processors = [name for name in (source.gpu, source.processor) if name]
    return " and ".join(f"the {name}" for name in processors) + source.bracket


@CLAIMS.add("rope", "GPU and CPU were not compared on the stiff rope.")
def rope(results: Results, target: float = 1e-1) -> Claim:
    """Speed of the GPU over that of the CPU at equal error on a stiff rope, which no GPU can process in parallel."""
    scene = load_scene("rope-stiff")
    masses = words.masses(scene.grid.particle_count)
    source, (row, *_) = needed(
        results.first_with(lambda s: [row for row in ways_to(points(s, "S6"), [target]) if row.speed_up is not None])
    )
    ratio = needed(row.speed_up)
    text = (
        f"On {_machines(source)}, at an error of {number(target, 1)} spacings in S6, a rope of {masses}, "
        f"{_times_as_fast(ratio)}{suspicion([row.cpu, row.gpu], MARK)} (admitted: {admitted(scene)})."
    )
    return Claim(text, {"ratio": ratio}, True)


def _times_as_fast(ratio: float) -> str:
    one, other, factor = ("GPU", "CPU", ratio) if ratio > 1 else ("CPU", "GPU", 1 / ratio)
    return f"the {one} is {words.times(factor)} as fast as the {other}"
