"""Claims of the lab book on fluids (`softlab fluids`, --truth, --rest); rules in labbook/claims/claim.py."""

from __future__ import annotations

from collections.abc import Sequence

from softlab.bench.experiments.fluid_rest import DEPTH, ENERGY_BOUND, SETTLED, SPEED_BOUND
from softlab.bench.experiments.fluid_rest import TANK as STILL_TANK
from softlab.bench.experiments.fluid_truth import laws
from softlab.bench.experiments.fluid_truth.laws import start_off
from softlab.bench.experiments.fluid_truth.rows import Judged
from softlab.bench.experiments.fluid_truth.scenes import COLUMN, DAM, DROP, TANK, VORTICES
from softlab.bench.measure import words
from softlab.bench.measure.case_timing import Row
from softlab.bench.measure.declaration import Part, Sentence
from softlab.labbook.claims.claim import SUSPECT, Claim, Claims, where
from softlab.labbook.claims.declared import by_backend
from softlab.plots.core.backends import on_backends
from softlab.plots.core.data import Results, Source, needed
from softlab.plots.figures.fluids import phases, truth
from softlab.plots.figures.fluids import rest as rest_figure

CLAIMS = Claims()
# all must hold at once
BOUNDS = {laws.MEAN: 0.01, laws.LARGEST: 0.03, laws.HEIGHT: 0.01, laws.SPEED: 0.01, laws.PRESSURE: 0.03}
BOUND_WORDS = (
    f"its density (within {100 * BOUNDS[laws.MEAN]:g} % on the mean, {100 * BOUNDS[laws.LARGEST]:g} % anywhere), its height "
    f"({100 * BOUNDS[laws.HEIGHT]:g} %), rest ({100 * BOUNDS[laws.SPEED]:g} % of √(g H)) and the pressure of its weight "
    f"({100 * BOUNDS[laws.PRESSURE]:g} %)"
)
FEWEST = (2, 3)  # substeps, iterations: those of particle libraries


def _runs_of(results: Results, kind: str) -> tuple[str, Source, list[Judged]]:
    """Return (backend, machine, rows of a kind) of the first backend that has some. Raises NotMeasured."""
    measured = [
        (one, source, [r for r in rows if r.kind == kind]) for one, source, rows in on_backends(results, truth.on)
    ]
    return needed([one for one in measured if one[2]])[0]


def _all_at_once(row: Judged) -> bool:
    return all(abs(row.numbers.get(name, float("inf"))) <= bound for name, bound in BOUNDS.items())


@CLAIMS.add("fluids-column", "A standing column of water was not measured.")
def column(results: Results) -> Claim:
    """Efforts that preserve a column in all respects, and the height of the column with others."""
    backend, source, runs = _runs_of(results, COLUMN)
    able = sorted((r for r in runs if _all_at_once(r) and r.frame), key=lambda r: r.frame or 0.0)
    parts, numbers = list[str](), dict[str, float]()
    if able:
        best = able[0]
        numbers |= {f"{best.who} frame": best.frame or 0.0, f"{best.who} mean": best.numbers[laws.MEAN]}
        parts.append(
            f"{best.who} with {best.effort} substeps x iterations does, in {words.seconds(best.frame or 0.0)} a frame of "
            f"{words.count(best.particles)} particles, its mean density error {_percentage(best.numbers[laws.MEAN])}"
        )
    never = [who for who in dict.fromkeys(r.who for r in runs) if who not in {r.who for r in able}]
    if never:
        parts.append(f"{words.listed(never)} {'does' if len(never) == 1 else 'do'} not with any effort that was tried")
    few = [r for r in runs if (r.substeps, r.iterations) == FEWEST and laws.HEIGHT in r.numbers]
    if few:
        numbers |= {f"{r.who} height": 1 + r.numbers[laws.HEIGHT] for r in few}
        heights = [f"{1 + r.numbers[laws.HEIGHT]:.2f} by {r.who}" for r in few]
        parts.append(
            f"with {few[0].effort}, which is usual in particle libraries, its relative height is {words.listed(heights)}"
        )
    text = f"A column should keep {BOUND_WORDS}, all at once"
    busy = SUSPECT if any(r.suspect for r in able[:1]) else ""
    return Claim(f"{text}: on {where(backend, source)}, {'; '.join(parts)}{busy}.", numbers, bool(able))


