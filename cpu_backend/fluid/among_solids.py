"""A fluid coupled to solids on CPU threads, stage by stage (model/fluid/plan.py, Solids).

The solids belong to another simulation, which reads and writes their particles through `SolidPlaces`.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Protocol

import numpy as np

from softlab.cpu_backend.core.layout import aligned_zeros
from softlab.cpu_backend.fluid.arrays import Carriers, SamplePoints, SolidPoints, Solids
from softlab.cpu_backend.fluid.kernels import fluid_compiler, fluid_variant
from softlab.cpu_backend.fluid.quads import LANES
from softlab.cpu_backend.fluid.solid_phases import (
    SUMS,
    constrain,
    correct,
    factors,
    follow,
    gather,
    push,
    sample,
)
from softlab.cpu_backend.fluid.solver import Fluid
from softlab.model.base.types import Real
from softlab.model.core.plan import Moment, StageRun
from softlab.model.core.simulation import Options
from softlab.model.fluid.among_solids import KINDS, kinds_of
from softlab.model.fluid.samples import Samples
from softlab.model.scene.scene import Scene


@cache
def make_solid_stages(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile the phases that involve solids, each as a parallel loop (bands, ...)."""
    compiler = fluid_compiler("fluid_solids", real, math, parts)
    variant = fluid_variant(compiler, real, parts - {"averaged"})
    phases = sample, gather, follow, push, factors, constrain, correct
    return SimpleNamespace(**{phase.__name__: compiler.banded(variant(phase)) for phase in phases})


class SolidPlaces(Protocol):
    """Positions of the solids' particles, (n, 3) in the precision [m]: `before` the substep, and `position` now."""

    before: np.ndarray
    position: np.ndarray

    def take(self, fresh: bool) -> None:
        """Bring `position` up to date, and `before` too if `fresh`."""

    def give(self) -> None:
        """Write `position` back to the solids."""


class FluidAmongSolids(Fluid):
    """Fluids and `samples` of solids, whose particles are at `places`. Supports only the kernel `stages`; the rest is
    the contract of Fluid."""

    def __init__(
        self, scene: Scene, options: Options, threads: str | int, samples: Samples, places: SolidPlaces
    ):  # fmt: skip
        self.samples, self._places_of_solids = samples, places
        super().__init__(scene, options, threads)

    def _allocate(self) -> None:
        super()._allocate()
        real, samples, fluids = self.real, self.samples, len(self.body.position)
        assert samples is not None
        offsets, carried, weights = samples.carriers
        places = self._places_of_solids
        self._number_of_fluids = fluids
        carriers = Carriers(samples.lightness.astype(real), offsets, carried, weights.astype(real))
        points = SamplePoints(samples.corners.reshape(-1), samples.weights.reshape(-1).astype(real))
        self._coupling = Solids(
            fluids, kinds_of(self.scene, samples).astype(real).reshape(-1), aligned_zeros(KINDS * self._capacity, real),
            np.zeros(samples.count, np.int32), points, SolidPoints(places.before.reshape(-1), places.position.reshape(-1)),
            carriers, np.zeros(3 * samples.count, real),
        )  # fmt: skip
        self._sums = aligned_zeros(SUMS * LANES * self._bands, real)

    def _stages(self) -> dict[str, StageRun]:
        stages = super()._stages()
        stage = make_solid_stages(self.real, self.options.math, self.plan.parts)
        bands, world, coupling, sums = self._bands, self._world, self._coupling, self._sums
        rest, fluids = (self.parameters, self.bodies, self.kinds), self._fluids
        places, buffers, search = (
            self._places_of_solids,
            (world.in_order.position, world.work.next),
            stages["find neighbours"],
        )

        def find(moment: Moment) -> None:
            search(moment)
            stage.gather(bands, world, coupling)
            stage.factors(bands, moment.number, world, coupling, sums, rest[0], fluids, *rest[1:])

        def sample(moment: Moment) -> None:
            places.take(fresh=True)
            stage.sample(bands, world, coupling)

        def follow(moment: Moment) -> None:
            places.take(fresh=False)
            stage.follow(bands, buffers[moment.iteration % 2], world, coupling)

        def density(moment: Moment) -> None:
            stage.constrain(bands, moment.number, buffers[moment.iteration % 2], world, coupling, sums, *rest)

        def correct(moment: Moment) -> None:
            here = moment.iteration % 2
            arguments = buffers[here], buffers[1 - here], world, coupling, sums, rest[0], fluids, *rest[1:]
            stage.correct(bands, moment.number, *arguments)

        def push(moment: Moment) -> None:
            stage.push(bands, coupling)
            places.give()

        return stages | {
            "sample solids": sample,
            "find neighbours": find,
            "follow solids": follow,
            "density": density,
            "correct": correct,
            "push solids": push,
        }

    # ------------------------------------------------------------------ the contract, of the fluid's own particles

    def _by_number(self, array: np.ndarray) -> np.ndarray:
        return super()._by_number(array)[: self._number_of_fluids]

    def _download(self) -> tuple[np.ndarray, np.ndarray]:
        position, velocity = super()._download()
        return position[: self._number_of_fluids].copy(), velocity[: self._number_of_fluids].copy()

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        capacity, count, fluids = self._capacity, self._particles, self._number_of_fluids
        for array, values in zip(self._state[:2], (position, velocity), strict=True):
            planes = array[: 3 * capacity].reshape(3, capacity)
            planes[:, :fluids], planes[:, fluids:count] = values.T, 0
        self._state.number[:count] = np.arange(count)
        self._state.fluid[:fluids] = self.scene.fluid_set.fluid
        self._state.fluid[fluids:count] = len(self.scene.fluid_set.parts)
