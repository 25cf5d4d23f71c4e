"""A fluid that is stepped in windows, one around each slab: the simulation that consists of the windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from operator import methodcaller

import numpy as np

from softlab.model.base.types import Real
from softlab.model.core.families import scene_plan
from softlab.model.core.options import Options, unknown_kernel
from softlab.model.core.simulation import Simulation
from softlab.model.domains.slabs import Slabs, fluid_halo_of, slabs_of
from softlab.model.domains.windows import WindowedSimulation
from softlab.model.fluid.passes import LIMIT, PREDICT
from softlab.model.fluid.simulation import FluidSimulation
from softlab.model.scene.scene import Scene

BALANCED_EVERY = 64  # steps
NOTHING = np.zeros(0, np.uint8)


class SharedFluid(FluidSimulation, WindowedSimulation):
    """A simulation in windows of slabs, see model/domains/windows.py.

    `windows` are those of the slabs `local`; `slabs`: the current ones. In `exact` math the bits are those of a single
    simulation.

    A window is a fluid of the scene, run by stages, in which some of the particles are active. It also has
    `run_stage(name, moment)`; `box()`, (6,) float64, the lowest and the highest predicted position of its particles,
    and `take_box(box)`; `particles()`, the numbers (n,) int32 and the positions and velocities (2 x dimensions, n) of
    the active ones; `hold(numbers, values)`, which replaces them; `multipliers_at(places)`, of the last substep, by
    indices into `particles()`.
    """

    def __init__(self, scene: Scene, options: Options, slabs: Slabs, local: Sequence[int]):
        if options.kernel not in (None, "stages"):
            raise unknown_kernel(options.kernel, ("stages",), "for fluids that are shared")
        super().__init__(scene, options)
        self.slabs, self._snapshot_slabs, self.local = slabs, slabs, list(local)
        self.plan, self.firsts = scene_plan(scene, options.live), [0] * len(local)
        particles = len(self.body.position)
        self._owned = [np.zeros(particles, bool) for _ in local]  # by particle number
        self._last: list[tuple[np.ndarray, np.ndarray]] = [(np.zeros(0, np.int64),) * 2 for _ in local]
        part = scene, replace(options, kernel="stages"), self.body
        self._open_windows(slabs.count, [part for _ in local])

    # ------------------------------------------------------------------ messages

    def _join_boxes(self) -> None:
        """Let every window make its cells from the bounding box of all particles, so that they are those of a single
        simulation."""
        boxes = np.array(self._each(lambda window: window.box()))
        boxes[:, :3] *= -1
        box = self.exchange.largest_each(boxes.max(axis=0))
        box[:3] *= -1
        self._each(lambda window: window.take_box(box))

    def _send(self, slabs: Slabs, last: bool = False) -> None:
        """Send the owned particles to all windows that contain them with these slabs; `last`: directly after a
        substep."""
        messages, staying = [], []
        for place, (number, values) in enumerate(self._each(lambda window: window.particles())):
            owned, along, sent = self._owned[place][number], values[slabs.axis], []
            if last:
                self._last[place] = np.flatnonzero(owned), number[owned]
            for slab in range(slabs.count):
                some = np.flatnonzero(owned & slabs.contained(along, slab))
                contents = number[some], values.take(some, axis=1)
                stays = slab == self.local[place]
                if stays:
                    staying.append(contents)
                sent.append(NOTHING if stays else _packed(*contents))
            messages.append(sent)
        self.slabs = slabs
        for place, came in enumerate(self.exchange.swap(messages)):
            parts = [staying[place], *(_unpacked(message, self.real, self.scene.dimensions) for message in came)]
            numbers, values = zip(*parts, strict=True)
            self._set_particles(place, np.concatenate(numbers), np.concatenate(values, axis=1))

    def _set_particles(self, place: int, number: np.ndarray, values: np.ndarray) -> None:
        with self._at(place):
            self.windows[place].set_particles(number, values)
        self._claim(place, number, values)

    def _claim(self, place: int, number: np.ndarray, values: np.ndarray) -> None:
        """Mark the particles of a window that lie in its slab as owned by it."""
        owned = self._owned[place]
        owned[:] = False
        owned[number[self.slabs.owned(values[self.slabs.axis], self.local[place])]] = True

    def _gather(self, rows: Sequence[np.ndarray]) -> np.ndarray:
        """Return the rows of all particles, by number, from each window's rows, (particles, n).

        The first column of a row is the particle's number.
        """
        whole = self.exchange.gather(np.ascontiguousarray(np.concatenate(rows)))
        values = np.empty((len(self.body.position), whole.shape[1] - 1))
        values[whole[:, 0].astype(np.int64)] = whole[:, 1:]
        return values

    def _states(self) -> np.ndarray:
        """Return the states, (particles, 2 x dimensions) float64, which represents every state and particle number
        exactly."""
        rows = []
        for owned, (number, values) in zip(self._owned, self._each(lambda window: window.particles()), strict=True):
            some = owned[number]
            rows.append(np.vstack([number[some], values[:, some]]).T.astype(np.float64))
        return self._gather(rows)

    # ------------------------------------------------------------------ methods of Simulation

    def _run(self, steps: int) -> None:
        for step in range(self.step, self.step + steps):
            for stage, moment in self.plan.moments(step):
                self._each(methodcaller("run_stage", stage.name, moment))
                if stage.name == PREDICT:
                    self._join_boxes()
                elif stage.name == LIMIT:  # the last one
                    self._send(self.slabs, last=True)
            if (step + 1) % BALANCED_EVERY == 0:
                self.balance()

    def balance(self) -> None:
        """Set slabs with equal numbers of particles at their current positions."""
        slabs = slabs_of(self.scene, self._states()[:, : self.scene.dimensions], self.slabs.count, self.slabs.halo)
        self._send(slabs)

    def _parameters_changed(self) -> None:
        def send(window: Simulation) -> None:
            window.scene = self.scene
            self._hand_on(window, self._poke_particle)

        self._each(send)
        halo = fluid_halo_of(self.scene)
        if halo != self.slabs.halo:  # the step size has changed
            self._send(replace(self.slabs, halo=halo))

    def _store_snapshot(self) -> None:
        super()._store_snapshot()
        self._snapshot_slabs = self.slabs

    def _restore(self) -> None:
        super()._restore()
        self.slabs = self._snapshot_slabs
        for place, (number, values) in enumerate(self._each(lambda window: window.particles())):
            self._claim(place, number, values)
        self._send(replace(self.slabs, halo=fluid_halo_of(self.scene)))  # the halo may have changed since

    def _download(self) -> tuple[np.ndarray, np.ndarray]:
        states, axes = self._states().astype(self.real), self.scene.dimensions
        return np.ascontiguousarray(states[:, :axes]), np.ascontiguousarray(states[:, axes:])

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self.slabs = slabs_of(self.scene, position, self.slabs.count, fluid_halo_of(self.scene))
        values = np.ascontiguousarray(np.hstack([position, velocity]).T)
        for place, slab in enumerate(self.local):
            number = np.flatnonzero(self.slabs.contained(values[self.slabs.axis], slab)).astype(np.int32)
            self._set_particles(place, number, values[:, number])

    def _multipliers(self) -> np.ndarray:
        rows = []
        for place, (places, number) in enumerate(self._last):
            with self._at(place):
                multipliers = self.windows[place].multipliers_at(places)
            rows.append(np.stack([number, multipliers], axis=1).astype(np.float64))
        if not len(self.exchange.gather(np.concatenate(rows))):  # before the first substep
            return np.zeros(len(self.body.position), self.real)
        return self._gather(rows)[:, 0].astype(self.real)

    # ------------------------------------------------------------------ reports

    def particle_counts(self) -> np.ndarray:
        """Return the number of particles that each slab owns and contains now, (slabs, 2)."""
        counts = [
            (owned.sum(), len(number))
            for owned, (number, _) in zip(self._owned, self._each(lambda window: window.particles()), strict=True)
        ]
        return self.exchange.gather(np.array(counts, np.float64)).astype(np.int64)


def _packed(number: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return particles as bytes."""
    return np.concatenate([np.ascontiguousarray(one).reshape(-1).view(np.uint8) for one in (number, values)])


def _unpacked(message: np.ndarray, real: Real, axes: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (numbers (n,), values (2 x axes, n)) from bytes."""
    end = np.dtype(np.int32).itemsize * (len(message) // bytes_each(np.dtype(real).itemsize, axes))
    return message[:end].view(np.int32), message[end:].view(real).reshape(2 * axes, -1)


def bytes_each(item: int, axes: int) -> int:
    """Return the bytes of a particle in a message; `item`: of a scalar."""
    return np.dtype(np.int32).itemsize + 2 * axes * item
