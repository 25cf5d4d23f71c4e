"""Speed against error as a moving picture: the hand-out's step and velocity-verlet compared with the reference.

Also the step size at which a method diverges. All states are computed for the film.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import log10

import numpy as np
from PIL import Image, ImageDraw

from softlab.app.driver import open_simulation
from softlab.app.output.offscreen import OffscreenRenderer
from softlab.bench.experiments.accuracy.judge import distance
from softlab.bench.experiments.accuracy.points import SCENES, end_of
from softlab.bench.measure.words import number, seconds
from softlab.labbook.film.canvas import CPU, FAINT, GPU, INK, LINE, MARGIN, WARNING, WHITE, Area, Canvas, Colour
from softlab.model.base.errors import Diverged
from softlab.model.core.build import build
from softlab.model.core.families import stability_limit
from softlab.model.scene.scene import Scene, load_scene
from softlab.plots.core.accuracy_points import Point, points
from softlab.plots.core.data import Results
from softlab.plots.figures.work_precision import accurate_source

SCENE = "S1"
METHODS: tuple[tuple[str, str, Colour], ...] = (
    ("lab", "The hand-out's step (lab)", WARNING), ("velocity-verlet", "velocity-verlet", CPU),
)  # fmt: skip
FINER = 10  # steps of the reference per step of the methods
STILL = 0.3  # fraction of the frames at the end that show the end
LOW, HIGH = 1e-5, 1e0  # spacings: range of the graph
CORNER = 5.0  # spacings of the curtain that are visible
REFERENCE = (190, 194, 200)
OVER = (1.05, 1.1, 1.2, 1.3, 1.5, 2.0)  # times the limit: the first that diverges is shown
STEPS = 200  # steps within which it must diverge
BREAKING = "lab"  # the method that is shown to diverge


@dataclass(frozen=True)
class Judged:
    """States of S1 [m] after every step of `dt` [s]: of each method, of the reference, and the methods' errors
    [spacings].
    """

    scene: Scene
    states: dict[str, list[np.ndarray]]
    reference: list[np.ndarray]
    errors: dict[str, list[float]]

    @property
    def end(self) -> float:
        """Simulated time [s]."""
        return (len(self.reference) - 1) * self.scene.method.dt


def states_of(
    scene: Scene, integrator: str, steps: int, finer: int = 1, precision: str = "float64"
) -> list[np.ndarray]:
    """Return positions after each of the scene's steps, of `finer` steps each; the list ends where the run diverges."""
    changed = scene.replace({"method.integrator": integrator, "method.dt": scene.method.dt / finer})
    with open_simulation(changed, precision=precision, math="exact", threads=1, allow_unstable=True) as simulation:
        states = [simulation.read("position").astype(np.float64)]
        for _ in range(steps):
            try:
                simulation.advance(finer)
                simulation.check()
            except Diverged:
                break
            states.append(simulation.read("position").astype(np.float64))
    return states


@lru_cache(maxsize=2)
def judged(rows: int | None = None) -> Judged:
    """Return the states of S1, with that many rows and columns (None: its own)."""
    scene = load_scene(SCENES[SCENE])
    if rows is not None:
        scene = scene.replace({"grid.rows": rows, "grid.columns": rows})
    steps = round(end_of(SCENE) / scene.method.dt)
    reference = states_of(scene, "rk4", steps, FINER)
    states = {name: states_of(scene, name, steps) for name, _, _ in METHODS}
    free = build(scene).inverse_mass > 0
    errors = {
        name: [distance(a, b, free, scene.grid.spacing)[0] for a, b in zip(positions, reference, strict=True)]
        for name, positions in states.items()
    }
    return Judged(scene, states, reference, errors)


def stored(results: Results, integrator: str, dt: float) -> Point | None:
    """Return the store's result of that method in S1, on the CPU in float32: the time that is shown with the error."""
    source = accurate_source(results)
    candidates = (
        [p for p in points(source, SCENE) if p.integrator == integrator and p.backend == "cpu"] if source else []
    )
    candidates = [p for p in candidates if abs(p.dt - dt) < 1e-12 and p.seconds is not None]
    return min(candidates, key=lambda p: p.precision, default=None)