@CLAIMS.add("fluids-fastest", "The fastest setting for a standing column of water was not measured.")
def fastest(results: Results) -> Claim:
    """Fastest effort that preserves a column, in one sentence."""
    backend, source, runs = _runs_of(results, COLUMN)
    best = min(needed([r for r in runs if _all_at_once(r) and r.frame]), key=lambda r: r.frame or 0.0)
    text = (
        f"A column keeps {BOUND_WORDS} fastest with {best.who}, {best.effort} substeps x iterations, on "
        f"{where(backend, source)}{SUSPECT if best.suspect else ''}."
    )
    return Claim(text, {"frame": best.frame or 0.0}, True)


@CLAIMS.add("fluids-dam", "The front of a breaking dam was not measured.")
def dam(results: Results) -> Claim:
    """Error of the front against the experiment, and the first point, which no scheme can reach."""
    _, _, runs = _runs_of(results, DAM)
    lab_runs = needed([r for r in runs if not r.peer and laws.FRONT in r.numbers])
    best = min(lab_runs, key=lambda r: r.numbers[laws.FRONT])
    later = min(lab_runs, key=lambda r: r.numbers[laws.FRONT_LATER])
    numbers = {"front": best.numbers[laws.FRONT], "later": later.numbers[laws.FRONT_LATER], "start": start_off()}
    text = (
        f"With the best setting ({best.who}) the front of Martin and Moyce's dam is {_percentage(numbers['front'])} off "
        "at its worst point, and finer particles do not help: that point is the first, which lies "
        f"{_percentage(numbers['start'])} above the parabola that the next two make from rest, so that no flow that starts "
        "at rest meets all three. All "
        f"others are met within {_percentage(later.numbers[laws.FRONT_LATER])} ({later.who}, {later.effort})."
    )
    others = [r for r in runs if r.peer and laws.FRONT in r.numbers]
    if others:
        errors = [
            f"{r.who} {_percentage(r.numbers[laws.FRONT])}, and {_percentage(r.numbers[laws.FRONT_LATER])} without the first"
            for r in others
        ]
        numbers |= {r.who: r.numbers[laws.FRONT] for r in others}
        text += f" Other programs have similar errors: {words.listed(errors)}."
    return Claim(text, numbers, best.numbers[laws.FRONT_LATER] <= best.numbers[laws.FRONT])


@CLAIMS.add("fluids-viscosity", "The numerical viscosity was not measured.")
def viscosity(results: Results) -> Claim:
    """Numerical viscosity at the finest spacing, where the scene has none, and its fall with the spacing."""
    _, _, runs = _runs_of(results, VORTICES)
    parts, numbers = list[str](), dict[str, float]()
    for who in dict.fromkeys(r.who for r in runs):
        of_scheme = sorted((r for r in runs if r.who == who), key=lambda r: r.spacing)
        fine, coarse = of_scheme[0], of_scheme[-1]
        numbers[who] = fine.numbers[laws.VISCOSITY]
        more = ""
        if coarse.spacing > fine.spacing:
            numbers[f"{who} ratio"] = coarse.numbers[laws.VISCOSITY] / fine.numbers[laws.VISCOSITY]
            wider = coarse.spacing / fine.spacing
            more = f" ({coarse.numbers[laws.VISCOSITY]:.2g} m²/s at {wider:.2g} times the particle spacing)"
        parts.append(f"{numbers[who]:.2g} m²/s by {who}{more}")
    fine = min(runs, key=lambda r: r.spacing)
    text = (
        "In a fluid without viscosity, vortices in a box of a metre at 1 m/s decay as with a viscosity of "
        f"{words.listed(parts)}, with particles "
        f"{100 * fine.spacing:g} cm apart, far more than that of water."
    )
    return Claim(text, numbers, True)


@CLAIMS.add("fluids-drop", "The pressure in a drop was not measured.")
def drop(results: Results) -> Claim:
    """Pressure in a drop, which does not fall with the radius: cohesion is not a surface tension by Laplace's law."""
    drops = [r for r in _runs_of(results, DROP)[2] if r.numbers.get(laws.INSIDE, 0.0) > 0]
    sizes = [sorted((r for r in drops if r.who == who), key=lambda r: r.particles) for who in {r.who: 0 for r in drops}]
    series = needed([rows for rows in sizes if len(rows) > 1])[0]
    small, large = series[0], series[-1]
    larger = (large.particles / small.particles) ** (1 / 3)
    ratio = large.numbers[laws.INSIDE] / small.numbers[laws.INSIDE]
    text = (
        f"A drop becomes a ball (its longest axis {max(r.numbers[laws.ASPECT] for r in series):.3f} times its "
        "shortest), but cohesion is not a surface tension in newtons per metre: by Laplace's law the pressure in a "
        "drop "
        f"{larger:.2g} times as wide is {1 / larger:.2g} of that in the small one, and {ratio:.2g} was measured. It is "
        "an attraction between particles, whatever the radius."
    )
    return Claim(text, {"ratio": ratio, "law": 1 / larger}, ratio > 1 / larger)


