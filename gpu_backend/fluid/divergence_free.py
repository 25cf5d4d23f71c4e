"""The launches of a substep of the scheme `divergence-free` of a fluid on CUDA (model/fluid/divergence_plan.py)."""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.gpu_backend.core.device import Arguments, DeviceArray
from softlab.gpu_backend.fluid.cells import Particles
from softlab.gpu_backend.fluid.divergence import make_solve, make_targets
from softlab.gpu_backend.fluid.divergence_motion import make_free_motion
from softlab.gpu_backend.fluid.smoothing import make_smoothing
from softlab.model.core.plan import Moment, StageRun
from softlab.model.fluid.divergence_plan import SECOND
from softlab.model.fluid.passes import SHAPES, SMOOTHING

SCALARS = 3  # numbers of a particle for this scheme only: iterates, multipliers of the second solve, targets
QUADS = 1  # shifts


class DivergenceFree:
    """The scheme of `sim`, a gpu_backend.fluid.solver.Fluid, whose arrays it shares.

    `sorted`: positions, whose fourth number becomes the change of a multiplier; `before`: positions with the fluid;
    `meant`: velocities up to the forces; `corrected`: velocities after them.
    """

    def __init__(self, sim: Any):
        self.sim, count, parts = sim, sim.particle_count, sim.plan.parts
        variant = sim.real, sim.options.math, parts, sim.repeats
        self.iterates, self.seconds, self.targets = (sim.on_device(np.zeros(count, sim.real)) for _ in range(SCALARS))
        self.shifts = sim.new_array()
        self.find = sim.relaxing.find, sim.relaxing.factors
        self.aims, self.solving, self.motion = make_targets(*variant), make_solve(*variant), make_free_motion(*variant)
        self.smoothing = make_smoothing(*variant, False) if parts & SMOOTHING else None

    @property
    def launches(self) -> int:
        """Number of launches of a substep, besides those of a sort and a search."""
        parts = self.sim.plan.parts
        return 7 + 4 * self.sim.scene.method.iterations + bool(parts & SMOOTHING) + bool(parts & SHAPES)

    def gather(self, current: int) -> Particles:
        """Copy the state `current` into its periodic box, unsorted (see Cells.sort)."""
        sim, position = self.sim, self.sim.position[current]
        if sim.repeats:
            position = sim.position[1 - current]
            self.motion.gather[sim._flat](sim.position[current], sim.record, position)
        sim.cells.bound(position)
        return Particles(position, position, sim.velocity[current], sim.particle[current])

    def sort(self, particles: Particles, particle: DeviceArray) -> None:
        """Sort into `sorted`, `before`, `meant` and `particle`."""
        sim = self.sim
        sim.cells.sort(sim.record, particles, Particles(sim.sorted, sim.before, sim.predicted_velocity, particle))

    def search(self, world: Arguments) -> None:
        """Build neighbour lists and factors. `world`: bodies, integers, counter, place, substeps, substep."""
        sim, (find, factors) = self.sim, self.find
        find[sim._flat](sim.sorted, sim.record, *sim.near, sim.cells.counts)
        factors[sim._flat](sim.sorted, sim.record, *sim.lists, *sim.relaxed, sim.fluids, *world)

    def survey(self, world: Arguments) -> None:
        """Compute the constraints, and the targets of the first solve."""
        sim = self.sim
        self.aims.survey[sim._flat](
            sim.sorted,
            sim.predicted_velocity,
            sim.record,
            *sim.lists,
            sim.constraints,
            sim.gradients,
            self.targets,
            *world,
        )

    def relax(self, turn: int, second: bool) -> None:
        """Compute the changes of multipliers."""
        sim, iterations = self.sim, self.sim.scene.method.iterations
        aheads = self.seconds if second else sim.multipliers
        self.solving.relax[sim._flat](
            sim.sorted, self.shifts, sim.record, *sim.lists, sim.gradients, self.targets, sim.factors, aheads,
            self.iterates, np.int32(turn), np.int32(iterations),
        )  # fmt: skip

    def push(self, turn: int) -> None:
        """Compute the shifts."""
        sim = self.sim
        self.solving.push[sim._flat](
            sim.sorted, self.shifts, sim.record, *sim.lists, sim.gradients, sim.before, sim.fluids, np.int32(turn)
        )

    def take_up(self) -> None:
        """Update the velocities after the first solve."""
        sim = self.sim
        self.motion.take_up[sim._flat](sim.before, sim.predicted_velocity, self.shifts, sim.record, sim.fluids)

    def shape(self, scratch: tuple[Any, Any]) -> None:
        """Compute normals and vorticities, into `scratch`."""
        sim = self.sim
        assert self.smoothing is not None
        self.smoothing.shape[sim._flat](sim.before, sim.predicted_velocity, sim.record, *sim.lists, *scratch)

    def accelerate(self, scratch: tuple[Any, Any], particle: DeviceArray, time: Arguments) -> None:
        """Apply neighbours, drag and forces to the velocities, into `corrected`. `time`: counter, place, substeps,
        substep."""
        sim, velocity = self.sim, self.sim.predicted_velocity
        if self.smoothing is not None:
            self.smoothing.smooth[sim._flat](
                sim.before, velocity, sim.record, *sim.lists, sim.constraints, sim.fluids, *scratch, sim.corrected
            )
            velocity = sim.corrected
        self.motion.accelerate[sim._flat](
            sim.before,
            velocity,
            particle,
            sim.constraints,
            sim.record,
            sim.fluids,
            sim.integers,
            *time,
            sim.corrected,
            sim.cells.counts,
        )

    def foresee(self) -> None:
        """Compute the targets of the second solve."""
        sim = self.sim
        self.aims.foresee[sim._flat](
            sim.sorted, sim.corrected, sim.record, *sim.lists, sim.constraints, sim.gradients, self.targets
        )

    def move(self, position: DeviceArray, velocity: DeviceArray, world: Arguments) -> None:
        """Write the new state."""
        sim = self.sim
        self.motion.move[sim._flat](
            sim.before, sim.corrected, self.shifts, sim.multipliers, self.seconds, sim.record, sim.fluids, *world,
            position, velocity,
        )  # fmt: skip

    def substep(self, now: int, time: Arguments) -> None:
        """Launch a substep, from the buffers 1 - `now` into the buffers `now`."""
        sim, particle = self.sim, self.sim.particle[now]
        position, velocity = sim.position[now], sim.velocity[now]
        world = sim.bodies, sim.integers, *time
        self.sort(self.gather(1 - now), particle)
        self.search(world)
        self.survey(world)
        self._solve(False)
        self.take_up()
        if sim.plan.parts & SHAPES:
            self.shape((position, velocity))
        self.accelerate((position, velocity), particle, time)
        self.foresee()
        self._solve(True)
        self.move(position, velocity, world)

    def _solve(self, second: bool) -> None:
        for turn in range(self.sim.scene.method.iterations):
            self.relax(turn, second)
            self.push(turn)

    def stages(self) -> dict[str, StageRun]:
        """Return the function that runs each stage of the plan; the state stays in its buffer."""
        sim, start = self.sim, self.sim.on_device(np.zeros(1, np.int64))
        scratch, gathered = (sim.position[1], sim.velocity[1]), dict[str, Particles]()

        def time(moment: Moment) -> Arguments:
            return start, np.int64(moment.step), np.int64(moment.substeps), np.int64(moment.substep)

        def world(moment: Moment) -> Arguments:
            return sim.bodies, sim.integers, *time(moment)

        def gather(moment: Moment) -> None:
            gathered["now"] = self.gather(0)

        def sort(moment: Moment) -> None:
            self.sort(gathered["now"], sim.particle[1])
            sim.particle[0].copy_to_device(sim.particle[1], stream=sim.stream)

        return {
            "gather": gather,
            "sort into cells": sort,
            "find neighbours": lambda moment: self.search(world(moment)),
            "density and divergence": lambda moment: self.survey(world(moment)),
            "relax": lambda moment: self.relax(moment.iteration, moment.argument == SECOND),
            "push apart": lambda moment: self.push(moment.iteration),
            "take up": lambda moment: self.take_up(),
            "normals and vorticity": lambda moment: self.shape(scratch),
            "accelerate": lambda moment: self.accelerate(scratch, sim.particle[0], time(moment)),
            "foresee density": lambda moment: self.foresee(),
            "move": lambda moment: self.move(sim.position[0], sim.velocity[0], world(moment)),
        }