def draw_errors(comparison: Judged, results: Results, area: Area, count: int, fps: int) -> Iterator[Image.Image]:
    """Yield a corner of the curtain by each method, over the reference, with the growing errors on the right."""
    moving = max(2, round(count * (1 - STILL)))
    last = len(comparison.reference) - 1
    image, shown = None, -1
    for frame in range(count):
        at = min(last, round(last * frame / (moving - 1)))
        if image is None or at != shown:
            image, shown = _errors_at(comparison, results, at, area), at
        yield image


def _errors_at(comparison: Judged, results: Results, at: int, area: Area) -> Image.Image:
    """Return the picture after that many steps."""
    canvas, dt = area.canvas(), comparison.scene.method.dt
    panel = (canvas.width - 4 * MARGIN) / 3
    text = f"{at} steps of {seconds(dt, 2)}: {at * dt:.2f} s simulated.   Lower right corner of the curtain; grey: reference"
    canvas.text(MARGIN, 14, f"{text} (rk4, float64, {seconds(dt / FINER, 2)})", 20, anchor="lm")
    for side, (name, title, colour) in enumerate(METHODS):
        x = MARGIN + side * (panel + MARGIN)
        canvas.box(x, 36, panel, 3, colour)
        canvas.text(x, 42, canvas.shortened(title, panel, 20, True), 20, colour, bold=True)
        tall = area.pixels(canvas.height - 152)
        canvas.paste(_overlay(comparison, name, at, area.pixels(panel), tall, colour), x, 72)
        _draw_error(canvas, results, comparison, name, at, x, colour)
    _draw_graph(canvas, comparison, at, MARGIN + 2 * (panel + MARGIN), panel)
    return canvas.image


def _overlay(comparison: Judged, name: str, at: int, width: int, height: int, colour: Colour) -> np.ndarray:
    """Return the last CORNER rows and columns of masses: (height, width, 3).

    The reference is grey and stands still; the method is drawn over it.
    """
    grid, fine = comparison.scene.grid, 3  # times as many pixels, for smooth edges
    image = Image.new("RGB", (fine * width, fine * height), WHITE)
    draw = ImageDraw.Draw(image)
    scale = fine * width / CORNER / grid.spacing
    right, lowest = comparison.reference[at][-1] * (1, -1) + 0.5 * grid.spacing
    for position, ink, thick in (
        (comparison.reference[at], REFERENCE, 0.06),
        (comparison.states[name][at], colour, 0.025),
    ):
        places = position.reshape(grid.rows, grid.columns, 2) * (1, -1) - (right, lowest)
        pixels = places * scale + (fine * width, fine * height)
        for lines in (pixels, pixels.swapaxes(0, 1)):
            for line in lines:
                draw.line([*map(tuple, line.tolist())], fill=ink, width=max(1, round(thick * scale)))
    return np.asarray(image.resize((width, height), Image.Resampling.BOX))


def _draw_error(
    canvas: Canvas, results: Results, comparison: Judged, name: str, at: int, x: float, colour: Colour
) -> None:
    y = canvas.height - 74
    canvas.text(x, y, f"error {number(comparison.errors[name][at], 2)} spacings", 24, colour, bold=True)
    point = stored(results, name, comparison.scene.method.dt)
    if point is not None and point.seconds is not None:
        least = f"{seconds(point.seconds, 2)} a simulated second (CPU)"
        text = f"time {least[:-1]}, {point.precision})"
        canvas.text(x, y + 38, canvas.fitting((text, least), 400, 16), 16, FAINT)


