"""The interactive demo in a window. The actions of the keys are in app/window/demo.py; this module draws and receives
events. pyglet is imported inside functions, so that the module can be imported without a display.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter

from softlab.app.render import colours
from softlab.app.render.camera import Camera
from softlab.app.render.detail import by_software
from softlab.app.render.opengl import load_pyglet, open_window, renderer_name
from softlab.app.render.panels import EDGE
from softlab.app.render.view import View
from softlab.app.render.views import camera_of, view_of
from softlab.app.window.compiling import Compiling
from softlab.app.window.controls import Controls
from softlab.app.window.demo import Demo
from softlab.app.window.demo_report import demo_state, write_state
from softlab.app.window.following import Following
from softlab.app.window.idle_redraw import IdleRedraw
from softlab.app.window.overlay import Overlay
from softlab.app.window.panes import GAP, Pane, check_alike, panes
from softlab.app.window.shots import Shots
from softlab.app.window.view_options import ViewOptions
from softlab.app.window.window_protocol import Judge, panel_of
from softlab.model.scene.scene import Scene

WIDTH, HEIGHT = 1200, 900
FOLLOW_FRACTION = 0.12  # of the way to the view that shows everything, per frame
COMPILING_INTERVAL = 0.25  # s between two frames while something is compiled
STATE_FRAMES = 3  # frames between two writes of the state file


class Viewer:
    """The window over a Demo: draws it frame by frame, and turns keys and mouse into its actions."""

    def __init__(self, demo: Demo, state_file: Path | None, frames: int | None, judge: Judge | None = None):
        self.pyglet = load_pyglet(False)
        self.demo = demo
        self.space, self.bodies = demo.world.scene.dimensions == 3, bool(demo.world.scene.bodies)
        self.state_file, self.frames = state_file, frames
        caption = f"softlab: {', '.join(demo.titles)}"
        self.window = open_window(False, WIDTH, HEIGHT, caption)
        self.shots = Shots(demo)
        try:
            self.window.set_minimum_size(480, 360)
            self.views: list[View] = [view_of(scene, quick=True) for scene in demo.scenes]
            self.drawn_by = ", by software" if by_software(renderer_name()) else ""
            self.view_options = ViewOptions(demo, self.views)
            self.overlay = Overlay(self)
        except BaseException:
            self.window.close()
            raise
        self.judge = judge
        self.panel = panel_of(self)
        self.camera: Camera = camera_of(demo.world.scene, WIDTH, HEIGHT)  # for every pane
        self._lay_out()
        self.follow = True
        self.compiling = Compiling(demo)
        self.following = Following(self)
        self.frame_count = 0
        self.frame_seconds = 1 / 60
        self.draw_seconds = 0.0
        self._generation, self._scenes = demo.generation, demo.scenes
        self._last_frame = perf_counter()
        self.following.approach(1.0)
        self.controls = Controls(self)
        self.window.push_handlers(on_draw=self._draw)
        self.idle_redraw = IdleRedraw(self)

    def frame_everything(self) -> None:
        """Show everything, and follow it from now on (F)."""
        self.demo.refresh(force=True)
        self.follow = True
        self.following.approach(1.0)

    def close(self) -> bool:
        """End the event loop; `run` closes the window (Escape)."""
        self.pyglet.app.exit()
        return True

    # ------------------------------------------------------------------ the frame

    def _lay_out(self) -> None:
        """Divide the window into a pane per world. Several panes lie below the numbers, so that all show the same area."""
        self.width, self.height = self.window.get_framebuffer_size()
        self.shown_width = max(self.width - self.panel.width, 64)
        several = len(self.demo.worlds) > 1
        self.panes = panes(len(self.demo.worlds), self.shown_width, self.height - several * self.overlay.numbers_height)
        self.camera.width, self.camera.height = self.panes[0].width, self.panes[0].height

    def world_at(self, x: float, y: float) -> int:
        """Return the number of the world that is drawn at a point of the window (frame-buffer pixels), or nearest to
        it."""
        return min(range(len(self.panes)), key=lambda number: self.panes[number].away(x, y))

    def drop_place(self, x: float, y: float) -> tuple[float, float, float]:
        """Return the place where D drops a body (see Following)."""
        return self.following.drop_place(x, y)

    def _upload(self) -> None:
        """Send the state of every world to its view."""
        demo = self.demo
        for number, (view, world) in enumerate(zip(self.views, demo.worlds, strict=True)):
            if demo.frozen:  # what is frozen is no world's state any more
                view.upload(demo.positions[number])
            elif view.vertices.straight(world):
                view.upload_from(world)
            else:
                view.upload_from(world, demo.positions[number])

    def _draw(self) -> None:
        """Draw one frame: physics, then the picture, both timed."""
        now = perf_counter()
        self.frame_seconds += 0.1 * (now - self._last_frame - self.frame_seconds)
        self._last_frame = now
        demo = self.demo
        if self.panel.open and not self.compiling.running:
            self.panel.lay_out()  # before the scene moves: what is pressed in it may change everything
        if demo.generation != self._generation:
            self._renew()
        self._lay_out()
        if self._compile():
            return
        self.controls.mouse.pull()
        demo.frame()
        if self.follow:
            self.following.approach(FOLLOW_FRACTION)
        self.following.stay_above_ground()
        drawing = self._paint()
        self.overlay.times.add(demo.physics_seconds, drawing)
        self.draw_seconds += 0.1 * (drawing - self.draw_seconds)
        self.shots.take(self.shown_width, self.height)
        self.frame_count += 1
        if self.state_file is not None and self.frame_count % STATE_FRAMES == 1:
            write_state(self.state_file, self.state())
        if self.frames is not None and self.frame_count >= self.frames:
            self.close()

    def _renew(self) -> None:
        """Create views of the new worlds, with the options of the previous ones; for other scenes replace
        everything."""
        demo, before = self.demo, self.views
        self._generation = demo.generation
        space, bodies = demo.world.scene.dimensions == 3, bool(demo.world.scene.bodies)
        self.views = [view_of(world.scene, quick=True) for world in demo.worlds]
        self.view_options.renew(self.views, before, alike=demo.scenes[0].name == self._scenes[0].name)
        for view in before:
            view.delete()
        if (space, bodies) != (self.space, self.bodies):
            self.camera = camera_of(demo.world.scene, WIDTH, HEIGHT)
        self.space, self.bodies = space, bodies
        self.window.set_caption(f"softlab: {', '.join(demo.titles)}")
        self.overlay.renew()
        self._lay_out()
        self.following = Following(self)
        if demo.scenes is not self._scenes:
            self._scenes = demo.scenes
            self.frame_everything()

    def _compile(self) -> bool:
        """Warm up new worlds. Returns True while this continues, which may take a minute; the window then shows their
        initial state and the time so far."""
        if self.compiling.due:
            self.demo.compiling = 0.0
            if len(self.demo.worlds) > 1:  # under the numbers, whose height is known once they are drawn
                self._paint()
                self._lay_out()
                self.following.approach(1.0)
            self._paint()
            self.window.flip()
        going = self.compiling.update()
        self.demo.compiling = self.compiling.seconds if going else None
        if going:
            self._paint(upload=False)
            if self.state_file is not None:
                write_state(self.state_file, {"frame": 0, "compiling": self.demo.compiling})
        else:
            self._last_frame = max(self._last_frame, perf_counter() - self.frame_seconds)
        return going

    def _paint(self, upload: bool = True) -> float:
        """Draw the worlds in their current state or, with `upload` False, the last one. Returns the seconds that it
        took."""
        from pyglet import gl

        demo, start = self.demo, perf_counter()
        gl.glClearColor(*EDGE, 1.0)  # what is seen between panes
        gl.glClear(gl.GL_COLOR_BUFFER_BIT)
        gl.glClearColor(*colours.BACKGROUND, 1.0)
        top = self.panes[0].bottom + self.panes[0].height + GAP
        self._clear(Pane(0, top, self.width, max(self.height - top, 0)))
        if upload:
            self._upload()
        for number, (view, world, pane) in enumerate(zip(self.views, demo.worlds, self.panes, strict=True)):
            gl.glViewport(pane.left, pane.bottom, pane.width, pane.height)
            self._clear(pane)
            selected = demo.picker.selected if number == demo.current else None
            view.draw(self.camera, demo.statistics.strain_range, selected, world.time)
        gl.glViewport(0, 0, self.width, self.height)
        self.overlay.draw(start)
        if self.panel.open:
            self.panel.draw()
        gl.glFinish()  # so that drawing is timed, and not only the asking for it
        return perf_counter() - start

    @staticmethod
    def _clear(pane: Pane) -> None:
        from pyglet import gl

        gl.glScissor(pane.left, pane.bottom, pane.width, pane.height)
        gl.glEnable(gl.GL_SCISSOR_TEST)
        gl.glClear(gl.GL_COLOR_BUFFER_BIT)
        gl.glDisable(gl.GL_SCISSOR_TEST)

    # ------------------------------------------------------------------ running

    def state(self) -> dict[str, object]:
        """Return the state of the demo and its window, for a state file (see `run_demo`)."""
        shown = {
            "frame": self.frame_count,
            "window": [self.width, self.height],
            "keys_shown": self.overlay.show_keys,
            "numbers_shown": self.overlay.show_numbers,
            "graph_shown": self.overlay.show_graph,
            "panel": self.panel.widget_places(),
            "screenshot": str(self.shots.screenshot) if self.shots.screenshot else None,
            "way": self.views[0].vertices.transfer,
        }
        view = self.views[0]
        if self.space:
            shown |= {name: view.shows(name) for name in view.options}
        if view.colourings:
            shown["colouring"] = view.colouring
        return (
            demo_state(self.demo, self.camera, self.panes[self.demo.current], self.height)
            | self.camera.as_dict()
            | shown
        )

    def _tick(self, passed: float) -> None:
        """Draw a frame if anything changed, `passed` [s] after the last one."""
        if self.compiling.running and perf_counter() < self._last_frame + COMPILING_INTERVAL:
            return  # a processor that draws compiles more slowly
        if self.frames is not None or self.idle_redraw.wanted(perf_counter()):
            self.window.draw(passed)
        else:
            self._last_frame = perf_counter()

    def run(self) -> None:
        """Show the window until it is closed."""
        self.pyglet.clock.schedule_interval(self._tick, 1 / 60)
        try:
            self.pyglet.app.run(interval=None)
        finally:
            self.pyglet.clock.unschedule(self._tick)
            if self.state_file is not None:
                write_state(self.state_file, self.state() | {"closed": True})
            self.window.switch_to()
            self.shots.end_clip()
            self.panel.close()
            for view in self.views:
                view.delete()
            self.window.close()


def run_demo(
    scenes: Sequence[Scene],
    *,
    backend: str = "cpu",
    threads: str = "1x",
    precision: str = "float32",
    math: str = "fast",
    frames: int | None = None,
    state_file: Path | None = None,
    judge: Judge | None = None,
) -> None:
    """Show one or more scenes, side by side, in a window until it is closed, or for `frames` frames.

    `state_file`: a JSON file, replaced every few frames, with the state of the demo for another program (its keys:
    `Viewer.state`). `judge`: (scene, state, None) -> (error, reason if there is none), for the panel. Raises SceneError
    (scenes that cannot be shown side by side), BackendUnavailable (no display, no OpenGL, no GPU) and what opening a
    scene raises.
    """
    check_alike(scenes)
    load_pyglet(False)  # no display: say so before anything is compiled
    with Demo(scenes, backend=backend, threads=threads, precision=precision, math=math) as demo:
        viewer = Viewer(demo, state_file, frames, judge)
        viewer.run()
        if viewer.compiling.running:  # a thread in the compiler cannot be stopped, and Python would wait for it
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(0)
