"""Worlds with mouse interaction: selecting a mass with the mouse or the arrows, and pulling or poking it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softlab.app.presentation import presentation_of
from softlab.app.window.picker import Poke, neighbour
from softlab.app.window.worlds import Worlds

PULLED = "a mass was pulled"


class Poking(Worlds):
    """Worlds that can be selected, pulled and poked. User actions never raise."""

    def name(self, particle: int) -> str:
        """Return `row, column` of a mass; for bodies the particle's number and its body; for a world the number in its
        member."""
        return presentation_of(self.world.scene).particle_name(self.world.scene, particle)

    def force(self) -> tuple[float, ...]:
        """Force of the poke [N], with as many components as the world has dimensions; 0 without one."""
        return self.picker.force(self.world, self.position, self._force_interval())

    def _report_selection(self, particle: int) -> None:
        pinned = self.world.body.inverse_mass[particle] == 0
        what = presentation_of(self.world.scene).particle
        self.say(f"{what} {self.name(particle)} selected" + ("; it is pinned" if pinned else ""))

    def move_selection(self, columns: int, rows: int, direction: Sequence[float] | None = None) -> None:
        """Select the neighbour `columns` to the right and `rows` up; the first press selects the middle (arrow keys).

        The `direction` (in a plane the same) is also that of the next poke with Enter.
        """
        towards = (float(columns), float(rows)) if direction is None else tuple(direction)
        grips = presentation_of(self.world.scene).grips
        if grips and not self.world.body.inverse_mass.any():
            self.say("no active body to select")
            return
        if grips and self.picker.selected is not None:
            body_set = self.world.scene.body_set
            body_particles = np.flatnonzero(body_set.body == body_set.body[self.picker.selected])
            self._report_selection(
                self.picker.move_to(neighbour(self.position, body_particles, self.picker.selected, towards), towards)
            )
            return
        self._report_selection(self.picker.move(columns, rows, self.world, towards))

    def take(self, particle: int, target: Sequence[float]) -> bool:
        """Select a mass and pull it toward `target` [m] until `release`."""
        if self._blocked():
            return False
        self.disturb(PULLED)
        self.picker.selected = particle
        self.picker.poke = Poke(particle, tuple(target))
        self._report_selection(particle)
        return self._guard(self._push)

    def drag(self, *target: float) -> None:
        """Move the target of the poke to `target` [m]."""
        poke = self.picker.poke
        if poke is not None and poke.target is not None:
            self.picker.poke = Poke(poke.particle, target)

    def press_key(self) -> None:
        """Poke the selected mass downward, or along the last arrow key (Enter down)."""
        if self._blocked():
            return
        if self.picker.selected is None:
            self.move_selection(0, 0)
            self.picker.direction = self.picker.down
        if self.picker.selected is not None and self.picker.poke is None:
            self.disturb(PULLED)
            self.picker.poke = Poke(self.picker.selected, None, self.picker.direction)
            self._guard(self._push)

    def release(self) -> None:
        """End the poke (mouse or Enter up)."""
        if self.picker.poke is not None:
            self.picker.poke = None
            self._guard(self._push)
