"""A fluid coupled to solids on CUDA, by launches or stage by stage (model/fluid/plan.py, Solids).

The solids belong to another simulation, which reads and writes their particles through `SolidPlaces`.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.device import Arguments, DeviceArray, Stream
from softlab.gpu_backend.fluid.cells import Particles
from softlab.gpu_backend.fluid.solids import make_sampling, make_solid_kernels
from softlab.gpu_backend.fluid.solver import Fluid
from softlab.gpu_backend.fluid.stages import bind_fluid_stages
from softlab.model.core.plan import Executor, Moment, StageRun
from softlab.model.core.simulation import Options
from softlab.model.fluid.among_solids import kinds_of
from softlab.model.fluid.passes import SHAPES, SMOOTHING
from softlab.model.fluid.samples import Samples
from softlab.model.scene.scene import Scene

COUNTED = 128  # threads per block, over samples and over particles of solids


class SolidPlaces(Protocol):
    """Positions of the solids' particles: `before` the substep, and `position` now, flat device arrays of quads."""

    before: DeviceArray
    position: DeviceArray

    @property
    def launches(self) -> int:
        """Number of launches of `give`."""

    def take(self, fresh: bool) -> None:
        """Bring `position` up to date, and `before` too if `fresh`."""

    def give(self) -> None:
        """Write `position` back to the solids."""


