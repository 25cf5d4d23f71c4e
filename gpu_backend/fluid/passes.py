"""Launches of the passes of a fluid's substep on CUDA, by schemes that correct positions (model/fluid/plan.py).

A substep leads from the state in the buffers `_current` to that in the other ones, which a sort makes the current ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from softlab.gpu_backend.core.device import Arguments, DeviceArray
from softlab.gpu_backend.fluid.cells import Particles
from softlab.gpu_backend.fluid.flow import Flow
from softlab.gpu_backend.fluid.kernels import make_density_kernels
from softlab.gpu_backend.fluid.motion import make_begin, make_settle
from softlab.gpu_backend.fluid.smoothing import make_smoothing
from softlab.gpu_backend.fluid.sort_kernels import THREADS as SORT_THREADS
from softlab.model.core.plan import Moment, StageRun
from softlab.model.fluid.passes import (
    CORRECT,
    DENSITY,
    EMIT,
    FIND,
    LIMIT,
    PREDICT,
    SHAPE,
    SMOOTHING,
    SORT,
    UPDATE,
    Run,
    Substep,
    runs_of,
)

PREPARE = (FIND, DENSITY)  # all at the predicted positions
SETTLE = (CORRECT, UPDATE)  # the last correction and the velocities
SETTLE_AND_LIMIT = (*SETTLE, LIMIT)  # without effects of neighbours on velocities
SMOOTH = (LIMIT,)  # the effects of neighbours and the limit in one kernel


def fused_passes(parts: frozenset[str]) -> tuple[tuple[str, ...], ...]:
    """Return the runs of passes of a substep that one kernel does."""
    if "divergence-free" in parts:
        return ()
    return (PREPARE, SETTLE, SMOOTH) if parts & SMOOTHING else (PREPARE, SETTLE_AND_LIMIT)


class Launched(NamedTuple):
    """The function that launches some passes, and its number of launches."""

    run: StageRun
    launches: int = 1


class Passes:
    """The passes of `sim`, a gpu_backend.fluid.solver.Fluid. `fused`: runs of them that one kernel does."""

    def __init__(self, sim: Any, fused: tuple[tuple[str, ...], ...] = ()):
        self.sim, self.fused, self._smooths = sim, fused, bool(sim.plan.parts & SMOOTHING)
        self._variant = sim.real, sim.options.math, sim.plan.parts, sim.repeats
        self.density_kernels = make_density_kernels(*self._variant, sim.neighbours)
        self.smoothing: Any = make_smoothing(*self._variant, SMOOTH in fused) if self._smooths else None

    def launched(self) -> Mapping[tuple[str, ...], Launched]:
        """Return what launches each pass, and each run of passes that one kernel does."""
        return {(SORT,): Launched(self.sort, self.sim.cells.sorting), (FIND,): Launched(self.find, 2)}

    def stages(self) -> dict[str, StageRun]:
        """Return the function that runs each stage of the plan."""
        return {passes[0]: one.run for passes, one in self.launched().items() if len(passes) == 1}

    def schedule(self, substep: Substep) -> list[tuple[Run, Launched]]:
        """Return what is launched for the passes of a substep, in order."""
        launched = self.launched()
        return [(run, launched[run.passes]) for run in runs_of(substep, self.sim.scene.method.iterations, self.fused)]

    # ------------------------------------------------------------------ arguments

    def time(self, at: Moment) -> Arguments:
        """Return the time of a pass as kernels take it: counter, place, substeps, substep."""
        return self.sim._counter, np.int64(at.step), np.int64(at.substeps), np.int64(at.substep)

    def world(self, at: Moment) -> Arguments:
        """Return the colliders, the integers of forces and the time."""
        return self.sim.bodies, self.sim.integers, *self.time(at)

    @property
    def state(self) -> tuple[DeviceArray, DeviceArray, DeviceArray]:
        """Positions, velocities and numbers in the current buffers."""
        sim, now = self.sim, self.sim._current
        return sim.position[now], sim.velocity[now], sim.particle[now]

    def unsorted(self) -> Particles:
        """Return the particles before the sort."""
        raise NotImplementedError

    # ------------------------------------------------------------------ passes of all schemes

    def sort(self, at: Moment) -> None:
        """Sort the particles into the order of cells; the other buffers become the current ones."""
        sim, particles = self.sim, self.unsorted()
        sim._current = now = 1 - sim._current
        into = Particles(sim.sorted, sim.before, sim.predicted_velocity, sim.particle[now])
        sim.cells.sort(sim.record, particles, into)

    def search(self) -> None:
        """Build the neighbour lists."""
        sim, cells = self.sim, self.sim.cells
        grid = cells.sorted_keys, cells.numbers, cells.begins
        self.density_kernels.find[sim._flat](sim.sorted, sim.record, *grid, *sim.lists, cells.counts)

    def find(self, at: Moment) -> None:
        """Build the neighbour lists, and compute the factors."""
        sim = self.sim
        self.search()
        self.density_kernels.factors[sim._flat](
            sim.sorted, sim.record, *sim.lists, *sim.relaxed, sim.fluids, *self.world(at)
        )


class PositionPasses(Passes):
    """The passes of schemes that correct positions. An iteration leads from `positions` of its number to the next."""

    def __init__(self, sim: Any, fused: tuple[tuple[str, ...], ...] = ()):
        super().__init__(sim, fused)
        self.begin, self.velocities = make_begin(*self._variant), make_settle(*self._variant)

    def launched(self) -> Mapping[tuple[str, ...], Launched]:
        return {
            **super().launched(),
            (EMIT,): Launched(self.emit, Flow.emitting),
            (PREDICT,): Launched(self.predict),
            PREPARE: Launched(self.prepare),
            (DENSITY,): Launched(self.density),
            (CORRECT,): Launched(self.correct),
            SETTLE: Launched(self.settle),
            SETTLE_AND_LIMIT: Launched(self.settle),
            (UPDATE,): Launched(self.update),
            (SHAPE,): Launched(self.shape),
            (LIMIT,): Launched(self.smooth) if SMOOTH in self.fused else Launched(self.limit, 1 + self._smooths),
        }

    def unsorted(self) -> Particles:
        sim, (position, _, particle), other = self.sim, self.state, 1 - self.sim._current
        return Particles(sim.position[other], sim.corrected if sim.repeats else position, sim.velocity[other], particle)

    def positions(self, iteration: int) -> DeviceArray:
        """Return the positions that an iteration starts from: `prepare` writes them into other arrays."""
        sim = self.sim
        return sim.corrected if (iteration + (PREPARE in self.fused)) % 2 else sim.sorted

    @property
    def new_velocity(self) -> DeviceArray:
        """Velocities before the effects of neighbours, if there are any."""
        return self.sim.predicted_velocity if self._smooths else self.state[1]

    def emit(self, at: Moment) -> None:
        """Emit the particles of a substep into the state."""
        self.sim.flow.emit(*self.state, self.time(at))

    def predict(self, at: Moment) -> None:
        """Predict from the state, into the other buffers and `corrected`."""
        sim, other, cells = self.sim, 1 - self.sim._current, self.sim.cells
        self.begin[cells.blocks, SORT_THREADS, sim.stream](
            *self.state, cells.limit, sim.record, sim.fluids, *self.world(at), sim.position[other], sim.corrected,
            sim.velocity[other], cells.boxes, cells.counts,
        )  # fmt: skip

    def prepare(self, at: Moment) -> None:
        """Build the neighbour lists, and compute the factors and the first changes of multipliers."""
        sim, cells = self.sim, self.sim.cells
        grid = cells.sorted_keys, cells.numbers, cells.begins
        self.density_kernels.prepare[sim._flat](
            sim.sorted, sim.record, *grid, *sim.lists, cells.counts, *sim.relaxed, sim.fluids, *self.world(at),
            self.positions(0),
        )  # fmt: skip

    def density(self, at: Moment) -> None:
        """Compute the changes of multipliers."""
        sim = self.sim
        self.density_kernels.density[sim._flat](
            self.positions(at.iteration), sim.record, *sim.lists, *sim.relaxed, *self.world(at)
        )

    def correct(self, at: Moment) -> None:
        """Correct the positions of an iteration."""
        sim, here, there = self.sim, self.positions(at.iteration), self.positions(at.iteration + 1)
        self.density_kernels.correct[sim._flat](
            sim.before, here, sim.record, *sim.lists, sim.gradients, sim.fluids, *self.world(at), there
        )

    def settle(self, at: Moment) -> None:
        """Correct the positions, and compute velocities, limited unless effects of neighbours follow."""
        sim = self.sim
        self.velocities.settle[sim._flat](
            sim.before, sim.predicted_velocity, self.positions(at.iteration), sim.record, *sim.lists, *sim.relaxed[1:],
            sim.fluids, *self.world(at), self.state[0], self.new_velocity,
        )  # fmt: skip

    def update(self, at: Moment) -> None:
        """Compute velocities."""
        sim, position = self.sim, self.positions(self.sim.scene.method.iterations)
        self.velocities.update[sim._flat](
            sim.before, sim.predicted_velocity, position, sim.record, sim.multipliers, sim.fluids, *self.world(at),
            self.state[0], self.new_velocity,
        )  # fmt: skip

    def shape(self, at: Moment) -> None:
        """Compute normals and vorticities, into `before` and `sorted`."""
        sim = self.sim
        arrays = self.state[0], self.new_velocity, sim.record, *sim.lists, sim.before, sim.sorted
        self.smoothing.shape[sim._flat](*arrays)

    def smooth(self, at: Moment) -> None:
        """Apply the effects of neighbours to velocities."""
        sim, (position, velocity, _) = self.sim, self.state
        self.smoothing.smooth[sim._flat](
            position, self.new_velocity, sim.record, *sim.lists, sim.constraints, sim.fluids, sim.before, sim.sorted,
            velocity,
        )  # fmt: skip

    def limit(self, at: Moment) -> None:
        """Apply the effects of neighbours, drag and the speed limit to velocities."""
        sim, (position, velocity, _) = self.sim, self.state
        if self._smooths:
            self.smooth(at)
        self.velocities.limit[sim._flat](position, velocity, sim.constraints, sim.record, sim.fluids)
