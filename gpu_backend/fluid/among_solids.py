"""A fluid coupled to solids on CUDA, by launches or stage by stage (model/fluid/plan.py, Solids).

The solids belong to another simulation, which reads and writes their particles through `SolidPlaces`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.device import Arguments, DeviceArray, Stream
from softlab.gpu_backend.fluid.passes import SMOOTH, Launched, Passes, PositionPasses
from softlab.gpu_backend.fluid.solids import make_sampling, make_solid_kernels
from softlab.gpu_backend.fluid.solver import Fluid
from softlab.model.core.plan import Moment
from softlab.model.core.simulation import Options
from softlab.model.fluid.among_solids import kinds_of
from softlab.model.fluid.passes import CORRECT, DENSITY, FIND, FOLLOW, PUSH, SAMPLE, SMOOTHING, Substep, three_parts
from softlab.model.fluid.plan import substep_of
from softlab.model.fluid.samples import Samples
from softlab.model.scene.scene import Scene

COUNTED = 128  # threads per block, over samples and over particles of solids


class SolidPlaces(Protocol):
    """Positions of the solids' particles: `before` the substep, and `position` now, flat device arrays of quads."""

    before: DeviceArray
    position: DeviceArray

    @property
    def taking(self) -> int:
        """Number of launches of `take` of positions only; there are twice as many if `fresh`."""

    @property
    def giving(self) -> int:
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
        self.sample_kinds = new(kinds_of(self.scene, samples).astype(real))
        self.slots, self.shift = new(np.zeros(samples.count, np.int32)), new(np.zeros(3 * samples.count, real))
        self.points = new(samples.corners), new(samples.weights.astype(real))
        self.carriers = new(samples.lightness.astype(real)), new(offsets), new(carried), new(weights.astype(real))
        self.over_samples = self._over(samples.count, COUNTED)
        self.over_solids = self._over(len(samples.lightness), COUNTED)

    @property
    def fluid_count(self) -> int:
        """Number of the fluid's particles."""
        return len(self.body.position)

    @property
    def _fluid_of(self) -> np.ndarray:
        sampled = np.full(self.particle_count - self.fluid_count, len(self.scene.fluid_set.parts), np.int32)
        return np.append(self.scene.fluid_set.fluid, sampled)

    def _make_passes(self) -> Passes:
        smooths = self.kernel != "stages" and self.plan.parts & SMOOTHING
        return SolidPasses(self, (SMOOTH,) if smooths else ())

    def _warm_up(self) -> None:
        """Do nothing: kernels are compiled when they first run, in the world's first step."""

    @property
    def _substep_parts(self) -> tuple[Substep, Substep, Substep]:
        return three_parts(substep_of(self.plan.parts))

    # ------------------------------------------------------------------ the contract, of the fluid's own particles

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        more = np.zeros((self.particle_count - self.fluid_count, position.shape[1]), self.real)
        super()._upload(np.concatenate([position, more]), np.concatenate([velocity, more]))

    def _to_host(self, array: DeviceArray) -> np.ndarray:
        return super()._to_host(array)[: self.fluid_count]

    def _multipliers(self) -> np.ndarray:
        return super()._multipliers()[: self.fluid_count]

    def _first_diverged(self) -> int:
        bad = super()._first_diverged()
        return bad if bad < self.fluid_count else -1

    def _read_position(self, into: Any) -> Any:
        if into is not None and hasattr(into, "__cuda_array_interface__"):
            if self._whole is None:
                self._whole = cuda.device_array((self.particle_count, 3), np.float32, stream=self.stream)
            state = self.position[self._current], self.particle[self._current]
            self._tools.write_position[self._flat](*state, self._whole)
            cuda.as_cuda_array(into).copy_to_device(self._whole[: self.fluid_count], stream=self.stream)
            self.synchronize()
            return into
        return super()._read_position(into)


class SolidPasses(PositionPasses):
    """The passes of a fluid among solids, of `sim`, a FluidAmongSolids."""

    def __init__(self, sim: Any, fused: tuple[tuple[str, ...], ...] = ()):
        super().__init__(sim, fused)
        variant = sim.real, sim.options.math
        self.sampling, self.solving = make_sampling(*variant), make_solid_kernels(*variant, sim.plan.parts)

    def launched(self) -> Mapping[tuple[str, ...], Launched]:
        taking, giving = self.sim.places.taking, self.sim.places.giving
        return {
            **super().launched(),
            (SAMPLE,): Launched(self.sample, 2 * taking + 2),
            (FIND,): Launched(self.find, 3),
            (FOLLOW,): Launched(self.follow, taking + 1),
            (DENSITY,): Launched(self.density),
            (CORRECT,): Launched(self.correct),
            (PUSH,): Launched(self.push, 1 + giving),
        }

    def known(self) -> Arguments:
        """Return the arguments of kernels that need the numbers of particles."""
        sim = self.sim
        return sim.record, *sim.lists, self.state[2], np.int32(sim.fluid_count), sim.sample_kinds

    def sample(self, at: Moment) -> None:
        """Write the predicted positions of samples, and compute the bounding box."""
        sim, particles = self.sim, self.unsorted()
        sim.places.take(fresh=True)
        self.sampling.sample[sim._flat](
            particles.number, np.int32(sim.fluid_count), *sim.points, sim.places.before, sim.places.position,
            particles.position, particles.before, particles.velocity,
        )  # fmt: skip
        sim.cells.bound(particles.position)

    def find(self, at: Moment) -> None:
        """Build the neighbour lists, store the slots of samples, and compute the factors."""
        sim = self.sim
        self.search()
        self.sampling.gather[sim._flat](self.state[2], np.int32(sim.fluid_count), sim.slots)
        self.solving.factors[sim._flat](sim.sorted, *self.known(), *sim.relaxed, sim.fluids, *self.world(at))

    def follow(self, at: Moment) -> None:
        """Write the current positions of samples."""
        sim, position = self.sim, self.positions(at.iteration)
        sim.places.take(fresh=False)
        self.sampling.follow[sim.over_samples](sim.slots, *sim.points, sim.places.position, position)

    def density(self, at: Moment) -> None:
        """Compute the changes of multipliers."""
        position = self.positions(at.iteration)
        self.solving.density[self.sim._flat](position, *self.known(), *self.sim.relaxed, *self.world(at))

    def correct(self, at: Moment) -> None:
        """Correct the positions of an iteration; store the shifts of samples."""
        sim, here, there = self.sim, self.positions(at.iteration), self.positions(at.iteration + 1)
        arguments = sim.before, here, *self.known(), sim.gradients, sim.fluids, *self.world(at)
        self.solving.correct[sim._flat](*arguments, sim.shift, there)

    def push(self, at: Moment) -> None:
        """Move the solids' particles by the shifts of their samples."""
        sim = self.sim
        self.sampling.push[sim.over_solids](*sim.carriers, sim.shift, sim.places.position)
        sim.places.give()
