"""The overlays of the demo's picture: numbers, legend, messages, keys, the graph of frame times, the force's arrow."""

from __future__ import annotations

import math
from time import perf_counter

import numpy as np

from softlab.app.render import colours
from softlab.app.render.legends import Legends
from softlab.app.render.opengl import drawing_text
from softlab.app.render.panels import Arrow, Panel, Style
from softlab.app.window.demo_report import numbers_text, title_text
from softlab.app.window.frame_times import FrameGraph, FrameTimes
from softlab.app.window.keys import hint, keys_text
from softlab.app.window.window_protocol import WindowProtocol

NUMBERS = Style(13, bold=True), Style(10), Style(9, colour=colours.FAINT)  # the first line matters most
TITLE = Style(11, bold=True), Style(10)
MESSAGE_SECONDS = 8.0
TEXT_INTERVAL = 0.1  # s between two renewals of the numbers: faster cannot be read


class Overlay:
    """Text and marks over a Viewer's picture. `show_keys`, `show_numbers`, `show_graph`: which of them are shown;
    `times` of the last frames. Needs the window's OpenGL context."""

    def __init__(self, viewer: WindowProtocol):
        self.viewer, self.demo = viewer, viewer.demo
        with drawing_text():
            self._numbers, self._keys = Panel("top-left", NUMBERS), Panel("centre", [Style(11)])
            self._hint = Panel("bottom-left", [Style(9, monospaced=False)])
            self._notice = Panel("top-left")
            self._warning = Panel("top-left", [Style(11, colour=colours.WARNING)], colours.WARNING)
            self._arrow, self._graph = Arrow(), FrameGraph()
        self.renew()
        self.times = FrameTimes()
        self.show_keys, self.show_numbers, self.show_graph = False, True, False
        self._keys_seen = False
        self._text_due = 0.0
        self._message = (self.demo.message_count, perf_counter())

    def renew(self) -> None:
        """Make the legends and titles of the current scenes."""
        with drawing_text():
            self._legends = Legends(self.demo.world.scene)
            several = len(self.demo.worlds) if len(self.demo.worlds) > 1 else 0
            self._titles = [Panel("top-left", TITLE) for _ in range(several)]
            self._chosen = [Panel("top-left", TITLE, colours.SELECTED) for _ in range(several)]

    def toggle_keys(self) -> None:
        """Show or hide the keys (H)."""
        self.show_keys = not self.show_keys
        self._keys_seen = True

    def toggle_numbers(self) -> None:
        """Show or hide the lines about speed, counts and settings (N)."""
        self.show_numbers = not self.show_numbers

    def toggle_graph(self) -> None:
        """Show or hide the milliseconds of the last frames (M)."""
        self.show_graph = not self.show_graph

    def draw(self, now: float) -> None:
        """Draw all overlays, at `now` [s] of perf_counter."""
        self._draw_hand()
        viewer, demo = self.viewer, self.demo
        width, height = viewer.shown_width, viewer.height
        below = self._draw_numbers(now) if self.show_numbers else 0
        below += self._draw_titles()
        self._legends.draw(viewer.views[0], width, demo.statistics.strain_range)
        if demo.message_count != self._message[0]:
            self._message = (demo.message_count, now)
        if demo.frozen:
            self._warning.place(demo.failure, width, height, below)
            self._warning.draw()
            below += self._warning.height + 8
        if demo.message and now < self._message[1] + MESSAGE_SECONDS:
            self._notice.place(demo.message, width, height, below)
            self._notice.draw()
        above = 0
        subject, several = viewer.views[0].subject, len(demo.worlds) > 1
        if self.show_keys:
            self._keys.place(keys_text(width, subject, viewer.space, several), width, height)
            self._keys.draw()
        elif not self._keys_seen and not viewer.panel.open:
            self._hint.place(hint(subject, viewer.space, several), width, height)
            self._hint.draw()
            above = self._hint.height + 8
        if self.show_graph:
            self._graph.draw(self.times, above)

    def _draw_numbers(self, now: float) -> int:
        """Draw the numbers. Returns their height in pixels, with a gap."""
        viewer = self.viewer
        if now >= self._text_due:
            self._text_due = now + TEXT_INTERVAL
            view = viewer.views[self.demo.current]
            notes = [f"{view.detail.name}{viewer.drawn_by}"] if viewer.space else []
            if self.demo.world.backend == "gpu":  # a CPU has only one path to the drawing
                notes.append(view.vertices.transfer)
            drawn = ", ".join(notes)
            text = numbers_text(self.demo, viewer.frame_seconds, viewer.draw_seconds, drawn, viewer.panel.open)
            self._numbers.place(text, viewer.shown_width, viewer.height)
        self._numbers.draw()
        return self._numbers.height + 8

    @property
    def numbers_height(self) -> int:
        """Height of the numbers at the top [pixels]."""
        return self._numbers.height + 16 if self.show_numbers else 0

    def _draw_titles(self) -> int:
        """Draw the titles of worlds side by side. Returns the height of the first, with a gap."""
        viewer, demo = self.viewer, self.demo
        for number, (plain, chosen) in enumerate(zip(self._titles, self._chosen, strict=True)):
            pane = viewer.panes[number]
            top = viewer.height - pane.bottom - pane.height
            panel = chosen if demo.alone and number == demo.current else plain
            panel.place(title_text(demo, number), pane.width, viewer.height, top, pane.left)
            panel.draw()
        first = self._chosen if demo.alone and demo.current == 0 else self._titles
        return first[0].height + 8 if first else 0

    def _draw_hand(self) -> None:
        """Draw the arrow of the poke's force."""
        poke, demo, camera = self.demo.picker.poke, self.demo, self.viewer.camera
        if poke is None:
            return
        place = demo.position[poke.particle].astype(float)
        start, pane = camera.to_window(place), self.viewer.panes[demo.current]
        force = demo.force()
        if poke.target is not None:
            end = camera.to_window(np.array(poke.target))
        else:
            direction = camera.to_window(place + demo.world.scene.grid.spacing * np.array(poke.direction)) - start
            end = start + 70 * direction / (np.hypot(*direction) or 1.0)
        if np.isfinite([start, end]).all():
            corner = np.array([pane.left, pane.bottom])
            window = self.viewer.shown_width, self.viewer.height
            self._arrow.draw(tuple(start + corner), tuple(end + corner), force_text(math.hypot(*force)), window)


def force_text(newtons: float) -> str:
    """Return a force in words, with at least three digits."""
    return f"{newtons:.0f} N" if 1000 <= newtons < 1e6 else f"{newtons:.3g} N"
