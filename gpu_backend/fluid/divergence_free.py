"""Launches of the passes of a fluid's substep on CUDA, by the scheme `divergence-free` (model/fluid/divergence_plan.py).

`sorted`: positions, whose fourth number becomes the change of a multiplier; `before`: positions with the fluid;
`predicted_velocity`: velocities up to the forces; `corrected`: velocities after them; the current buffers: scratch of
the smoothing of velocities, then the new state.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from softlab.gpu_backend.fluid.cells import Particles
from softlab.gpu_backend.fluid.divergence import make_solve, make_targets
from softlab.gpu_backend.fluid.divergence_motion import make_free_motion
from softlab.gpu_backend.fluid.passes import Launched, Passes
from softlab.model.core.plan import Moment
from softlab.model.fluid.divergence_plan import SECOND
from softlab.model.fluid.passes import ACCELERATE, FORESEE, GATHER, MOVE, PUSH_APART, RELAX, SHAPE, SURVEY, TAKE_UP

SCALARS = 3  # numbers of a particle for this scheme only: iterates, multipliers of the second solve, targets
QUADS = 1  # shifts


class DivergenceFreePasses(Passes):
    """The passes of the scheme."""

    def __init__(self, sim: Any):
        super().__init__(sim)
        zeros = np.zeros(sim.particle_count, sim.real)
        self.iterates, self.seconds, self.targets = (sim.on_device(zeros) for _ in range(SCALARS))
        self.shifts = sim.new_array()
        self.aims, self.solving = make_targets(*self._variant), make_solve(*self._variant)
        self.motion = make_free_motion(*self._variant)

    def launched(self) -> Mapping[tuple[str, ...], Launched]:
        return {
            **super().launched(),
            (GATHER,): Launched(self.gather, 1 + bool(self.sim.repeats)),
            (SURVEY,): Launched(self.survey),
            (RELAX,): Launched(self.relax),
            (PUSH_APART,): Launched(self.push),
            (TAKE_UP,): Launched(self.take_up),
            (SHAPE,): Launched(self.shape),
            (ACCELERATE,): Launched(self.accelerate, 1 + self._smooths),
            (FORESEE,): Launched(self.foresee),
            (MOVE,): Launched(self.move),
        }

    def unsorted(self) -> Particles:
        sim, (position, velocity, particle) = self.sim, self.state
        if sim.repeats:
            position = sim.position[1 - sim._current]
        return Particles(position, position, velocity, particle)

    def gather(self, at: Moment) -> None:
        """Copy the state into its periodic box, and compute the bounding box."""
        sim, position = self.sim, self.unsorted().position
        if sim.repeats:
            self.motion.gather[sim._flat](self.state[0], sim.record, position)
        sim.cells.bound(position)

    def survey(self, at: Moment) -> None:
        """Compute the constraints, and the targets of the first solve."""
        sim = self.sim
        self.aims.survey[sim._flat](
            sim.sorted, sim.predicted_velocity, sim.record, *sim.lists, sim.constraints, sim.gradients, self.targets,
            *self.world(at),
        )  # fmt: skip

    def relax(self, at: Moment) -> None:
        """Compute the changes of multipliers."""
        sim, multipliers = self.sim, self.seconds if at.argument == SECOND else self.sim.multipliers
        self.solving.relax[sim._flat](
            sim.sorted, self.shifts, sim.record, *sim.lists, sim.gradients, self.targets, sim.factors, multipliers,
            self.iterates, np.int32(at.iteration), np.int32(sim.scene.method.iterations),
        )  # fmt: skip

    def push(self, at: Moment) -> None:
        """Compute the shifts."""
        sim = self.sim
        self.solving.push[sim._flat](
            sim.sorted, self.shifts, sim.record, *sim.lists, sim.gradients, sim.before, sim.fluids, np.int32(at.iteration)
        )  # fmt: skip

    def take_up(self, at: Moment) -> None:
        """Update the velocities after the first solve."""
        sim = self.sim
        self.motion.take_up[sim._flat](sim.before, sim.predicted_velocity, self.shifts, sim.record, sim.fluids)

    def shape(self, at: Moment) -> None:
        """Compute normals and vorticities."""
        sim = self.sim
        self.smoothing.shape[sim._flat](sim.before, sim.predicted_velocity, sim.record, *sim.lists, *self.state[:2])

    def accelerate(self, at: Moment) -> None:
        """Apply neighbours, drag and forces to the velocities."""
        sim, velocity, (*scratch, particle) = self.sim, self.sim.predicted_velocity, self.state
        if self._smooths:
            self.smoothing.smooth[sim._flat](
                sim.before, velocity, sim.record, *sim.lists, sim.constraints, sim.fluids, *scratch, sim.corrected
            )
            velocity = sim.corrected
        self.motion.accelerate[sim._flat](
            sim.before, velocity, particle, sim.constraints, sim.record, sim.fluids, sim.integers, *self.time(at),
            sim.corrected, sim.cells.counts,
        )  # fmt: skip

    def foresee(self, at: Moment) -> None:
        """Compute the targets of the second solve."""
        sim = self.sim
        self.aims.foresee[sim._flat](
            sim.sorted, sim.corrected, sim.record, *sim.lists, sim.constraints, sim.gradients, self.targets
        )

    def move(self, at: Moment) -> None:
        """Write the new state."""
        sim = self.sim
        self.motion.move[sim._flat](
            sim.before, sim.corrected, self.shifts, sim.multipliers, self.seconds, sim.record, sim.fluids,
            *self.world(at), *self.state[:2],
        )  # fmt: skip
