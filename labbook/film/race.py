"""Two processors side by side in real time: each does as many steps of one grid as the store says for that time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image

from softlab.app.driver import open_simulation
from softlab.app.output.offscreen import OffscreenRenderer
from softlab.bench.measure.words import count as counted
from softlab.bench.measure.words import number, seconds
from softlab.bench.store.results import Timing
from softlab.labbook.film.canvas import CPU, FAINT, FOOT, GPU, LINE, MARGIN, Area, Canvas, Colour
from softlab.model.scene.scene import Scene
from softlab.plots.core.data import Results, Source, is_suspect, is_wrong
from softlab.plots.figures.crossover import pairs

MOST_LINES = 64  # lines of a grid that are drawn; of a finer one every n-th
# fraction of its height that a grid falls, at the speed that its dampers allow: the visible part of the motion
FALL = 0.2
LEAST_TIME = 10.0  # s simulated, of small grids
STILL = 0.1  # fraction of the frames at the end that show the end
FOOT_SIZE, FOOT_LINE = 15, 22  # pixels: letters and lines of the text at the bottom


@dataclass(frozen=True)
class Runner:
    """One side: `name` of the processor, `who`: its name in a sentence, and its measurement."""

    name: str
    who: str
    timing: Timing
    colour: Colour

    @property
    def error(self) -> str:
        """Error of the timed run, in words."""
        error = self.timing.error
        text = "error not known" if error is None else f"error {number(error, 2)} spacings"
        return f"{text}, suspect" if is_suspect(self.timing) else text


@dataclass(frozen=True)
class Race:
    """The same scene on two processors, or with two numbers of threads, of one machine and one version of the code.

    `is_local`: the machine is the reader's.
    """

    scene: Scene
    runners: tuple[Runner, Runner]
    is_local: bool

    @property
    def simulated(self) -> float:
        """Time [s] that the faster one simulates while the film shows it."""
        scene = self.scene
        pull = scene.grid.mass * scene.gravity.acceleration if scene.gravity else 0.0
        drag = scene.damping.coefficient if scene.damping else 0.0
        falling = FALL * scene.grid.rows * scene.grid.spacing * drag / pull if pull > 0 else 0.0
        return max(LEAST_TIME, falling)

    @property
    def wall(self) -> float:
        """Time [s] that the faster one computes for that."""
        return min(runner.timing.median for runner in self.runners) * self.simulated / self.scene.method.dt

    def slowed(self, frames: int, fps: int) -> float:
        """Return the computing time [s] per second of film."""
        return self.wall / (frames * (1 - STILL) / fps)

    def steps(self, runner: Runner, wall: float) -> int:
        """Return the number of steps that a runner has done by then."""
        return int(wall / runner.timing.median * (1 + 1e-12))


def races(results: Results, most: int) -> list[Race]:
    """Return CPU against GPU at the smallest and the largest grid of at most `most` masses that both timed undisturbed.

    If no machine has timed both: few threads against more, at the largest size. Empty if not even that was timed.
    """
    for source in results.everyone:
        timed = [(pair.cpu, pair.gpu) for pair in pairs(source) if pair.gpu.particles <= most]
        if timed:
            timed = _trusted(timed)
            return [_race(source, both) for both in ([timed[0], timed[-1]] if len(timed) > 1 else timed)]
    for source in results.featured:
        for words in (("1", "1x"), ("1x", "4x")):
            few, many = ({t.particles: t for t in source.select("cpu", word) if not is_wrong(t)} for word in words)
            timed = [(few[size], many[size]) for size in few if size in many and size <= most]
            if timed:
                return [_race(source, _trusted(timed)[-1])]
    return []


def _trusted(timed: list[tuple[Timing, Timing]]) -> list[tuple[Timing, Timing]]:
    """Return the pairs without suspect times, if there are any."""
    return [both for both in timed if not any(map(is_suspect, both))] or timed


def _race(source: Source, both: tuple[Timing, Timing]) -> Race:
    tables = {name: dict(table) if isinstance(table, dict) else table for name, table in source.scene.items()}
    tables["grid"] |= {"rows": both[0].rows, "columns": both[0].columns}
    left, right = (_runner(source, timing, colour) for timing, colour in zip(both, (CPU, GPU), strict=True))
    return Race(Scene(tables), (left, right), source.by_user)


def _runner(source: Source, timing: Timing, colour: Colour) -> Runner:
    if timing.backend == "gpu":
        return Runner(f"GPU: {source.gpu}", "the GPU", timing, colour)
    threads = "1 thread" if timing.threads == 1 else f"{timing.threads} threads"
    return Runner(f"CPU: {source.processor}, {threads}", f"the CPU with {threads}", timing, colour)


def draw_race(race: Race, backend: str, area: Area, count: int, fps: int) -> Iterator[Image.Image]:
    """Yield the frames; `backend` computes the states in exact math, whose bits are the same on both."""
    moving = max(2, round(count * (1 - STILL)))
    walls = [race.wall * min(1.0, frame / (moving - 1)) for frame in range(count)]
    done = [[race.steps(runner, wall) for wall in walls] for runner in race.runners]
    states = [_states(race.scene, backend, steps) for steps in done]
    drawn, every = thinned(race.scene)
    wide, tall = area.pixels(area.width / area.scale / 2 - 2 * MARGIN), area.pixels(area.height / area.scale - 164)
    blank = area.canvas()
    foot_lines = blank.balanced(_foot_text(race, backend), blank.width - 2 * MARGIN, FOOT_SIZE)
    more = FOOT_LINE * (len(foot_lines) - 1)
    tall -= area.pixels(more)
    with OffscreenRenderer(drawn, wide, tall, legend=False) as renderer:
        for ends in states:
            for position in (ends[0], ends[len(ends) // 2], ends[-1]):
                renderer.fit(position)
        pictures: list[np.ndarray | None] = [None, None]
        for frame in range(count):
            canvas = area.canvas()
            _draw_clock(canvas, race, every, walls[frame], race.slowed(count, fps))
            for side, runner in enumerate(race.runners):
                picture, state = pictures[side], states[side][frame]
                if picture is None or state is not states[side][frame - 1]:
                    renderer.draw(state)
                    picture = pictures[side] = renderer.image()
                x = MARGIN + side * canvas.width / 2
                canvas.paste(picture, x, 36)
                _draw_runner(canvas, race, runner, done[side][frame], max(done[0][-1], done[1][-1]), x, more)
            for number, line in enumerate(reversed(foot_lines)):
                y = canvas.height - FOOT - FOOT_LINE * number
                canvas.text(canvas.width / 2, y, line, FOOT_SIZE, FAINT, anchor="mm")
            yield canvas.image


def _foot_text(race: Race, backend: str) -> str:
    """Return the text on the parts of the picture that are not measured, and on the source of the measurements."""
    who = "a GPU" if backend == "gpu" else "the CPU, as no GPU is here"
    whose = "measured on this machine" if race.is_local else "the committed measurements"
    return f"States: computed for the film by {who}, in exact math: both have the same bits. Times, errors: {whose}."


def _draw_clock(canvas: Canvas, race: Race, every: int, wall: float, slowed: float) -> None:
    grid = race.scene.grid
    thin = f", 1 line in {every} drawn" if every > 1 else ""
    canvas.text(MARGIN, 14, f"{grid.rows} x {grid.columns} masses{thin}", 19, anchor="lm")
    canvas.text(canvas.width / 2, 14, f"1 s of film = {seconds(slowed, 2)} of computing", 21, bold=True, anchor="mm")
    elapsed = f"{1000 * wall:.3f}" if race.wall < 0.1 else f"{1000 * wall:.0f}"
    canvas.text(canvas.width - MARGIN, 14, f"computing for {elapsed} ms", 19, anchor="rm")


def _draw_runner(
    canvas: Canvas, race: Race, runner: Runner, steps: int, most: int, x: float, above: float
) -> None:  # fmt: skip
    width, y = canvas.width / 2 - 2 * MARGIN, canvas.height - 124 - above
    canvas.box(x, y, width, 8, LINE)
    canvas.box(x, y, width * steps / max(1, most), 8, runner.colour)
    canvas.text(x, y + 14, canvas.shortened(runner.name, width, 20, True), 20, runner.colour, bold=True)
    simulated = steps * race.scene.method.dt
    canvas.text(x, y + 40, f"{counted(steps)} steps, {simulated:.2f} s simulated", 22)
    timing = runner.timing
    least = f"{seconds(timing.median)} a step; {runner.error}"
    text = f"{seconds(timing.median)} a step in {timing.precision}, median of {timing.count}; {runner.error}"
    canvas.text(x, y + 69, canvas.fitting((text, least), width, 17), 17, FAINT)
    canvas.box(canvas.width / 2 - 1, 40, 2, canvas.height - 78 - above, LINE)


def thinned(scene: Scene) -> tuple[Scene, int]:
    """Return a scene to draw a fine grid with, every n-th of its rows and columns, and n."""
    grid = scene.grid
    sides = grid.rows - 1, grid.columns - 1
    enough = [n for n in range(1, max(sides) + 1) if max(sides) // n < MOST_LINES]
    every = next((n for n in enough[: enough[0]] if all(side % n == 0 for side in sides)), enough[0])
    if every == 1:
        return scene, 1
    rows, columns = (side // every + 1 for side in sides)
    changed = {"grid.rows": rows, "grid.columns": columns, "grid.spacing": every * grid.spacing}
    springs = scene.springs
    if springs is not None:
        changed["springs.rest_length"] = every * springs.rest_length
    return scene.replace(changed), every


def _states(scene: Scene, backend: str, steps: Sequence[int]) -> list[np.ndarray]:
    """Return positions of the drawn masses after each of the numbers of steps."""
    _, every = thinned(scene)
    rows, columns = scene.grid.rows, scene.grid.columns
    states: list[np.ndarray] = []
    with open_simulation(scene, backend, math="exact") as simulation:
        at = 0
        for until in steps:
            if until > at or not states:
                simulation.advance(until - at)
                at = until
                position = simulation.read("position").reshape(rows, columns, 2)[::every, ::every]
                states.append(position.reshape(-1, 2).astype(np.float64))
            else:
                states.append(states[-1])
    return states
