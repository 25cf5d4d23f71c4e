"""A fluid coupled to solids on CPU threads, stage by stage (model/fluid/plan.py, Solids).

The solids belong to another simulation, which reads and writes their particles through `SolidPlaces`.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from softlab.cpu_backend.core.layout import aligned_zeros
from softlab.cpu_backend.fluid.arrays import Carriers, SamplePoints, SolidPoints, Solids
from softlab.cpu_backend.fluid.quads import LANES
from softlab.cpu_backend.fluid.solid_phases import SUMS
from softlab.cpu_backend.fluid.solver import Fluid
from softlab.model.core.plan import Moment, StageRun
from softlab.model.core.simulation import Options
from softlab.model.fluid.among_solids import KINDS, kinds_of
from softlab.model.fluid.passes import FOLLOW, PUSH, SAMPLE
from softlab.model.fluid.samples import Samples
from softlab.model.scene.scene import Scene


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

    def _make_solids(self) -> Solids:
        real, samples, places = self.real, self.samples, self._places_of_solids
        assert samples is not None
        offsets, carried, weights = samples.carriers
        carriers = Carriers(samples.lightness.astype(real), offsets, carried, weights.astype(real))
        points = SamplePoints(samples.corners.reshape(-1), samples.weights.reshape(-1).astype(real))
        return Solids(
            len(self.body.position), kinds_of(self.scene, samples).astype(real).reshape(-1),
            aligned_zeros(KINDS * self._capacity, real), np.zeros(samples.count, np.int32), points,
            SolidPoints(places.before.reshape(-1), places.position.reshape(-1)), carriers,
            np.zeros(3 * samples.count, real), aligned_zeros(SUMS * LANES * self._bands, real),
        )  # fmt: skip

    def _stages(self) -> dict[str, StageRun]:
        stages, places = super()._stages(), self._places_of_solids

        def sample(moment: Moment) -> None:
            places.take(fresh=True)
            stages[SAMPLE](moment)

        def follow(moment: Moment) -> None:
            places.take(fresh=False)
            stages[FOLLOW](moment)

        def push(moment: Moment) -> None:
            stages[PUSH](moment)
            places.give()

        return stages | {SAMPLE: sample, FOLLOW: follow, PUSH: push}

    # ------------------------------------------------------------------ the contract, of the fluid's own particles

    def _by_number(self, array: np.ndarray) -> np.ndarray:
        return super()._by_number(array)[: len(self.body.position)]

    def _download(self) -> tuple[np.ndarray, np.ndarray]:
        position, velocity = super()._download()
        return position[: len(self.body.position)].copy(), velocity[: len(self.body.position)].copy()

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        capacity, count, fluids = self._capacity, self._particles, len(self.body.position)
        for array, values in zip(self._state[:2], (position, velocity), strict=True):
            planes = array[: 3 * capacity].reshape(3, capacity)
            planes[:, :fluids], planes[:, fluids:count] = values.T, 0
        self._state.number[:count] = np.arange(count)
        self._state.fluid[:fluids] = self.scene.fluid_set.fluid
        self._state.fluid[fluids:count] = len(self.scene.fluid_set.parts)
