"""Position-based fluids on CPU threads (M. Macklin and M. Mueller, SIGGRAPH 2013); model/fluid/plan.py defines a
substep.

Particles are stored in the order of their cells, and sorted again in each substep. Kernels: `fused`, many steps in one
call by a team of threads, and `stages`, one parallel loop per stage. In `exact` math both give the same bits, for any
number of threads.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from softlab.cpu_backend.core.layout import aligned_zeros
from softlab.cpu_backend.core.simulation import ParticlesSimulation, chosen_kernel
from softlab.cpu_backend.fluid import arrays
from softlab.cpu_backend.fluid.arrays import (
    At,
    Flow,
    Lists,
    Scratch,
    Sizes,
    Solids,
    Sorted,
    State,
    Table,
    Unsorted,
    Work,
)
from softlab.cpu_backend.fluid.cells import AXES, BOX
from softlab.cpu_backend.fluid.lists import AROUND, FAR, RUNS
from softlab.cpu_backend.fluid.passes import make_advance, make_pass
from softlab.cpu_backend.fluid.quads import LANES, QUAD, QUADS
from softlab.cpu_backend.fluid.rows import SCRATCH
from softlab.model.contact.cloth_parameters import collider_numbers
from softlab.model.core.own_forces import POKED
from softlab.model.core.plan import Executor, Moment, StageRun
from softlab.model.core.simulation import Options
from softlab.model.fluid.divergence_plan import SECOND
from softlab.model.fluid.flow import emitter_rows, fluid_starts, sink_rows
from softlab.model.fluid.parameters import MAX_NEIGHBOURS, fluid_rows, most_cells
from softlab.model.fluid.plan import fluid_plan
from softlab.model.fluid.samples import Samples
from softlab.model.fluid.simulation import FluidSimulation
from softlab.model.geometry.particle_row import PARKED
from softlab.model.scene.scene import Scene
from softlab.model.tables.flow import nozzle_points


class Fluid(FluidSimulation, ParticlesSimulation):
    """Fluids on CPU threads; model/core/simulation.py defines the contract. `threads`: `1x`, `2x`, `4x` or a number."""

    samples: Samples | None = None  # of solids: further particles behind those of the fluids

    def __init__(self, scene: Scene, options: Options, threads: str | int = "1x"):
        super().__init__(scene, options, threads)
        among, self.kernel = self.samples is not None, chosen_kernel(options.kernel, "fluids")
        self.plan = fluid_plan(scene, options.live, among)
        self._particles = len(self.body.position) + (self.samples.count if self.samples else 0)
        self._bands = max(1, min(self.threads, self._particles // LANES))
        self._bad = np.zeros(self._bands, np.int64)
        self._fluids = fluid_rows(scene, self.real, among).reshape(-1)
        self.integers = np.zeros(2, np.uint64)  # of model/core/own_forces.py
        self.integers[0] = scene.external.seed if scene.external else 0
        self._set_colliders(collider_numbers(scene, self.real))
        self._allocate()
        numba.set_num_threads(self._bands)  # starts the threads: stages may be called alone
        staged = self.kernel == "stages"
        self._executor = Executor(self.plan, self._stages() if staged else {}, None if staged else self._advance)
        self.reset()

    def _allocate(self) -> None:
        """Allocate the arrays of the kernels.

        A plane has `capacity` numbers: for all particles, for the unfilled lanes of the last slice, and for `nobody`, which
        is far away.
        """
        real, count, bands = self.real, self._particles, self._bands
        slices = -(-count // LANES)
        nobody = slices * LANES
        self._capacity = capacity = nobody + LANES

        def planes(kind: Any = real, many: int = AXES) -> np.ndarray:
            return aligned_zeros(many * capacity + LANES, kind)

        def places() -> np.ndarray:
            """Allocate planes of positions with the quads behind them."""
            return planes(many=QUADS + QUAD)

        self._state = State(planes(), planes(), planes(np.int32, 1), planes(np.int32, 1))
        unsorted = Unsorted(planes(), planes(), planes())
        in_order = Sorted(planes(), places(), planes(), planes(np.int32, 1), planes(np.int32, 1))
        factor, multiplier, delta, error = (planes(many=1) for _ in range(4))
        work = Work(places(), factor, multiplier, delta, error, planes())
        table = Table(
            np.zeros(BOX * bands, real), planes(np.int32, 1), np.zeros(most_cells(self.scene) + 1, np.int32),
            planes(np.int32, 1), np.zeros(bands, np.int64),
        )  # fmt: skip
        most = MAX_NEIGHBOURS[self.scene.dimensions]
        entries = aligned_zeros(slices * LANES * most, np.int32)
        self._counts = np.zeros(2 * bands, np.int64)  # per band: neighbours lost, then velocities slowed
        lists = Lists(planes(np.int32, 1), np.zeros(slices, np.int32), entries, self._counts)
        for array in (in_order.position, work.next):
            for axis in range(self.scene.dimensions):
                array[axis * capacity + nobody : (axis + 1) * capacity] = FAR
                array[QUADS * capacity + QUAD * nobody + axis : (QUADS + QUAD) * capacity : QUAD] = FAR
        near, who = aligned_zeros(4 * AROUND * bands, real), np.zeros(AROUND * bands + LANES, np.int32)
        scratch = Scratch(aligned_zeros(SCRATCH * LANES * bands, real), near, who, np.zeros(RUNS * bands, np.int64))
        sizes = Sizes(count, capacity, nobody)
        self._flow = self._make_flow()
        self._world = arrays.Fluid(
            sizes, self._state, unsorted, in_order, work, table, lists, scratch, self.parameters, self._fluids,
            self.integers, self.bodies, self.kinds, self._flow or (), self._make_solids(),
        )  # fmt: skip
        self._snapshot = tuple(array.copy() for array in self._now)

    def _make_solids(self) -> Solids | tuple[()]:
        """Return the arrays of solids that the fluid touches; none here."""
        return ()

    def _make_flow(self) -> Flow | None:
        """Return the arrays of emitters and sinks; None without them."""
        if not self._flows:
            return None
        scene, real = self.scene, self.real
        emitters, points = (
            emitter_rows(scene, self._emitter_state, real).reshape(-1),
            nozzle_points(scene, real).reshape(-1),
        )
        counts = np.zeros(1, np.int64), np.zeros(1, np.int64), fluid_starts(scene), np.zeros(self._particles, np.int8)
        return Flow(*counts, emitters, points, sink_rows(scene, real).reshape(-1))

    @property
    def _now(self) -> tuple[np.ndarray, ...]:
        """Arrays that a substep starts from: the state, and which particles are active."""
        return (*self._state, self._flow.particles, self._flow.active) if self._flow else self._state

    @property
    def there(self) -> int:
        """Number of active particles, which are the first ones of the state's arrays."""
        return int(self._flow.particles[0]) if self._flow else self._particles

    def _advance(self, step: int, steps: int) -> None:
        method = self.scene.method
        kernel = make_advance(self.real, self.options.math, self.plan.parts)
        kernel(self._bands, steps, step, method.substeps, method.iterations, self._inputs)

    @property
    def _inputs(self) -> arrays.Fluid:
        """Arrays of the kernels, with the current number of active particles and the current constants."""
        world = self._world
        return world._replace(sizes=world.sizes._replace(particles=self.there), parameters=self.parameters)

    def _stages(self) -> dict[str, StageRun]:
        """Return the function that runs each stage of the plan."""
        names = {stage.name for stage in self.plan.root.stages()}
        return {name: self._stage(make_pass(self.real, self.options.math, self.plan.parts, name)) for name in names}

    def _stage(self, kernel: Any) -> StageRun:
        iterations = self.scene.method.iterations

        def run(moment: Moment) -> None:
            at = At(moment.step, moment.number, moment.iteration, iterations, moment.argument == SECOND)
            kernel(self._bands, at, self._inputs)

        return run

    # ------------------------------------------------------------------ diagnostics

    @property
    def contacts_lost(self) -> int:
        """Number of neighbours beyond the MAX_NEIGHBOURS of a list, since the simulation was opened."""
        return int(self._counts[: self._bands].sum())

    @property
    def speed_limited(self) -> int:
        """Number of times that the speed limit slowed a particle in a substep, since the simulation was opened."""
        return int(self._counts[self._bands :].sum())

    def _by_number(self, array: np.ndarray) -> np.ndarray:
        """Return (particles,) values by number from an array in the order of cells; 0 for inactive particles."""
        by_number = np.zeros(self._particles, array.dtype)
        by_number[self._state.number[: self.there]] = array[: self.there]
        return by_number

    def _multipliers(self) -> np.ndarray:
        """Return (particles,) the multipliers of the last substep [m^2] (`pressures` of model/fluid/measure.py)."""
        return self._by_number(self._world.work.multiplier)

    # ------------------------------------------------------------------ the contract

    def _store_snapshot(self) -> None:
        for stored, array in zip(self._snapshot, self._now, strict=True):
            stored[:] = array

    def _restore(self) -> None:
        for stored, array in zip(self._snapshot, self._now, strict=True):
            array[:] = stored

    def _places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        slots = np.full(self._particles, self._world.sizes.nobody)  # the slot of `nobody`, which has zeros
        slots[self._state.number[: self.there]] = np.arange(self.there)
        return self._state.position, self._state.velocity, slots, self._capacity

    def _first_diverged(self) -> int:
        position, velocity, slots, stride = self._places()
        active = np.flatnonzero(slots != self._world.sizes.nobody)
        bad = self._first_diverged_of(position, velocity, slots[active], stride)
        return bad if bad < 0 else int(active[bad])

    def _parameters_changed(self) -> None:
        self.integers[POKED] = self._poke_particle + 1
        self._fluids[:] = fluid_rows(self.scene, self.real, self.samples is not None).reshape(-1)
        if self._flow:
            self._flow.emitters[:] = emitter_rows(self.scene, self._emitter_state, self.real).reshape(-1)

    def _download(self) -> tuple[np.ndarray, np.ndarray]:
        axes, capacity, count = self.scene.dimensions, self._capacity, self.there
        number, by_number = self._state.number[:count], []
        for array, waiting in zip(self._state[:2], (PARKED, 0.0), strict=True):
            values = np.full((self._particles, axes), waiting, self.real)
            values[number] = array[: axes * capacity].reshape(axes, capacity)[:, :count].T
            by_number.append(values)
        return by_number[0], by_number[1]

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        axes, capacity, fluid_set = self.scene.dimensions, self._capacity, self.scene.fluid_set
        number = np.flatnonzero(fluid_set.there(position))
        for array, values in zip(self._state[:2], (position, velocity), strict=True):
            array[: axes * capacity].reshape(axes, capacity)[:, : len(number)] = values[number].T
        self._state.number[: len(number)], self._state.fluid[: len(number)] = number, fluid_set.fluid[number]
        if self._flow:
            self._flow.particles[0], self._flow.active[:] = len(number), fluid_set.there(position)

    @property
    def not_emitted(self) -> int:
        """Number of particles that a nozzle could not emit as none was inactive, since the simulation was opened."""
        return int(self._flow.missed[0]) if self._flow else 0
