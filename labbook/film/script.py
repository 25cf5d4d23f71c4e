"""Script of the film, shot by shot: sentences that are claims of the book, by name, and a few that explain a picture.

A shot without data is left out. Numbers come from the results or from the computations for the film.
"""

from __future__ import annotations

from functools import partial

from softlab.bench.measure.words import listed, masses, number, seconds, times
from softlab.labbook.build import marked_claim
from softlab.labbook.film import stills
from softlab.labbook.film.bodies import SLOWED, draw_bodies
from softlab.labbook.film.canvas import Format
from softlab.labbook.film.judged import METHODS, SCENE, Judged, breaking, draw_breaking, draw_errors, judged
from softlab.labbook.film.race import Race, draw_race, races
from softlab.labbook.film.timeline import Line, Shot
from softlab.plots.core.data import Results

INTRODUCTION = "A grid of masses and springs, computed twice: by the threads of a CPU, and by CUDA on a GPU."
QUESTION = "How fast is it, how wrong, and where does it break?"
WINNERS_TEXT = "Which method, on which processor, at which step size, reaches an error fastest: the answers."
MIN_RACE_SECONDS = 8.0  # s: shortest length of a race


def claimed(results: Results, name: str, rank: int = 1) -> list[Line]:
    """Return the sentence of a claim, if the data support it."""
    claim = marked_claim(results, name)
    return [Line(claim.sentence, rank)] if claim.supported else []


def script(results: Results, form: Format, backend: str) -> list[Shot]:
    """Return the shots in order; `backend`: computes states for the film."""
    comparison = judged(form.curtain)
    shots = [_title(results, comparison), *_races(results, form, backend)]
    threads = "CPU threads: once, twice, four times as many as cores"
    shots += _figure(results, form, "thread-scaling", threads, {"threads-small": 3, "threads-best": 1})
    shots += _figure(results, form, "graphics", "With and without graphics", {"overtakes-drawing": 2})
    shots += [_errors(results, comparison)]
    shots += _figure(results, form, "regimes", "Who reaches an error fastest", {"fastest": 1, "float32-floor": 4})
    shots += [*_breaking(results, form), *_bodies(results, form, backend), *_answers(results)]
    return [shot for shot in shots if shot.lines]


def _title(results: Results, comparison: Judged) -> Shot:
    measured = [source for source in results.featured if source.timings or source.measures]
    labels = listed(list(dict.fromkeys(source.machine.label.replace("; ", ", ") for source in measured)))
    is_local = any(source.by_user for source in measured)
    whose = "Its times were measured on" if is_local else "Its times are the committed ones of"
    lines = [Line(INTRODUCTION), Line(QUESTION, 1), *([Line(f"{whose}: {labels}.", 2)] if measured else [])]
    return Shot("title", "", tuple(lines), partial(stills.draw_title, comparison, results), 4.0)


def _races(results: Results, form: Format, backend: str) -> list[Shot]:
    """Return the shots of both implementations at true speed, on a small grid and on a large one."""
    chosen = races(results, form.masses)
    shots = []
    for place, race in enumerate(chosen):
        lines = [Line(_side_by_side(race))] if place == 0 else []
        if place == len(chosen) - 1:
            lines += claimed(results, "overtakes") or ([Line(_side_by_side(race))] if place else [])
        heading = f"Side by side at true speed: {masses(race.scene.grid.particle_count)}"
        shots.append(Shot(f"race-{place}", heading, tuple(lines), partial(draw_race, race, backend), MIN_RACE_SECONDS))
    return shots


def _side_by_side(race: Race) -> str:
    left, right = race.runners
    ratio = left.timing.median / right.timing.median
    ahead, factor = (right, ratio) if ratio >= 1 else (left, 1 / ratio)
    grid = race.scene.grid
    return (
        f"Left {left.who}, right {right.who}: the same {grid.rows} x {grid.columns} masses, each as fast as it was measured. "
        f"In the same time {ahead.who} does {times(factor)} the steps."
    )


def _figure(results: Results, form: Format, name: str, heading: str, ranks: dict[str, int]) -> list[Shot]:
    """Return the shot of a figure of plots/, with claims and their ranks as sentences."""
    lines = [line for claim, rank in ranks.items() for line in claimed(results, claim, rank=rank)]
    wanted = any(line.rank <= form.rank for line in lines)
    if not wanted or stills.figure_of(results, name) is None:
        return []
    return [Shot(name, heading, tuple(lines), partial(stills.draw_figure, results, name), 4.0)]


def _errors(results: Results, comparison: Judged) -> Shot:
    worst, best = (number(comparison.errors[name][-1], 2) for name, _, _ in METHODS)
    text = (
        f"A time without its error says little. After {seconds(comparison.end, 2)} of the same curtain, the hand-out's step "
        f"is {worst} spacings off the reference; velocity-verlet, with the same step size, {best}."
    )
    lines = (Line(text), *claimed(results, "lab-newton"), *claimed(results, "lab-half", rank=3))
    return Shot(
        "errors",
        f"Speed against error: the lab curtain ({SCENE})",
        lines,
        partial(draw_errors, comparison, results),
        8.0,
    )


def _breaking(results: Results, form: Format) -> list[Shot]:
    case = breaking(form.curtain)
    if case is None:
        return []
    text = (
        f"And it can break. The hand-out's step holds at its limit, {seconds(case.limit)}; at {times(case.times)} the limit "
        f"it diverges at step {case.lost}."
    )
    lines = (Line(text, 1), *claimed(results, "stability-under"), *claimed(results, "stability-first-loss", rank=3))
    return [Shot("breaking", "Where it breaks", lines, partial(draw_breaking, case), 7.0)]


def _bodies(results: Results, form: Format, backend: str) -> list[Shot]:
    if not form.everything:
        return []
    text = f"The lab has more than grids: cloths, and bodies by shape matching, here slowed down {SLOWED:g} times."
    lines = (Line(text, 1), *claimed(results, "bar-backends", rank=2), *claimed(results, "hard-bodies", rank=4))
    return [Shot("bodies", "Cloths and bodies", lines, partial(draw_bodies, backend), 8.0)]


def _answers(results: Results) -> list[Shot]:
    if not stills.answers(results)[0]:
        return []
    return [Shot("answers", "The answer", (Line(WINNERS_TEXT, 1),), partial(stills.draw_answers, results), 5.0)]
