"""A panel without a window: a real Demo, what a window would show of it made up, and a hand that moves, presses and types."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, Self

import numpy as np

from softlab.app.render.detail import FINE
from softlab.app.render.fluid.view import COLOURINGS as OF_FLUIDS
from softlab.app.render.particle_colours import COLOURINGS as OF_BODIES
from softlab.app.render.tetrahedra_view import COLOURINGS as OF_TETRAHEDRA
from softlab.app.render.views import camera_of
from softlab.app.window.demo import Demo
from softlab.app.window.frame_times import FrameTimes
from softlab.app.window.panel import layout
from softlab.app.window.panel.context import Context
from softlab.app.window.panel.state import PanelState
from softlab.app.window.panel.style import PanelStyle
from softlab.app.window.shots import Shots
from softlab.app.window.view_options import ViewOptions
from softlab.model.scene.scene import Scene

WIDTH, HEIGHT = 1200, 4000  # pixels: so high that nothing is scrolled out of sight


class FakeView:
    """What the panel asks of a view."""

    def __init__(self, scene: Scene):
        self.scene, self.space = scene, scene.dimensions == 3
        self.detail, self.lines, self.colliders = FINE, False, True
        self.particles, self.skin, self.clusters, self.links = False, True, False, False
        kinds = {"bodies": scene.bodies, "tetrahedra": scene.tetrahedra, "fluid": scene.fluids}
        self.subject = next((name for name, parts in kinds.items() if parts), "sheet")
        known = {"bodies": OF_BODIES, "tetrahedra": OF_TETRAHEDRA, "fluid": OF_FLUIDS}
        self.colourings = known.get(self.subject, ())
        self.colouring, self.light, self.foam = (*self.colourings, "body")[0], np.array([0.0, 0.8, 0.6]), False

    def toggle_lines(self) -> bool:
        self.lines = not self.lines
        return self.lines

    def toggle_skin(self) -> bool:
        self.skin = not self.skin
        return self.skin

    def toggle_particles(self) -> None:
        self.particles = not self.particles

    def next_colouring(self) -> None:
        self.colouring = self.colourings[(self.colourings.index(self.colouring) + 1) % len(self.colourings)]

    def toggle_foam(self) -> bool:
        self.foam = not self.foam
        return self.foam

    def show_colliders(self, shown: bool) -> None:
        self.colliders = shown

    def shine(self, light: np.ndarray) -> None:
        self.light = light

    def show_in(self, detail: Any) -> None:
        self.detail = detail


class Stage:
    """`demo`, and a panel over it of which every section is open; a context manager. `drag`, `click`, `type_into`: by the
    names of what was laid out."""

    def __init__(self, *scenes: Scene, look: PanelStyle | None = None, judge: Any = None, **options: Any):
        self.demo = Demo(scenes, threads="1", math="exact", **options)
        first, views = scenes[0], [FakeView(scene) for scene in scenes]
        self.viewer: Any = SimpleNamespace(
            demo=self.demo, width=WIDTH, height=HEIGHT, shown_width=WIDTH - 372, space=first.dimensions == 3,
            bodies=bool(first.bodies), views=views, shots=Shots(self.demo), judge=judge,
            view_options=ViewOptions(self.demo, views),
            camera=camera_of(first, WIDTH, HEIGHT), follow=True, frame_seconds=1 / 60, draw_seconds=0.0,
            frame_everything=lambda: None,
            overlay=SimpleNamespace(
                times=FrameTimes(), show_keys=False, show_graph=False, show_numbers=True, toggle_keys=lambda: None,
                toggle_graph=lambda: None, toggle_numbers=lambda: None,
            ),
        )  # fmt: skip
        self.context, self.state, self.style = Context(look), PanelState(), look or PanelStyle()
        self.style = self.context.style
        self.layout = layout.Layout(self.context.imgui, self.viewer, self.style, self.state, every=True)
        self.frames()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.context.make_current()
        self.context.close()
        self.demo.close()

    def frames(self, count: int = 3) -> None:
        """Let some frames of the panel pass, not of the scene."""
        for _ in range(count):
            self.context.frame(WIDTH, HEIGHT, self.layout.draw, seconds=1 / 60)

    def at(self, name: str, share: float = 0.5) -> tuple[float, float]:
        """A place on what has this name, `share` of its width from its left."""
        left, top, right, bottom = self.state.places[name]
        return left + share * (right - left), (top + bottom) / 2

    def press(self, name: str, share: float = 0.5) -> None:
        """Move there, and the left button down."""
        self.context.mouse_at(*self.at(name, share))
        self.frames(2)
        self.context.mouse_button(0, True)
        self.frames(2)

    def let_go(self) -> None:
        """The left button up."""
        self.context.mouse_button(0, False)
        self.frames(3)

    def click(self, name: str, share: float = 0.5) -> None:
        """Press and let go."""
        self.press(name, share)
        self.let_go()

    def drag(self, name: str, start: float, end: float) -> None:
        """From one share of a slider to another; the button stays down."""
        self.press(name, start)
        self.context.mouse_at(*self.at(name, end))
        self.frames(2)

    def type_into(self, name: str, text: str) -> None:
        """Ctrl and a click on a slider, what is there replaced by `text`, Enter."""
        self.context.key("LCTRL", True)
        self.frames(1)
        self.click(name)
        self.context.key("LCTRL", False)
        self.frames(2)
        self.context.text(text)
        self.frames(2)
        for down in (True, False):
            self.context.key("RETURN", down)
            self.frames(2)
