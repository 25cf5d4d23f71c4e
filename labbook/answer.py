"""First page of the lab book: the fastest method at each error, scene by scene, from the available measurements.

Within the rule for ties (plots/core/apart.py) the more accurate run wins, and the faster one is named beside it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from math import isinf

from softlab.bench.experiments.accuracy.methods import admitted, changes
from softlab.bench.experiments.accuracy.points import CLOTHS, SCENES, SIZES, method_words
from softlab.bench.measure import words
from softlab.bench.measure.words import number, seconds
from softlab.labbook.tables import DASH, Table, table
from softlab.model.core.families import stability_limit
from softlab.model.scene.scene import Scene, load_scene
from softlab.plots.core.accuracy_points import Point, points
from softlab.plots.core.apart import SMALL, small
from softlab.plots.core.data import Results, Source

TARGETS = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 1e-4)  # spacings
# small grids first, then stiff ones and ones with contacts
ORDER = ("S1-16", "S1", "S1-64", "S4", "S5", "S6-still", "S6")
HEAD = (
    "Scene", "Masses", "Error at most", "Method", "Step", "Limit", "Processor", "Error", "One run", "Simulated second", "Tie"
)  # fmt: skip
SUSPECT = "?: suspect, see the first page"
Run = tuple[Point, Source]


@dataclass(frozen=True)
class SceneWinner:
    """The winner of a scene at some errors, and the fastest run if the two tie; or why there is no winner."""

    label: str
    targets: tuple[float, ...]
    best: Run | None
    tie: Run | None = None
    reason: str = ""


def winner_tables(results: Results) -> list[Table]:
    """Return the table of the reader's machines, then that of the committed ones if there are both.

    A table has a row per scene and winner: on the first machine that timed all that any of them did, else the fastest of
    its machines. Empty if no accuracy runs were timed.
    """
    return [one for sources in (results.featured, results.background) for one in _winner_table(_complete(sources))]


def _complete(sources: Sequence[Source]) -> Sequence[Source]:
    """Return the first machine alone that timed every scene which any of these timed on any backend; else all of them."""
    timed = [
        {(label, point.backend) for label in ORDER for point, _ in _runs([source], label) if point.seconds}
        for source in sources
    ]
    every = set().union(*timed)
    return next(([source] for source, scenes in zip(sources, timed, strict=True) if scenes == every), sources)


def _winner_table(sources: Sequence[Source]) -> list[Table]:
    """Return the table of some machines; nothing if they timed no accuracy runs."""
    runs = {label: _runs(sources, label) for label in ORDER}
    runs = {label: scene_runs for label, scene_runs in runs.items() if any(point.seconds for point, _ in scene_runs)}
    winners = [entry for label, scene_runs in runs.items() for entry in _winners(label, scene_runs)]
    used = dict.fromkeys(source for entry in winners for _, source in _shown(entry))
    marks = {source: f" ({n})" if len(used) > 1 else "" for n, source in enumerate(used, 1)}
    rows = [
        [*(_scene(label) if n == 0 else ("", "")), *_row(entry, marks)]
        for label, group in groupby(winners, key=lambda entry: entry.label)
        for n, entry in enumerate(group)
    ]
    if not rows:
        return []
    title = (
        "The fastest method within an error (root mean square over the free masses, in spacings; resolved by the reference). "
        "One run: wall time from the start state to the end state on the host, with launch and copy; a simulated second: "
        "without the copy. Limit: the largest stable step, as softlab plan prints it, over the row's step. Tie: faster by "
        f"less than {words.percent(SMALL)}, with a larger error. {_admitted(runs)}softlab accuracy SCENE repeats a scene's "
        f"rows. {_processors(marks)}"
    )
    if any("?" in cell for row in rows for cell in row[-3:]):
        title += f". {SUSPECT}"
    return [table(title, HEAD, rows, left=2, group=2, notes=1)]


def _runs(sources: Sequence[Source], label: str) -> list[Run]:
    """Return the runs of a scene in both maths, on these machines."""
    return [
        (point, source) for source in sources for math in ("fast", "exact") for point in points(source, label, math)
    ]


def _winners(label: str, runs: Sequence[Run]) -> list[SceneWinner]:
    """Return the answers of a scene; neighbouring errors with the same winner are one answer."""
    winners: list[SceneWinner] = []
    for target in TARGETS:
        best, tie = winner(runs, target)
        entry = SceneWinner(
            label, (target,), best, tie, "" if best else _unanswered([point for point, _ in runs], target)
        )
        if winners and replace(winners[-1], targets=(target,)) == entry:
            winners[-1] = replace(entry, targets=(*winners[-1].targets, target))
        else:
            winners.append(entry)
    return winners


def winner(runs: Sequence[Run], target: float) -> tuple[Run | None, Run | None]:
    """Return (the run that reaches an error fastest, the fastest run if that one ties with it).

    Of runs within the rule from the fastest, the one with the smallest error wins; of errors that are printed alike, the
    fastest. One run of the whole interval counts, with launch and copy.
    """
    able = [run for run in runs if run[0].run_seconds is not None and run[0].resolved and run[0].error <= target]
    if not able:
        return None, None
    able.sort(key=lambda run: run[0].run_seconds or 0.0)
    fastest = able[0][0].run_seconds or 0.0
    tied = [run for run in able if small((run[0].run_seconds or 0.0) / fastest)]
    best = min(tied, key=lambda run: float(f"{run[0].error:.1e}"))
    return best, None if best == able[0] else able[0]


def _shown(entry: SceneWinner) -> list[Run]:
    """Return the runs that a row names."""
    return [run for run in (entry.best, entry.tie) if run]


def _resolved_scene(label: str) -> Scene:
    base, side = SIZES.get(label, (label, None))
    scene = load_scene((SCENES | CLOTHS)[base])
    return scene.replace({"grid.rows": side, "grid.columns": side}) if side else scene


def _scene(label: str) -> tuple[str, str]:
    """Return e.g. (`Lab curtain (S1)`, `1024`)."""
    scene, base = _resolved_scene(label), SIZES.get(label, (label, None))[0]
    return f"{(scene.title or base).partition(' (')[0]} ({base})", words.count(scene.grid.particle_count)


def _admitted(labels: Mapping[str, object]) -> str:
    """Return which methods a scene admits, where these are not all; with a space after it."""
    scenes_by_text: dict[str, list[str]] = {}
    for label in labels:
        scenes_by_text.setdefault(admitted(_resolved_scene(label)), []).append(label)
    return "".join(f"Admitted in {words.listed(scenes)}: {text}. " for text, scenes in scenes_by_text.items() if text)


def _row(entry: SceneWinner, marks: Mapping[Source, str]) -> list[str]:
    """Return the cells of a row; `marks`: suffixes of the processors, by machine."""
    within = ", ".join(number(target, 1) for target in entry.targets)
    if entry.best is None:
        return [within, entry.reason, *[DASH] * (len(HEAD) - 4)]
    point, source = entry.best
    return [
        within, method_words(point.integrator, point.iterations), _milliseconds(point.dt), _limit(point),
        _processor(point, source, marks), number(point.error, 2), seconds(point.run_seconds or 0.0, 2) + point.mark,
        seconds(point.seconds or 0.0, 2) + point.mark, _tie(entry, marks),
    ]  # fmt: skip


def _milliseconds(dt: float) -> str:
    return f"{1000 * dt:.3g}{words.SPACE}ms"


def _processor(point: Point, source: Source, marks: Mapping[Source, str]) -> str:
    exact = "" if point.math == "fast" else f", {point.math}"
    return f"{point.backend.upper()}{marks[source]}, {point.precision}{exact}"


def _limit(point: Point) -> str:
    """Return the largest step at which the point's method is stable in any state, and how many times its step that is."""
    method = changes(point.integrator, point.iterations or 1, point.substeps or 1) | {"method.dt": point.dt}
    limit = stability_limit(_resolved_scene(point.scene).replace(method))
    return "none" if isinf(limit) else f"{_milliseconds(limit)}, {number(limit / point.dt, 2)}{words.TIMES}"