@CLAIMS.add("fluids-peers", "Other fluid programs were not timed.")
def peers(results: Results) -> Claim:
    """Time of other programs for the tank, compared with the lab's at equal error."""
    backend, source, runs = _runs_of(results, TANK)
    timed = [r for r in runs if r.frame]
    parts, numbers = list[str](), dict[str, float]()
    for other in needed([r for r in timed if r.peer and laws.MEAN in r.numbers]):
        able = [r for r in timed if not r.peer and r.numbers.get(laws.MEAN, 1.0) <= other.numbers[laws.MEAN]]
        if able:
            best = min(able, key=lambda r: r.frame or 0.0)
            numbers[other.who] = ratio = (other.frame or 0.0) / (best.frame or 1.0)
            parts.append(
                f"{other.who} takes {words.times(ratio)} as long as {best.who} with {best.effort}, whose density error, "
                f"{_percentage(best.numbers[laws.MEAN])}, is no larger than its {_percentage(other.numbers[laws.MEAN])}"
            )
    needed(
        parts, "Other programs keep the density of a tank at rest better than any effort of the lab's that was tried."
    )
    busy = SUSPECT if any(r.suspect for r in runs) else ""
    text = f"In a tank at rest, sampled in turn on {where(backend, source)}, {words.listed(parts)}{busy}."
    return Claim(text, numbers, True)


@CLAIMS.add("fluids-rest", "Water at rest was not measured.")
def rest(results: Results) -> Claim:
    """Which schemes and substeps leave a still tank at rest, beside another program."""
    backend, source, rows = needed(on_backends(results, rest_figure.on))[0]
    tanks = [r for r in rows if r.kind == STILL_TANK]
    numbers: dict[str, float] = {}
    parts: list[str] = []
    for who in dict.fromkeys(r.who for r in tanks if not r.peer):
        runs = [r for r in tanks if r.who == who]
        still = [r for r in runs if r.rests]
        numbers[f"{who} still"] = len(still)
        resting = "none of the numbers of substeps that were tried"
        if still:
            numbers[who] = max(r.late for r in still)
            few = f"{min(r.substeps for r in still)} to {max(r.substeps for r in still)} substeps"
            every = f"each of {len(runs)} numbers of substeps"
            resting = f"{every if len(still) == len(runs) else few} (rms speed at most {_percentage(numbers[who])})"
        parts.append(f"{who} with {resting}")
    text = (
        f"Water {DEPTH:g} m deep and without viscosity should stay at rest in its tank: gain no more energy than "
        f"{ENERGY_BOUND:g} g H, and be slower than {_percentage(SPEED_BOUND)} of √(g H) from {SETTLED} s on. On "
        f"{where(backend, source)} it does by {words.listed(parts)}"
    )
    for other in (r for r in tanks if r.peer):
        numbers[other.who] = other.late
        text += f"; {other.who}, by its own steps, comes to {_percentage(other.late)}"
    return Claim(f"{text}.", numbers, any(r.rests for r in tanks if not r.peer))


def rate(rows: Sequence[Row]) -> Part:
    """Particle-iterations per second at the largest pool, and the stage that takes longest."""
    point = rows[-1]
    most = max(point.phases, key=lambda phase: point.phases[phase])
    text = (
        f"{_rate(point.rate)} particle-iterations a second with {words.count(point.particles)} particles, searches included; "
        f"the stage that takes most by itself is to {most}"
    )
    return text, {"": point.rate}


CLAIMS["fluids-rate"] = by_backend(phases.on, Sentence(
    "Two substeps of three iterations: {}.", rate, "The rate of fluid particles was not measured.",
    form="on {place} {part}", join="; ".join,
))  # fmt: skip


def _rate(value: float) -> str:
    """Return e.g. `4.67 x 10^9` or `13.3 million`."""
    return words.power(value, 9) if value >= 1e9 else f"{value / 1e6:.3g}{words.SPACE}million"


def _percentage(value: float) -> str:
    """Return e.g. `5.13 %`."""
    return f"{100 * value:.3g}{words.SPACE}%"