class FluidAmongSolids(Fluid):
    """Fluids and `samples` of solids, whose particles are at `places`; part of a world, which steps it. The rest is the
    contract of Fluid."""

    _whole: DeviceArray | None = None  # positions of all particles, for reading

    def __init__(
        self, scene: Scene, options: Options, samples: Samples, places: SolidPlaces, stream: Stream | None = None
    ):
        self.samples, self.places = samples, places
        super().__init__(scene, options, stream)

    def _allocate(self) -> None:
        super()._allocate()
        real, samples, new = self.real, self.samples, self.on_device
        assert samples is not None
        offsets, carried, weights = samples.carriers
        self._kinds = new(kinds_of(self.scene, samples).astype(real))
        self._slots, self._shift = new(np.zeros(samples.count, np.int32)), new(np.zeros(3 * samples.count, real))
        self._points = new(samples.corners), new(samples.weights.astype(real))
        self._carriers = new(samples.lightness.astype(real)), new(offsets), new(carried), new(weights.astype(real))
        self._unsmoothed = self.new_array()  # velocities before smoothing
        self._over_samples = self._over(samples.count, COUNTED)
        self._over_solids = self._over(len(samples.lightness), COUNTED)

    @property
    def _fluid_count(self) -> int:
        """Number of the fluid's particles."""
        return len(self.body.position)

    @property
    def _fluid_of(self) -> np.ndarray:
        sampled = np.full(self.particle_count - self._fluid_count, len(self.scene.fluid_set.parts), np.int32)
        return np.append(self.scene.fluid_set.fluid, sampled)

    def _build(self) -> None:
        """Make the kernels. They are compiled when they first run, in the world's first step."""
        self._make_kernels()
        variant = self.real, self.options.math
        self.sampling, self.solving = make_sampling(*variant), make_solid_kernels(*variant, self.plan.parts)
        if self.kernel == "stages":
            self._executor = Executor(self.plan, bind_solid_stages(self))
        else:
            self._executor = Executor(self.plan, {}, self._advance_steps)

    # ------------------------------------------------------------------ coupling to solids

    def known(self, particle: DeviceArray) -> Arguments:
        """Return the arguments of kernels that need particles' numbers `particle`."""
        return self.record, *self.lists, particle, np.int32(self._fluid_count), self._kinds

    def sample(self, particles: Particles) -> None:
        """Write the predicted positions of samples."""
        self.places.take(fresh=True)
        points = *self._points, self.places.before, self.places.position
        self.sampling.sample[self._flat](
            particles.number,
            np.int32(self._fluid_count),
            *points,
            particles.position,
            particles.before,
            particles.velocity,
        )
        self.cells.bound(particles.position)

    def find_solids(self, position: DeviceArray, particle: DeviceArray, world: Arguments) -> None:
        """Store the slots of samples, and compute the factors of particles among them."""
        self.sampling.gather[self._flat](particle, np.int32(self._fluid_count), self._slots)
        self.solving.factors[self._flat](position, *self.known(particle), *self.relaxed, self.fluids, *world)

    def follow_solids(self, position: DeviceArray) -> None:
        """Write the current positions of samples."""
        self.places.take(fresh=False)
        self.sampling.follow[self._over_samples](self._slots, *self._points, self.places.position, position)

    def constrain(self, position: DeviceArray, particle: DeviceArray, world: Arguments) -> None:
        """Compute the changes of multipliers."""
        self.solving.density[self._flat](position, *self.known(particle), *self.relaxed, *world)

    def correct(self, position: DeviceArray, particle: DeviceArray, world: Arguments, into: Any) -> None:
        """Correct the positions `position` and store them in `into`; store the shifts of samples."""
        arguments = self.before, position, *self.known(particle), self.gradients, self.fluids, *world
        self.solving.correct[self._flat](*arguments, self._shift, into)

    def push(self) -> None:
        """Move the solids' particles by the shifts of their samples."""
        self.sampling.push[self._over_solids](*self._carriers, self._shift, self.places.position)
        self.places.give()

    # ------------------------------------------------------------------ a substep by launches

    def _substep(self, place: int, substep: int) -> None:
        self.begin_substep(place, substep)
        for iteration in range(self.scene.method.iterations):
            self.iterate(iteration)
        self.end_substep(place, substep)

    def begin_substep(self, place: int, substep: int) -> None:
        """Launch the stages before the iterations (SubstepSimulation)."""
        time = self._counter, np.int64(place), np.int64(self.scene.method.substeps), np.int64(substep)
        predicted = self.predict(self._current, time)
        self._current = now = 1 - self._current
        self.sample(predicted)
        self.cells.sort(
            self.record, predicted, Particles(self.sorted, self.before, self.predicted_velocity, self.particle[now])
        )
        self._moment, self._here, self._there = (self.bodies, self.integers, *time), self.sorted, self.corrected
        self.relaxing.find[self._flat](self._here, self.record, *self.near, self.cells.counts)
        self.find_solids(self._here, self.particle[now], self._moment)

    def iterate(self, iteration: int) -> None:
        """Launch an iteration (SubstepSimulation)."""
        particle = self.particle[self._current]
        self.follow_solids(self._here)
        self.constrain(self._here, particle, self._moment)
        self.correct(self._here, particle, self._moment, self._there)
        self.push()
        self._here, self._there = self._there, self._here

    def end_substep(self, place: int, substep: int) -> None:
        """Launch the stages after the iterations (SubstepSimulation)."""
        position, velocity = self.position[self._current], self.velocity[self._current]
        arguments = (
            self.before,
            self.predicted_velocity,
            self._here,
            self.record,
            self.multipliers,
            self.fluids,
            *self._moment,
        )
        if not self.smoothing:
            self.settling.update[self._flat](*arguments, position, velocity)
            self.settling.limit[self._flat](position, velocity, self.constraints, self.record, self.fluids)
            return
        self.settling.update[self._flat](*arguments, position, self._unsmoothed)
        self.smooth(position, self._unsmoothed, velocity)

    @property
    def _launches(self) -> int:
        """Number of launches of a step."""
        method, ends = self.scene.method, bool(self.plan.parts & SMOOTHING) + bool(self.plan.parts & SHAPES)
        coupling_launches = 2 + self.places.launches * (
            method.iterations * 2 + 2
        )  # reading solids, and writing them back
        return method.substeps * (6 + self.cells.launches + 4 * method.iterations + coupling_launches + ends)

    # ------------------------------------------------------------------ the contract, of the fluid's own particles

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        more = np.zeros((self.particle_count - self._fluid_count, position.shape[1]), self.real)
        super()._upload(np.concatenate([position, more]), np.concatenate([velocity, more]))

    def _to_host(self, array: DeviceArray) -> np.ndarray:
        return super()._to_host(array)[: self._fluid_count]

    def _multipliers(self) -> np.ndarray:
        return super()._multipliers()[: self._fluid_count]

    def _first_diverged(self) -> int:
        bad = super()._first_diverged()
        return bad if bad < self._fluid_count else -1

    def _read_position(self, into: Any) -> Any:
        if into is not None and hasattr(into, "__cuda_array_interface__"):
            if self._whole is None:
                self._whole = cuda.device_array((self.particle_count, 3), np.float32, stream=self.stream)
            state = self.position[self._current], self.particle[self._current]
            self._tools.write_position[self._flat](*state, self._whole)
            cuda.as_cuda_array(into).copy_to_device(self._whole[: self._fluid_count], stream=self.stream)
            self.synchronize()
            return into
        return super()._read_position(into)


def bind_solid_stages(sim: FluidAmongSolids) -> dict[str, StageRun]:
    """Return the function that runs each stage of the plan of `sim`."""
    bound = bind_fluid_stages(sim)
    now, start, particle = bound.now, sim.on_device(np.zeros(1, np.int64)), sim.particle[1]

    def world(moment: Moment) -> Arguments:
        time = start, np.int64(moment.step), np.int64(moment.substeps), np.int64(moment.substep)
        return sim.bodies, sim.integers, *time

    def find(moment: Moment) -> None:
        bound.stages["find neighbours"](moment)
        sim.find_solids(now["position"], particle, world(moment))

    def correct(moment: Moment) -> None:
        sim.correct(now["position"], particle, world(moment), now["other"])
        now["position"], now["other"] = now["other"], now["position"]

    return bound.stages | {
        "sample solids": lambda moment: sim.sample(now["given"]),
        "find neighbours": find,
        "follow solids": lambda moment: sim.follow_solids(now["position"]),
        "density": lambda moment: sim.constrain(now["position"], particle, world(moment)),
        "correct": correct,
        "push solids": lambda moment: sim.push(),
    }