def _draw_graph(canvas: Canvas, comparison: Judged, at: int, x: float, width: float) -> None:
    """Draw both errors against time, on a logarithmic scale."""
    top, bottom = 76.0, canvas.height - 60
    left = x + 44
    last = len(comparison.reference) - 1
    decades = range(round(log10(LOW)), round(log10(HIGH)) + 1)

    def height(error: float) -> float:
        fraction = (log10(min(max(error, LOW), HIGH)) - decades[0]) / (decades[-1] - decades[0])
        return bottom - fraction * (bottom - top)

    canvas.text(x, 42, "error / spacings", 18, INK, bold=True)
    for decade in decades:
        y = height(10.0**decade)
        canvas.box(left, y, width - 44, 1, LINE)
        canvas.text(left - 6, y, f"{10.0**decade:g}", 14, FAINT, anchor="rm")
    for name, _, colour in METHODS:
        ran = [(left + k / last * (width - 44), height(comparison.errors[name][k])) for k in range(1, at + 1)]
        canvas.path(ran, colour, 3)
    end = last * comparison.scene.method.dt
    canvas.text(left, bottom + 8, "0 s", 14, FAINT)
    canvas.text(x + width, bottom + 8, f"{end:g} s simulated", 14, FAINT, anchor="ra")


# ---------------------------------------------------------------------- divergence


@dataclass(frozen=True)
class Breaking:
    """S1 with a step size [s] at its limit and one above it, `times` the limit; `lost`: the step at which the latter
    diverged.
    """

    scene: Scene
    limit: float
    times: float
    lost: int
    stable: list[np.ndarray]
    broken: list[np.ndarray]


@lru_cache(maxsize=2)
def breaking(rows: int | None = None) -> Breaking | None:
    """Return the smallest of the step sizes OVER that diverges within STEPS; None if none does."""
    scene = load_scene(SCENES[SCENE]).replace({"method.integrator": BREAKING})
    if rows is not None:
        scene = scene.replace({"grid.rows": rows, "grid.columns": rows})
    limit = stability_limit(scene)
    stable = states_of(scene.replace({"method.dt": limit}), BREAKING, STEPS)
    for times in OVER:
        states = states_of(scene.replace({"method.dt": times * limit}), BREAKING, STEPS)
        if len(states) <= STEPS < len(stable):
            return Breaking(scene, limit, times, len(states), stable, states)
    return None


def draw_breaking(case: Breaking, area: Area, count: int, fps: int) -> Iterator[Image.Image]:
    """Yield both runs side by side, a step at a time; one that has diverged keeps its last state."""
    last = min(STEPS, case.lost + 20)
    moving = max(2, round(count * (1 - STILL)))
    wide, tall = area.pixels(area.width / area.scale / 2 - 2 * MARGIN), area.pixels(area.height / area.scale - 108)
    sides: Sequence[tuple[list[np.ndarray], float, Colour]] = (
        (case.stable, 1.0, GPU), (case.broken, case.times, WARNING),
    )  # fmt: skip
    with OffscreenRenderer(case.scene, wide, tall, legend=False) as renderer:
        for position in (case.stable[0], case.stable[-1]):
            renderer.fit(position)
        for frame in range(count):
            at = min(last, round(last * frame / (moving - 1)))
            canvas = area.canvas()
            for side, (states, times, colour) in enumerate(sides):
                x = MARGIN + side * canvas.width / 2
                lost = at >= len(states)
                renderer.draw(states[min(at, len(states) - 1)])
                canvas.paste(renderer.image(), x, 36)
                canvas.box(x, 30, canvas.width / 2 - 2 * MARGIN, 3, colour)
                dt = times * case.limit
                what = "the stability limit" if times == 1.0 else f"{number(times, 2)} times the limit"
                canvas.text(x, 4, f"step size {seconds(dt)}: {what}", 20, colour, bold=True)
                text = f"diverged at step {len(states)}" if lost else f"{at} steps, {at * dt:.2f} s simulated"
                canvas.text(x, canvas.height - 58, text, 24, WARNING if lost else INK, bold=lost)
            yield canvas.image
