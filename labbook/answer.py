"""First page of the lab book: the fastest method at each error, scene by scene, from the available measurements."""

from __future__ import annotations

from collections.abc import Mapping

from softlab.bench.experiments.accuracy.points import CLOTHS, SCENES, SIZES, SUSPECT_NOTE, method_words
from softlab.labbook import words
from softlab.labbook.tables import DASH, Table, table
from softlab.labbook.words import number, seconds
from softlab.model.scene.scene import load_scene
from softlab.plots.core.accuracy_points import Point, points, reaching
from softlab.plots.core.data import Results, Source

TARGETS = (1e-1, 1e-2, 1e-3)  # spacings
# small grids first, then stiff ones and ones with contacts
ORDER = ("S1-16", "S1", "S1-64", "S4", "S5", "S6-still", "S6")
HEAD = ("Scene", "Masses", "Error", "Fastest method", "Step", "Precision", "Processor", "Time", "Breaks")
TIME = HEAD.index("Time")
Run = tuple[Point, Source]


def answer_tables(results: Results) -> list[Table]:
    """Return one table with a row per scene and error: the fastest of all machines that timed it.

    The reader's own machines and committed ones; empty if no accuracy runs were timed.
    """
    answers: list[tuple[str, float, list[Run], Run | None]] = []
    for label in ORDER:
        runs = [
            (point, source)
            for source in results.everyone
            for point in (*points(source, label), *points(source, label, "exact"))
        ]
        if any(point.seconds for point, _ in runs):
            answers += [(label, target, runs, _fastest(runs, target)) for target in TARGETS]
    used = dict.fromkeys(best[1] for *_, best in answers if best)
    marks = {source: f" ({n})" if len(used) > 1 else "" for n, source in enumerate(used, 1)}
    rows = [
        [*(_scene(label) if target == TARGETS[0] else ("", "")), *_row(runs, target, best, marks)]
        for label, target, runs, best in answers
    ]
    title = (
        "The fastest way to an error (root mean square over the free masses, in spacings), as wall time of a simulated "
        "second without the copy of the end state, and from which step size on the same method diverged in that scene. "
        + _processors(marks)
    )
    if any(row[TIME].endswith("?") for row in rows):
        title += f". {SUSPECT_NOTE}"
    return [table(title, HEAD, rows, left=1)] if rows else []


def _fastest(runs: list[Run], target: float) -> Run | None:
    """Return the run that reaches an error fastest, and its machine."""
    able = reaching([point for point, _ in runs], target)
    return next(run for run in runs if run[0] is able[0]) if able else None


def _scene(label: str) -> tuple[str, str]:
    """Return e.g. (`Lab curtain (S1)`, `1024`)."""
    base, side = SIZES.get(label, (label, None))
    scene = load_scene((SCENES | CLOTHS)[base])
    grid = scene.grid
    masses = side * side if side else grid.particle_count
    return f"{(scene.title or base).partition(' (')[0]} ({base})", words.count(masses)


def _row(runs: list[Run], target: float, best: Run | None, marks: Mapping[Source, str]) -> list[str]:
    """Return the cells of a row; `marks`: suffixes of the processors, by machine."""
    found = [point for point, _ in runs]
    if best is None:
        return [number(target, 1), *_unanswered(found, target)]
    point, source = best
    exact = "" if point.math == "fast" else f", {point.math}"
    return [
        number(target, 1), method_words(point.integrator, point.iterations), f"{1000 * point.dt:.3g}{words.SPACE}ms",
        f"{point.precision}{exact}", point.backend.upper() + marks[source],
        seconds(point.seconds or 0.0, 2) + point.mark, _breaks(found, point),
    ]  # fmt: skip


def _unanswered(found: list[Point], target: float) -> list[str]:
    """Return the cells of a row without a time, which distinguish `not timed` from `not reached`."""
    if any(p.error <= target for p in found):
        return ["reached, but not timed", *[DASH] * 5]
    nearest = min((p for p in found if not p.diverged and not p.refused), key=lambda p: p.error, default=None)
    told = f"not reached; least {number(nearest.error, 2)}" if nearest else "not reached"
    return [told, *[DASH] * 5]


def _processors(marks: Mapping[Source, str]) -> str:
    """Return the processors of the rows, with a mark if they are not the reader's: `CPU Some CPU, 2 cores`.

    For rows of several machines, with their numbers. (A letter is part of a machine's name: plots/core/read.py.)
    """
    told = []
    for source, mark in marks.items():
        names = f"GPU {source.gpu}, CPU {source.processor}" if source.gpu else f"CPU {source.processor}"
        told.append(f"{mark.lstrip()} {names}{source.bracket}".lstrip())
    return "; ".join(told)


def _breaks(found: list[Point], best: Point) -> str:
    """Return the smallest step size at which the method diverged, or that it was stable at all that were tried."""
    mine = [
        p for p in found if (p.integrator, p.iterations, p.backend) == (best.integrator, best.iterations, best.backend)
    ]
    lost = [p.dt for p in mine if p.diverged]
    if lost:
        return f"at {1000 * min(lost):g}{words.SPACE}ms"
    return f"not up to {1000 * max(p.dt for p in mine):g}{words.SPACE}ms"
