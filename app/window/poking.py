"""Worlds with a hand in them: selecting a mass with the mouse or the arrows, and pulling or poking it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softlab.app.presentation import presentation_of
from softlab.app.window.hand import Poke, neighbour
from softlab.app.window.worlds import Worlds

PULLED = "a mass was pulled"


class Poking(Worlds):
    """See `Worlds`. Never raises for what a user does."""

    def name(self, particle: int) -> str:
        """`row, column` of a mass; of bodies the particle's number, and whose it is; of a world the same of its member."""
        return presentation_of(self.world.scene).particle_name(self.world.scene, particle)

    def force(self) -> tuple[float, ...]:
        """The held force [N], of as many components as the world has; 0 without one."""
        return self.hand.force(self.world, self.position, self._hold_time())

    def _tell_selection(self, particle: int) -> None:
        pinned = self.world.body.inverse_mass[particle] == 0
        what = presentation_of(self.world.scene).particle
        self.say(f"{what} {self.name(particle)} selected" + ("; it is pinned" if pinned else ""))

    def move_selection(self, columns: int, rows: int, direction: Sequence[float] | None = None) -> None:
        """Arrows: select the neighbour `columns` to the right and `rows` up; the first press selects the middle.

        The `direction` (in the plane that same way) is also where Enter pokes to from then on.
        """
        towards = (float(columns), float(rows)) if direction is None else tuple(direction)
        grips = presentation_of(self.world.scene).grips
        if grips and not self.world.body.inverse_mass.any():
            self.say("no active body to select")
            return
        if grips and self.hand.selected is not None:
            body_set = self.world.scene.body_set
            own = np.flatnonzero(body_set.body == body_set.body[self.hand.selected])
            self._tell_selection(self.hand.move_to(neighbour(self.position, own, self.hand.selected, towards), towards))
            return
        self._tell_selection(self.hand.move(columns, rows, self.world, towards))

    def take(self, particle: int, target: Sequence[float]) -> bool:
        """Select a mass and pull it toward `target` [m] until `release`."""
        if self._blocked():
            return False
        self.disturb(PULLED)
        self.hand.selected = particle
        self.hand.held = Poke(particle, tuple(target))
        self._tell_selection(particle)
        return self._guard(self._push)

    def drag(self, *target: float) -> None:
        """The pointer is at `target` [m] now."""
        held = self.hand.held
        if held is not None and held.target is not None:
            self.hand.held = Poke(held.particle, target)

    def press_key(self) -> None:
        """Enter down: poke the selected mass downward, or the way of the last arrow key."""
        if self._blocked():
            return
        if self.hand.selected is None:
            self.move_selection(0, 0)
            self.hand.direction = self.hand.down
        if self.hand.selected is not None and self.hand.held is None:
            self.disturb(PULLED)
            self.hand.held = Poke(self.hand.selected, None, self.hand.direction)
            self._guard(self._push)

    def release(self) -> None:
        """Mouse or Enter up."""
        if self.hand.held is not None:
            self.hand.held = None
            self._guard(self._push)