def _tie(entry: SceneWinner, marks: Mapping[Source, str]) -> str:
    """Return the fastest run that is not clearly faster than the winner, by how much it is faster, and its error."""
    if entry.tie is None or entry.best is None:
        return DASH
    point, source = entry.tie
    gain = 1 - (point.run_seconds or 0.0) / (entry.best[0].run_seconds or 1.0)
    method = method_words(point.integrator, point.iterations)
    description, where = f"{method}, {_milliseconds(point.dt)}", _processor(point, source, marks)
    other = f", {where}" if where != _processor(*entry.best, marks) else ""
    return f"{description}{other}: {words.percent(gain)}{point.mark}, error {number(point.error, 2)}"


def _unanswered(runs: Sequence[Point], target: float) -> str:
    """Return why a scene has no winner at an error; `not timed` is not `not reached`."""
    if any(p.error <= target and p.resolved for p in runs):
        return "reached, but not timed"
    if any(p.error <= target for p in runs):
        return "not resolved by the reference"
    nearest = min((p for p in runs if not p.diverged and not p.refused), key=lambda p: p.error, default=None)
    return f"not reached; least {number(nearest.error, 2)}" if nearest else "not reached"


def _processors(marks: Mapping[Source, str]) -> str:
    """Return the processors of the rows, with a mark if they are not the reader's: `CPU Some CPU, 2 cores`.

    For rows of several machines, with their numbers. (A letter is part of a machine's name: plots/core/read.py.)
    """
    names_of_rows = []
    for source, mark in marks.items():
        names = f"GPU {source.gpu}, CPU {source.processor}" if source.gpu else f"CPU {source.processor}"
        names_of_rows.append(f"{mark.lstrip()} {names}{source.bracket}".lstrip())
    return "; ".join(names_of_rows)
