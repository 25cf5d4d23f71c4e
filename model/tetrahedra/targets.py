"""Targets of pinned vertices, set step by step by the caller that advances the simulation: an animated skin, a
function.

Each pinned vertex without a motion of the scene has its own, from its position to its target within the next step, in
the rows that kernels read for motions (model/contact/cloth_parameters.py); in later steps it rests there.
"""

from __future__ import annotations

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.base.types import Real
from softlab.model.contact.cloth_parameters import (
    M_DURATION,
    M_START,
    M_V,
    M_VX,
    M_VZ,
    MOTION_FIELDS,
    P_MOTION,
    PIN_FIELDS,
    body_rows,
    collider_numbers,
    motion_rows,
    pin_rows,
)
from softlab.model.core.build import Body
from softlab.model.core.simulation import Simulation
from softlab.model.core.state import State
from softlab.model.scene.scene import Scene

LIVE = "targets"


class Targets:
    """Rows of targets.

    `rows`: colliders, motions of the scene, those of pins, pins, flat; the last begin at `first`. `settable` (pins,) bool:
    pins with targets; `resting`, `wanted` (pins, 3) float64 [m]: previous positions, and those at the end of `step`.
    """

    def __init__(self, scene: Scene, body: Body, real: Real):
        colliders, motions = collider_numbers(scene, real), motion_rows(scene, real)
        pins = pin_rows(scene, body, real, colliders.size)
        self.settable, count = pins[:, P_MOTION] < 0, len(pins)
        begin = colliders.size + motions.size
        self.first = begin + MOTION_FIELDS * count
        most = 2 ** (np.finfo(real).nmant + 1)  # integers are exact up to there
        if self.first > most:
            reason = f"{np.dtype(real).name} counts to {most}, and a pin takes {MOTION_FIELDS} numbers: use float64"
            raise SceneError("live", f"{count} pins with targets", reason)
        moving: np.ndarray = np.zeros((count, MOTION_FIELDS), real)
        moving[:, M_V], moving[:, M_DURATION] = 1, 1  # an axis and a time, which have no effect without a speed
        pins[self.settable, P_MOTION] = (begin + MOTION_FIELDS * np.arange(count))[self.settable]
        self.rows = np.concatenate([colliders, motions.reshape(-1), moving.reshape(-1), pins.reshape(-1)])
        self._moving = self.rows[begin : self.first].reshape(count, MOTION_FIELDS)
        self._pins = self.rows[self.first :].reshape(count, PIN_FIELDS)
        self.rest_at(body.position[body.pinned])

    def rest_at(self, position: np.ndarray) -> None:
        """Put all targets at rest at `position` (pins, 3) [m]."""
        self.resting, self.wanted, self.step = position, position, -1
        self._pins[self.settable, :P_MOTION] = position[self.settable]
        self.rest()

    def rest(self) -> None:
        """Set all speeds to 0."""
        self._moving[:, M_VX : M_VZ + 1] = 0

    def send(self, position: np.ndarray, step: int, time: float, dt: float) -> None:
        """Move all to `position` (pins, 3) [m] within step number `step`, which begins at `time` [s]."""
        self.wanted, self.step = position, step
        self._pins[self.settable, :P_MOTION] = self.resting[self.settable]
        self._moving[:, M_VX : M_VZ + 1] = (position - self.resting) / dt
        self._moving[:, M_START], self._moving[:, M_DURATION] = time, 2 * dt  # it still moves at the step's end


class Targeted(Simulation):
    """A simulation with targets of pinned vertices (`live` names targets).

    A backend passes the rows of `_driven_rows` to its kernels, and sends changed rows to them.
    """

    _goals: Targets | None = None
    body: Body

    def _driven_rows(self) -> tuple[np.ndarray, int]:
        """Return (the kernels' rows of colliders, motions and pins; index of its pins, 0 where none moves)."""
        if LIVE in self.options.live and self.scene.tetrahedra and len(self.body.pinned):
            self._goals = Targets(self.scene, self.body, self.real)
            return self._goals.rows.copy(), self._goals.first
        return body_rows(self.scene, self.body, self.real)

    def _send_rows(self, rows: np.ndarray) -> None:
        """Replace the rows by others."""
        raise NotImplementedError

    def targets(self, position: np.ndarray) -> None:
        """Set the positions of pinned vertices at the end of the next step.

        `position` (particles, 3) [m]: of all particles; only pinned ones without a motion of the scene count. They move
        there at a constant velocity, and then rest. Raises SceneError: another shape, a position that is not finite, no
        pinned vertex, or targets that are not live.
        """
        place = np.asarray(position, np.float64)
        if self._goals is None:
            reason = (
                "no vertex is pinned"
                if LIVE in self.options.live
                else "not live; open the simulation with live=targets"
            )
            raise SceneError("targets", None, reason)
        if place.shape != self.body.position.shape:
            reason = f"must be {self.body.position.shape}: a place for every particle"
            raise SceneError("targets", place.shape, reason)
        wanted = place[self.body.pinned]
        bad = np.flatnonzero(~np.isfinite(wanted).all(axis=1) & self._goals.settable)
        if len(bad):
            vertex = int(self.body.pinned[bad[0]])
            raise SceneError("targets", place[vertex].tolist(), f"of vertex {vertex}, which is pinned: must be finite")
        self._settle()
        self.check()  # so that a replay never spans a change
        wanted = np.where(self._goals.settable[:, None], wanted, self._goals.resting)
        self._goals.send(wanted, self.step, self.time, self.scene.method.dt)
        self._send_rows(self._goals.rows)

    def advance(self, steps: int) -> None:
        """Advance; the first step moves pinned vertices to their targets, where they rest in the others."""
        self._settle()
        if self._goals is not None and self._goals.step == self.step and steps > 1:
            super().advance(1)
            self._settle()
            steps -= 1
        super().advance(steps)

    def _settle(self) -> None:
        """Put vertices at rest after the step with their targets."""
        if self._goals is not None and -1 < self._goals.step != self.step:
            self.check()
            self._goals.rest_at(self._goals.wanted)
            self._send_rows(self._goals.rows)

    def load(self, state: State) -> None:
        """Load a state, in which pinned vertices rest."""
        if self._goals is not None:
            self._goals.rest()
            self._send_rows(self._goals.rows)
        super().load(state)
        if self._goals is not None:
            self._goals.rest_at(np.asarray(state.position, np.float64)[self.body.pinned])
            self._send_rows(self._goals.rows)
