"""Position-based fluids on CUDA: a substep is a dozen launches, all in the order of cells.

The method, and every order of summation, is in model/fluid/plan.py. Particles are sorted again in every substep;
`particle` is the number of each, and results are read in the scene's order. Kernels: `launch`; `graph`, the same
captured as a CUDA graph; `stages`, stage by stage. In `exact` math all give the same bits as the CPU.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.device import DeviceArray, Stream, simulated
from softlab.gpu_backend.core.launch import Graphs, can_capture
from softlab.gpu_backend.core.quads import SIZE
from softlab.gpu_backend.core.simulation import NOTHING_BAD
from softlab.gpu_backend.core.substeps import SubstepSimulation, launched_kernel
from softlab.gpu_backend.fluid.cells import Cells, cell_bytes
from softlab.gpu_backend.fluid.divergence_free import QUADS as FREE_QUADS
from softlab.gpu_backend.fluid.divergence_free import SCALARS, DivergenceFreePasses
from softlab.gpu_backend.fluid.flow import Flow
from softlab.gpu_backend.fluid.kernels import WALL
from softlab.gpu_backend.fluid.lists import LANES, TOGETHER
from softlab.gpu_backend.fluid.passes import Launched, Passes, PositionPasses, fused_passes
from softlab.gpu_backend.fluid.tools import make_fluid_tools
from softlab.model.base.errors import SceneError
from softlab.model.contact.cloth_parameters import collider_numbers
from softlab.model.core.plan import Executor, Moment
from softlab.model.core.simulation import Options
from softlab.model.fluid.parameters import MAX_NEIGHBOURS, fluid_rows, most_cells
from softlab.model.fluid.passes import Run, Substep
from softlab.model.fluid.plan import FLOWS, fluid_plan, substep_of
from softlab.model.fluid.samples import Samples
from softlab.model.fluid.simulation import FluidSimulation
from softlab.model.geometry.particle_row import PARKED
from softlab.model.scene.scene import Scene

THREADS = LANES  # per block
FEWER = {8192: 32, 32768: 64}  # threads for at most so many particles, so that each multiprocessor has some
QUADS = 10  # quads per particle: the state twice and its snapshot, and the arrays of a substep


class Fluid(FluidSimulation, SubstepSimulation):
    """Fluids on CUDA; model/core/simulation.py defines the contract. `threads` is the number of threads per block."""

    samples: Samples | None = None  # of solids: further particles behind those of the fluids
    _schedule: list[list[tuple[Run, Launched]]]  # of a substep: before, in and after the iterations that a world drives
    _moment: Moment

    def __init__(self, scene: Scene, options: Options, stream: Stream | None = None):
        super().__init__(scene, options, stream)
        self.kernel, among = launched_kernel(options.kernel, "fluids"), self.samples is not None
        self.plan = fluid_plan(scene, options.live, among)
        self.particle_count += self.samples.count if self.samples else 0
        self.threads = next((few for most, few in FEWER.items() if self.particle_count <= most), THREADS)
        self.neighbours = MAX_NEIGHBOURS[scene.dimensions]
        self.repeats = frozenset(scene.domain.repeats) if scene.domain else frozenset()
        self.most_cells = most_cells(scene)
        self._require_space()
        self._start(self.threads)

    def _require_space(self) -> None:
        count, item = self.particle_count, np.dtype(self.real).itemsize
        needed = item * count * (QUADS * SIZE + WALL + 3) + 12 * count
        if "divergence-free" in self.plan.parts:
            needed += item * count * (FREE_QUADS * SIZE + SCALARS)
        needed += cell_bytes(count, self.most_cells, self.neighbours, item)
        field = f"{self.scene.fluid_set.names[0]}.rest_distance"
        if max(self.most_cells, SIZE * count) > np.iinfo(np.int32).max:
            raise SceneError(field, f"{count} particles", "more than 32-bit indices can number")
        self._require_memory(needed, field, f"{count} particles")

    # ------------------------------------------------------------------ arrays and kernels

    def _allocate(self) -> None:
        scene, real, count = self.scene, self.real, self.particle_count
        self._weight = self._fluid_of.astype(real)  # the fourth number of a position
        self._allocate_quads(collider_numbers(scene, real))
        self._numbers = np.arange(count, dtype=np.int32)
        self.flow = Flow(self) if self._flows else None
        if self.flow:
            self._numbers = np.append(self._numbers, np.int32(0))  # and the number of active particles
        self.particle = [self.on_device(self._numbers), self.on_device(self._numbers)]
        self.stored_particle = self.on_device(self._numbers)
        self.fluids = self.on_device(self._rows)
        self.sorted = self.on_device(np.zeros(SIZE * max(count, TOGETHER), real))  # kernels load so many at least
        self.corrected, self.before, self.predicted_velocity = (self.new_array() for _ in range(3))
        parts, walls = self.plan.parts, WALL * count
        self.relaxed = tuple(
            self.on_device(np.zeros(size, real))
            for size in (
                count,
                count,
                count if parts & {"drag", "divergence-free"} else 1,
                walls if "walls" in parts else 1,
            )
        )
        self.factors, self.multipliers, self.constraints, self.gradients = self.relaxed
        self.cells = Cells(real, count, self.neighbours, self.most_cells, self.repeats, self.stream, self.flow)

    @property
    def _fluid_of(self) -> np.ndarray:
        """Return (particles,): the number of each particle's fluid."""
        return self.scene.fluid_set.fluid

    @property
    def _rows(self) -> np.ndarray:
        return fluid_rows(self.scene, self.real, self.samples is not None)

    def _make_passes(self) -> Passes:
        """Compile the kernels of the passes of a substep."""
        if "divergence-free" in self.plan.parts:
            return DivergenceFreePasses(self)
        return PositionPasses(self, () if self.kernel == "stages" else fused_passes(self.plan.parts))

    def _build(self) -> None:
        """Compile and load every kernel, by running it once on arrays that `reset` then overwrites."""
        self._tools = make_fluid_tools(self.real, self.scene.dimensions, self.plan.parts & FLOWS)
        passes = self._make_passes()
        if self.kernel == "stages":
            self._executor = Executor(self.plan, passes.stages())
            return
        self._schedule = [passes.schedule(part) for part in self._substep_parts]
        self._executor = Executor(self.plan, {}, self._advance_steps)
        self._warm_up()
        if self.kernel == "graph" and can_capture():
            self._graphs = Graphs(self.stream, self._launch, self._count_on)

    def _warm_up(self) -> None:
        """Run every kernel once."""
        if not simulated():
            self._upload(self.body.position, self.body.velocity)  # at one position all particles would be neighbours
            self._advance_steps(0, 1)
            self.cells.forget()
            if self.flow:
                self.flow.forget()
            cuda.synchronize()

    # ------------------------------------------------------------------ a step

    @property
    def lists(self) -> tuple[Any, Any]:
        """The table of neighbours, and the number of neighbours of each particle."""
        return self.cells.table, self.cells.neighbour_counts

    @property
    def _substep_parts(self) -> tuple[Substep, Substep, Substep]:
        """The passes that are launched before, in and after the iterations that a world drives: all before."""
        return substep_of(self.plan.parts), (), ()

    def _launch_part(self, part: int, iteration: int = 0) -> None:
        """Launch a part of the schedule in the substep that has begun."""
        for run, launched in self._schedule[part]:
            at = replace(self._moment, iteration=iteration + run.iteration, argument=run.argument)
            launched.run(at)

    def begin_substep(self, place: int, substep: int) -> None:
        """Launch the passes before the iterations (SubstepSimulation)."""
        self._moment = Moment(place, substep, substeps=self.scene.method.substeps)
        self._launch_part(0)

    def iterate(self, iteration: int) -> None:
        """Launch an iteration (SubstepSimulation)."""
        self._launch_part(1, iteration)

    def end_substep(self, place: int, substep: int) -> None:
        """Launch the passes after the iterations (SubstepSimulation)."""
        self._launch_part(2)

    @property
    def _launches(self) -> int:
        """Number of launches of a step."""
        begin, iteration, end = (sum(launched.launches for _, launched in part) for part in self._schedule)
        method = self.scene.method
        return method.substeps * (begin + method.iterations * iteration + end)

    # ------------------------------------------------------------------ the contract

    @property
    def contacts_lost(self) -> int:
        """Number of neighbours that did not fit into the lists since the start."""
        return self.cells.lost

    @property
    def speed_limited(self) -> int:
        """Number of times that the speed limit slowed a particle in a substep, since the simulation was opened."""
        return self.cells.slowed

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        numbers = self._numbers
        if self.flow:  # active particles are first
            there = self.scene.fluid_set.there(position)
            order = np.argsort(~there, kind="stable")
            self._weight = self.scene.fluid_set.fluid[order].astype(self.real)
            position, velocity = position[order], velocity[order]
            numbers = np.append(order, there.sum()).astype(np.int32)
            self.flow.upload(there)
        super()._upload(position, velocity)
        self.particle[self._current].copy_to_device(numbers, stream=self.stream)
        self.multipliers.copy_to_device(np.zeros(self.particle_count, self.real), stream=self.stream)
        self.synchronize()

    def _to_host(self, array: DeviceArray) -> np.ndarray:
        """Return (particles, axes) an array in the scene's order."""
        quads, particle = self._quads(array), self.particle[self._current].copy_to_host(stream=self.stream)
        self.synchronize()
        waiting = PARKED if array is self.position[self._current] else 0.0
        values = np.full((self.particle_count, self.scene.dimensions), waiting, self.real)
        there = self._among(particle)
        values[there] = quads[: len(there), : self.scene.dimensions]
        return values

    def _among(self, particle: np.ndarray) -> np.ndarray:
        """Return the numbers of the active particles from the host's copy of `particle`."""
        return particle[: particle[-1]] if self.flow else particle

    @property
    def not_emitted(self) -> int:
        """Number of particles that a nozzle could not emit as none was inactive, since the simulation was opened."""
        return self.flow.missed if self.flow else 0

    def _multipliers(self) -> np.ndarray:
        """Return (particles,) the multipliers of the last substep [m^2], in the scene's order, for pressures."""
        multipliers, particle = (
            self.multipliers.copy_to_host(stream=self.stream),
            self.particle[self._current].copy_to_host(),
        )
        self.synchronize()
        ordered, there = np.zeros_like(multipliers), self._among(particle)
        ordered[there] = multipliers[: len(there)]
        return ordered

    def _read_position(self, into: Any) -> Any:
        if into is not None and hasattr(into, "__cuda_array_interface__"):
            out, state = cuda.as_cuda_array(into), (self.position[self._current], self.particle[self._current])
            if self.flow:
                self._tools.park[self._flat](self.flow.there, out)
            self._tools.write_position[self._flat](*state, out)
            self.synchronize()
            return into
        return super()._read_position(into)

    def _first_diverged(self) -> int:
        self._bad.copy_to_device(np.full(1, NOTHING_BAD, np.int32), stream=self.stream)
        state = self.position[self._current], self.velocity[self._current], self.particle[self._current]
        self._tools.first_diverged[self._flat](*state, self.real(self._bound), *self._middle(), self._bad)
        bad = self.fetch(self._bad)
        return -1 if bad == NOTHING_BAD else bad

    def _store_snapshot(self) -> None:
        super()._store_snapshot()
        self.stored_particle.copy_to_device(self.particle[self._current], stream=self.stream)
        if self.flow:
            self.flow.store()

    def _restore(self) -> None:
        super()._restore()
        self.particle[self._current].copy_to_device(self.stored_particle, stream=self.stream)
        if self.flow:
            self.flow.restore()

    def _parameters_changed(self) -> None:
        self.fluids.copy_to_device(self._rows.reshape(-1), stream=self.stream)
        if self.flow:
            self.flow.changed()
        super()._parameters_changed()
