"""Scenes in space, computed and drawn while the film is made, at a speed of their own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from time import perf_counter

from PIL import Image

from softlab.app.driver import open_simulation
from softlab.app.output.offscreen import OffscreenRenderer
from softlab.app.presentation import presentation_of
from softlab.bench.measure.words import count as counted
from softlab.bench.measure.words import seconds
from softlab.labbook.film.canvas import FAINT, INK, MARGIN, Area
from softlab.model.core.simulation import Simulation
from softlab.model.scene.scene import load_scene

SHOWN = ("cloth-sphere", "soft-pile")
SLOWED = 2.0  # times: a fall of half a metre is too short to follow at true speed
EVERY = 2  # frames of the film per drawn frame: shadows are slow without a graphics card


class Panel:
    """A running scene and its renderer."""

    def __init__(self, name: str, backend: str, width: int, height: int, stack: ExitStack):
        self.scene = load_scene(name)
        self.simulation: Simulation = stack.enter_context(open_simulation(self.scene, backend))
        self.renderer = stack.enter_context(OffscreenRenderer(self.scene, width, height, legend=False))
        self.renderer.show_bodies(self.simulation.body.inverse_mass)
        self.title = self.scene.title or name
        self.moving = int((self.simulation.body.inverse_mass > 0).sum())
        self.took, self.steps = 0.0, 0

    def advance(self, until: float) -> None:
        """Compute up to time `until` [s] of the scene, and draw the state."""
        steps = round(until / self.scene.method.dt) - self.steps
        if steps > 0:
            begin = perf_counter()
            self.simulation.advance(steps)
            self.simulation.check()
            self.took += perf_counter() - begin if self.steps else 0.0  # the first step may have compiled
            self.steps += steps
        normal = self.simulation.read("normal") if "normal" in presentation_of(self.scene).drawn(self.scene) else None
        position = self.simulation.read("position")
        self.renderer.fit(position, self.simulation.time)
        self.renderer.draw(position, self.simulation.time, normal)


def draw_bodies(backend: str, area: Area, count: int, fps: int, shown: Sequence[str] = SHOWN) -> Iterator[Image.Image]:
    """Yield the frames with a panel per scene, drawn every EVERY frames of the film."""
    width = area.width / area.scale / len(shown) - 2 * MARGIN
    wide, tall = area.pixels(width), area.pixels(area.height / area.scale - 96)
    with ExitStack() as stack:
        panels = [Panel(name, backend, wide, tall, stack) for name in shown]
        image: Image.Image | None = None
        for frame in range(count):
            if image is None or frame % EVERY == 0:
                image = _drawn(panels, area, frame / fps / SLOWED)
            yield image


def _drawn(panels: Sequence[Panel], area: Area, time: float) -> Image.Image:
    canvas = area.canvas()
    for side, panel in enumerate(panels):
        x = MARGIN + side * canvas.width / len(panels)
        panel.advance(time)
        canvas.paste(panel.renderer.image(), x, 34)
        canvas.text(x, 4, panel.title, 20, INK, bold=True)
        y = canvas.height - 56
        canvas.text(x, y, f"{counted(panel.moving)} particles, {time:.2f} s simulated", 20)
        if panel.took > 0:
            cost = panel.took / max(panel.simulation.time, panel.scene.method.dt)
            text = f"{seconds(cost, 2)} of computing a simulated second here ({panel.simulation.backend.upper()})"
            canvas.text(x, y + 28, text, 16, FAINT)
    return canvas.image
