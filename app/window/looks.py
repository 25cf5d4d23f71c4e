"""What the window's keys change of how scenes are shown, in every view alike, and what is said of it."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin
from typing import Any

import numpy as np

from softlab.app.render.detail import Detail, next_detail
from softlab.app.window.demo import NO_BODIES, Demo

OF_PLANE = "a scene in a plane is always drawn in the same way"


class Looks:
    """The keys L, V and, of bodies, P, K, C, I, O, of fluids O, W over the `views` of a demo's worlds."""

    def __init__(self, demo: Demo, views: Sequence[Any]):
        self.demo = demo
        self._of(views)

    def _of(self, views: Sequence[Any]) -> None:
        self.views, scene = views, self.demo.world.scene
        self._space, self._bodies = scene.dimensions == 3, bool(scene.bodies)
        self._subject = views[0].subject

    def renew(self, views: Sequence[Any], before: Sequence[Any], alike: bool = True) -> None:
        """Of other views from now on, which look as those `before`, as far as they can; of scenes that are not `alike` the
        light and how much is drawn."""
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
    def _colour(view: Any, colouring: str) -> None:
        """The next colouring until it is this one; after as many as there are at most."""
        for _ in range(3):
            if view.colouring != colouring:
                view.next_colouring()

    def colour_by(self, colouring: str) -> None:
        """Of bodies and tetrahedra: coloured by one of what O goes through."""
        for view in self.views:
            if view.colourings:
                self._colour(view, colouring)
        self.demo.say(f"coloured by {colouring}")

    def toggle_colliders(self) -> None:
        """Show or hide what masses collide with; the ground stays."""
        for view in self.views:
            view.show_colliders(not view.colliders)

    def shine(self, turned: float, height: float) -> None:
        """In space, the light that throws shadows from `turned` [rad] about the vertical, 0 from +z, `height` [rad] up."""
        flat = cos(height)
        light = np.array([flat * sin(turned), sin(height), flat * cos(turned)])
        for view in self.views:
            view.shine(light)

    def show_in(self, detail: Detail) -> None:
        """How much goes into the picture, in space."""
        for view in self.views:
            view.show_in(detail)
        self.demo.say(f"picture quality {detail.name}: {detail.meaning}")

    def toggle_lines(self) -> None:
        """L: a cloth as a surface or as springs, bodies as skins or as particles, a fluid as surface or particles; a grid is
        springs anyway."""
        if self._bodies:
            self.toggle("lines")
        elif self._space:
            shown = [view.toggle_lines() for view in self.views]
            lines = "particles" if self._subject == "fluid" else "springs, coloured by strain"
            self.demo.say(lines if shown[0] else "surface")
        else:
            self.demo.say(OF_PLANE)

    def toggle(self, name: str) -> None:
        """P, K, C, I: of bodies the `particles`, the `skin`, the middles of `clusters`, the `links`; of tetrahedra K."""
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
        """W: of fluids spray, foam and bubbles."""
        shown = [view.toggle_foam() for view in self.views]
        if shown[0] is None:
            self.demo.say("this scene has no fluids")
            return
        self.demo.say("spray, foam and bubbles on" if shown[0] else "spray, foam and bubbles off")

    def next_colouring(self) -> None:
        """O: particles coloured by body, by group, by cluster; tetrahedra by body, by stress, by strain; fluids by fluid, by
        speed, by density."""
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
        """What has the colours that O goes through."""
        return "particles" if self._subject == "fluid" else "surfaces"

    def next_detail(self) -> None:
        """V: how much goes into the picture."""
        if not self._space:
            self.demo.say(OF_PLANE)
            return
        self.show_in(next_detail(self.views[0].detail))
