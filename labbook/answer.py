"""The lab book's first page: the method that reaches an error soonest, scene by scene, from whatever was measured."""

from __future__ import annotations

from collections.abc import Mapping

from bench.experiments.accuracy.points import CLOTHS, SCENES, SIZES, SUSPECT_NOTE, method_words
from labbook import words
from labbook.tables import DASH, Table, table
from labbook.words import number, seconds
from model.scene.scene import load_scene
from plots.core.accuracy_points import Point, points, reaching
from plots.core.data import Results, Source
from plots.figures.work_precision import answering

TARGETS = (1e-1, 1e-2, 1e-3)  # spacings
ORDER = ("S1-16", "S1", "S1-64", "S4", "S5", "S6-still", "S6")  # small grids first, then stiff and touching ones
HEAD = ("Scene", "Masses", "Error", "Soonest method", "Step", "Precision", "Processor", "Time", "Breaks")
TIME = HEAD.index("Time")


def answer_tables(results: Results) -> list[Table]:
    """One table: a row for each scene and error, from the first machine that timed most methods there (the reader's own
    before committed ones); nothing where no accuracy runs were timed."""
    sources = {label: source for label in ORDER if (source := answering(results, label))}
    letters = {source: chr(ord("a") + n) for n, source in enumerate(dict.fromkeys(sources.values()))}
    rows = []
    for label, source in sources.items():
        found = [*points(source, label), *points(source, label, "exact")]
        mark = f" ({letters[source]})" if len(letters) > 1 else ""
        rows += [
            [*(_scene(label) if target == TARGETS[0] else ("", "")), *_row(found, target, mark)] for target in TARGETS
        ]
    title = (
        "The soonest way to an error (root mean square over the free masses, in spacings), as wall time of a simulated "
        "second without the copy of the end state, and from which step size on the same method diverged in that scene. "
        + _processors(sources, letters)
    )
    if any(row[TIME].endswith("?") for row in rows):
        title += f". {SUSPECT_NOTE}"
    return [table(title, HEAD, rows, left=1)] if rows else []


def _scene(label: str) -> tuple[str, str]:
    """`Lab curtain (S1)`, `1024`."""
    base, side = SIZES.get(label, (label, None))
    scene = load_scene((SCENES | CLOTHS)[base])
    grid = scene.grid
    masses = side * side if side else grid.particle_count
    return f"{(scene.title or base).partition(' (')[0]} ({base})", words.count(masses)


def _row(found: list[Point], target: float, mark: str) -> list[str]:
    """`mark`: of the machine, behind its processor."""
    able = reaching(found, target)
    if not able:
        return [number(target, 1), *_unanswered(found, target)]
    best = able[0]
    exact = "" if best.math == "fast" else f", {best.math}"
    return [
        number(target, 1), method_words(best.integrator, best.iterations), f"{1000 * best.dt:.3g}{words.SPACE}ms",
        f"{best.precision}{exact}", best.backend.upper() + mark,
        seconds(best.seconds or 0.0, 2) + best.mark, _breaks(found, best),
    ]  # fmt: skip


def _unanswered(found: list[Point], target: float) -> list[str]:
    """`Not timed` is not `did not reach`."""
    if any(p.error <= target for p in found):
        return ["reached, but not timed", *[DASH] * 5]
    nearest = min((p for p in found if not p.diverged and not p.refused), key=lambda p: p.error, default=None)
    told = f"not reached; least {number(nearest.error, 2)}" if nearest else "not reached"
    return [told, *[DASH] * 5]


def _processors(sources: Mapping[str, Source], letters: Mapping[Source, str]) -> str:
    """Which processors the rows are of, with a word where they are not the reader's: `CPU: Some CPU, 2 cores`; where rows
    are of several machines, by the letters of the rows, and that their times are not to be held against each other."""
    told = []
    for source in dict.fromkeys(sources.values()):
        letter = f"({letters[source]}) " if len(letters) > 1 else ""
        names = f"GPU {source.gpu}, CPU {source.processor}" if source.gpu else f"CPU {source.processor}"
        told.append(f"{letter}{names}{source.bracket}")
    several = ". Rows of different letters are of different machines" if len(letters) > 1 else ""
    return "; ".join(told) + several


def _breaks(found: list[Point], best: Point) -> str:
    """The least step size at which the method diverged, or that it held at all that were tried."""
    mine = [
        p for p in found if (p.integrator, p.iterations, p.backend) == (best.integrator, best.iterations, best.backend)
    ]
    lost = [p.dt for p in mine if p.diverged]
    if lost:
        return f"at {1000 * min(lost):g}{words.SPACE}ms"
    return f"not up to {1000 * max(p.dt for p in mine):g}{words.SPACE}ms"
