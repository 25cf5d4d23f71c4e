"""A fluid that meets solids, on CUDA, stage by stage: model/fluid/plan.py, Solids, says what it does.

The solids are someone else's, who brings their particles and takes them back (`SolidPlaces`).
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from gpu_backend.fluid.solids import make_sampling, make_solid_kernels
from gpu_backend.fluid.solver import Fluid
from gpu_backend.fluid.stages import bind_fluid_stages
from model.core.plan import Moment, StageRun
from model.core.simulation import Options
from model.fluid.among_solids import kinds_of
from model.fluid.samples import Samples
from model.scene.scene import Scene

COUNTED = 128  # threads a block, over samples and over particles of solids


class SolidPlaces(Protocol):
    """Where the solids' particles are: `before` as a substep began, `position` now, flat device arrays of quads."""

    before: Any
    position: Any

    def take(self, fresh: bool) -> None:
        """Bring `position` up to date, with `fresh` also `before`."""

    def give(self) -> None:
        """The solids are at `position` from now on."""


class FluidAmongSolids(Fluid):
    """Fluids and `samples` of solids, whose particles lie at `places`. Kernel `stages` alone; the rest is the contract of
    Fluid."""

    def __init__(self, scene: Scene, options: Options, samples: Samples, places: SolidPlaces):
        self.samples, self._places_of_solids = samples, places
        super().__init__(scene, options)

    def _allocate(self) -> None:
        super()._allocate()
        real, samples, new = self.real, self.samples, self.on_device
        assert samples is not None
        offsets, carried, shares = samples.carriers
        self._kinds = new(kinds_of(self.scene, samples).astype(real))
        self._slots, self._shift = new(np.zeros(samples.count, np.int32)), new(np.zeros(3 * samples.count, real))
        self._points = new(samples.corners), new(samples.shares.astype(real))
        self._carriers = new(samples.lightness.astype(real)), new(offsets), new(carried), new(shares.astype(real))
        self._over_samples = self._over(samples.count, COUNTED)
        self._over_solids = self._over(len(samples.lightness), COUNTED)

    @property
    def _own(self) -> int:
        """How many particles the fluid has."""
        return len(self.body.position)

    @property
    def _fluid_of(self) -> np.ndarray:
        sampled = np.full(self.particle_count - self._own, len(self.scene.fluid_set.parts), np.int32)
        return np.append(self.scene.fluid_set.fluid, sampled)

    def _bind_stages(self) -> dict[str, StageRun]:
        return bind_solid_stages(self)

    # ------------------------------------------------------------------ the contract, of the fluid's own particles

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        more = np.zeros((self.particle_count - self._own, position.shape[1]), self.real)
        super()._upload(np.concatenate([position, more]), np.concatenate([velocity, more]))

    def _to_host(self, array: Any) -> np.ndarray:
        return super()._to_host(array)[: self._own]

    def _multipliers(self) -> np.ndarray:
        return super()._multipliers()[: self._own]

    def _first_diverged(self) -> int:
        bad = super()._first_diverged()
        return bad if bad < self._own else -1

    def _read_position(self, into: Any) -> Any:
        position, _ = self._download()
        if into is None:
            return position
        into[...] = position
        return into


def bind_solid_stages(sim: FluidAmongSolids) -> dict[str, StageRun]:
    """What runs each stage of the plan of `sim`."""
    found = bind_fluid_stages(sim)
    variant = sim.real, sim.options.math
    sampling, solving = make_sampling(*variant), make_solid_kernels(*variant, sim.plan.parts)
    fluids, flat, places, now = np.int32(sim._own), sim._flat, sim._places_of_solids, found.now
    start = sim.on_device(np.zeros(1, np.int64))

    def world(moment: Moment) -> tuple[Any, ...]:
        time = start, np.int64(moment.step), np.int64(moment.substeps), np.int64(moment.substep)
        return sim.bodies, sim.integers, *time

    def known() -> tuple[Any, ...]:
        return sim.record, *sim.lists, sim.particle[1], fluids, sim._kinds

    def sample(moment: Moment) -> None:
        places.take(fresh=True)
        predicted, before, meant, number = now["given"]
        points = *sim._points, places.before, places.position
        sampling.sample[flat](number, fluids, *points, predicted, before, meant)
        sim.cells.bound(predicted)

    def find(moment: Moment) -> None:
        found.stages["find neighbours"](moment)
        sampling.gather[flat](sim.particle[1], fluids, sim._slots)
        solving.factors[flat](now["position"], *known(), *sim.relaxed, sim.fluids, *world(moment))

    def follow(moment: Moment) -> None:
        places.take(fresh=False)
        sampling.follow[sim._over_samples](sim._slots, *sim._points, places.position, now["position"])

    def density(moment: Moment) -> None:
        solving.density[flat](now["position"], *known(), *sim.relaxed, *world(moment))

    def correct(moment: Moment) -> None:
        given = sim.before, now["position"], *known(), sim.gradients, sim.fluids, *world(moment)
        solving.correct[flat](*given, sim._shift, now["other"])
        now["position"], now["other"] = now["other"], now["position"]

    def push(moment: Moment) -> None:
        sampling.push[sim._over_solids](*sim._carriers, sim._shift, places.position)
        places.give()

    return found.stages | {
        "sample solids": sample,
        "find neighbours": find,
        "follow solids": follow,
        "density": density,
        "correct": correct,
        "push solids": push,
    }
