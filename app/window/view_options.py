"""View options that the window's keys change in all views alike, with the messages about them."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin

import numpy as np

from softlab.app.render.detail import Detail, next_detail
from softlab.app.render.view import View
from softlab.app.window.demo import NO_BODIES, Demo

OF_PLANE = "a scene in a plane is always drawn in the same way"


class ViewOptions:
    """View options of the `views` of a demo's worlds: keys L, V, and for bodies P, K, C, I, O, for fluids O, W."""

    def __init__(self, demo: Demo, views: Sequence[View]):
        self.demo = demo
        self._of(views)

    def _of(self, views: Sequence[View]) -> None:
        self.views, scene = views, self.demo.world.scene
        self._space, self._bodies = scene.dimensions == 3, bool(scene.bodies)
        self._subject = views[0].subject

    def renew(self, views: Sequence[View], before: Sequence[View], alike: bool = True) -> None:
        """Use new `views`, with the options of those `before` that apply to them; for scenes that are not `alike` only
        the light and the quality."""
        self._of(views)
        old = before[0]
        for view in views:
            if view.space and old.space:
                view.show_in(old.detail)
                view.shine(old.light)
            if type(view) is not type(old) or not alike:
                continue
            if view.space:
                view.show_colliders(old.colliders)
            for name in view.options:
                if view.shows(name) != old.shows(name):
                    view.toggle(name)
            if old.colourings:
                self._colour(view, old.colouring)

    @staticmethod
    def _colour(view: View, colouring: str) -> None:
        """Advance the colouring until it is this one, at most once around."""
        for _ in range(3):
            if view.colouring != colouring:
                view.next_colouring()

    def colour_by(self, colouring: str) -> None:
        """Colour bodies, tetrahedra or fluids by one of the choices of key O."""
        for view in self.views:
            if view.colourings:
                self._colour(view, colouring)
        self.demo.say(f"coloured by {colouring}")

    def toggle_colliders(self) -> None:
        """Show or hide the colliders; the ground stays."""
        for view in self.views:
            view.show_colliders(not view.colliders)

    def shine(self, azimuth: float, height: float) -> None:
        """Set the direction to the light that casts shadows, in space: `azimuth` [rad] about the vertical, 0 at +z, and
        elevation `height` [rad]."""
        flat = cos(height)
        light = np.array([flat * sin(azimuth), sin(height), flat * cos(azimuth)])
        for view in self.views:
            view.shine(light)

    def show_in(self, detail: Detail) -> None:
        """Set the quality of the picture, in space."""
        for view in self.views:
            view.show_in(detail)
        self.demo.say(f"picture quality {detail.name}: {detail.meaning}")

    def toggle_lines(self) -> None:
        """Show a cloth as a surface or as springs, bodies as skins or as particles, a fluid as surface or particles
        (L). A grid is always springs."""
        if self._bodies:
            self.toggle("lines")
        elif self._space or self._subject == "fluid":
            shown = [view.toggle_lines() for view in self.views]
            lines = "particles" if self._subject == "fluid" else "springs, coloured by strain"
            self.demo.say(lines if shown[0] else "surface")
        else:
            self.demo.say(OF_PLANE)

    def toggle(self, name: str) -> None:
        """Show or hide `particles`, `skin`, centres of `clusters`, or `links` of bodies, or the skin of tetrahedra (P,
        K, C, I)."""
        if self._subject == "tetrahedra" and name == "skin":
            skins = [view.toggle_skin() for view in self.views if "skin" in view.options]
            self.demo.say("skin" if skins[0] else "the outer faces of the tetrahedra")
            return
        if not self._bodies:
            self.demo.say(NO_BODIES)
            return
        for view in self.views:
            view.toggle(name)
        first = self.views[0]
        inside = " and ".join(part for part in ("particles", "clusters", "links") if first.shows(part))
        self.demo.say(" behind the ".join(word for word in (inside, "skin" if first.skin else "") if word))
        if name == "links" and not any(len(copy.baked.links) for copy in self.demo.world.scene.body_set.copies):
            self.demo.say("these bodies have no links")

    def toggle_foam(self) -> None:
        """Show or hide spray, foam and bubbles of fluids (W)."""
        shown = [view.toggle_foam() for view in self.views]
        if shown[0] is None:
            self.demo.say("this scene has no fluids")
            return
        self.demo.say("spray, foam and bubbles on" if shown[0] else "spray, foam and bubbles off")

    def next_colouring(self) -> None:
        """Colour particles by body, by group, by cluster; tetrahedra by body, by stress, by strain; fluids by fluid, by
        speed, by density; in turn (O)."""
        first = self.views[0]
        if not first.colourings:
            self.demo.say(NO_BODIES)
            return
        for view in self.views:
            if view.colourings:
                view.next_colouring()
        if self._bodies:
            self.demo.say(f"particles coloured by {first.colouring}" + ("" if first.particles else " (P shows them)"))
            return
        shown = "" if first.lines == (self._subject == "fluid") else f" (L shows {self._coloured})"
        self.demo.say(f"coloured by {first.colouring}{shown}")

    @property
    def _coloured(self) -> str:
        """Name of the things that key O colours."""
        return "particles" if self._subject == "fluid" else "surfaces"

    def next_detail(self) -> None:
        """Choose the next quality of the picture (V)."""
        if not self._space:
            self.demo.say(OF_PLANE)
            return
        self.show_in(next_detail(self.views[0].detail))
