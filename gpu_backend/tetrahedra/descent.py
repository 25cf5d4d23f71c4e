"""Bodies of tetrahedra on CUDA by vertex block descent: one thread per vertex of a colour, one launch per colour.

A. H. Chen et al., "Vertex Block Descent", ACM TOG 43 (2024), algorithm 1, without acceleration. Start and end of a
substep, and the capture of launches, are a mesh's (position_based/mesh.py). In `exact` math all kernels give the same bits
as the CPU.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from softlab.gpu_backend.contact.surfaces import SurfaceContacts
from softlab.gpu_backend.core.device import Arguments, DeviceArray
from softlab.gpu_backend.core.quads import SIZE, pack
from softlab.gpu_backend.core.substeps import launched_kernel
from softlab.gpu_backend.position_based.mesh import THREADS
from softlab.gpu_backend.tetrahedra.descent_contact import CarriedContacts
from softlab.gpu_backend.tetrahedra.descent_kernels import make_accelerate, make_visits
from softlab.gpu_backend.tetrahedra.solver import Tetrahedra
from softlab.model.core.plan import Moment, Plan, StageRun
from softlab.model.formulas.elastic.chebyshev import weights
from softlab.model.formulas.elastic.descent import STRAINS
from softlab.model.particles.constraints import ConstraintSet, Projection
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.constraints import DAMPED
from softlab.model.tetrahedra.descent import ACCELERATE, CHEBYSHEV, Descent, descents, stage_name, vbd_plan, visited
from softlab.model.tetrahedra.newton import holding
from softlab.model.tetrahedra.springs import springs

Launch = Callable[[Any, Any, Any, Any], None]  # (before, velocity, position: quads; time: see _drive)


class VertexBlockDescent(Tetrahedra):
    """Vertex block descent on CUDA; model/core/simulation.py defines the contract. `threads`: threads per block."""

    def _plan_of(self, scene: Scene, live: frozenset[str]) -> Plan:
        return vbd_plan(scene, live)

    def _choose_kernel(self, wanted: str | None) -> str:
        return launched_kernel(wanted, self.what)

    def _constraints(self) -> tuple[list[ConstraintSet], tuple[Projection, ...]]:
        return [], ()

    def _require_space(self) -> None:
        item = np.dtype(self.real).itemsize
        needed = (10 if self.scene.contact else 9) * SIZE * self.particle_count * item
        for descent in descents(self.scene):
            needed += (
                descent.corners.nbytes + descent.entries.nbytes + descent.offsets.nbytes + 2 * descent.order.nbytes
            )
            needed += (descent.values.size + STRAINS * len(descent.corners)) * item
        self._require_memory(needed, self.named, f"{self.particle_count} vertices")

    def _allocate(self) -> None:
        self._inertial = self.new_array()  # positions by inertia and all forces except elastic ones
        super()._allocate()

    def _contacts_of(self, *arguments: Any) -> SurfaceContacts:
        return CarriedContacts(*arguments, inertial=self._inertial)

    def _build(self) -> None:
        self._first: list[tuple[str, Launch]] = []  # stages of a substep before its iterations
        self._visits: list[tuple[str, Launch]] = []
        spring_set = springs(self.scene.tetrahedra_set, "vbd").arrays(self.real)
        method, size = self.scene.method, 2 * SIZE * self.particle_count
        self._accelerate = make_accelerate(self.real, self.options.math)
        self._iterates = self.on_device(np.zeros(size, self.real)) if CHEBYSHEV in self.plan.parts else None
        self._weights = weights(method.chebyshev, method.iterations, self.real)
        self._holds = self.on_device(holding(self.scene.tetrahedra_set).astype(self.real))
        self._springs = tuple(
            self.on_device(one if one.size else np.zeros(1, one.dtype)) for one in map(np.ravel, spring_set)
        )
        for descent in descents(self.scene):
            self._bind(descent)
        super()._build()

    def _bind(self, descent: Descent) -> None:
        """Insert the stages of a material into the stages of a step."""
        damped, real, count = DAMPED in self.plan.parts, self.real, np.int32(len(descent.corners))
        kernels = make_visits(real, self.options.math, descent.number, damped, visited(self.plan.parts))
        corners, values = self.on_device(pack(descent.corners)), self.on_device(pack(descent.values.astype(real)))
        order, offsets, entries = map(self.on_device, (descent.order, descent.offsets, descent.entries))
        strains = self.on_device(np.zeros(STRAINS * len(descent.corners) if damped else 1, real))
        all_of, every = self._over(len(descent.corners), THREADS), np.int32(len(descent.order))
        each, falls = self._over(len(descent.order), THREADS), self.on_device(descent.falls)

        def remember(before: DeviceArray, velocity: DeviceArray, position: DeviceArray, time: Any) -> None:
            kernels.remember[all_of](before, corners, values, strains, count)

        def start(before: DeviceArray, velocity: DeviceArray, position: DeviceArray, time: Any) -> None:
            kernels.start[each](before, velocity, self._inertial, position, order, falls, every, self.record)

        def descend(first: int, stop: int) -> Launch:
            launch, bounds = self._over(stop - first, THREADS), (np.int32(first), np.int32(stop), count)
            return lambda before, velocity, position, time: kernels.descend[launch](
                position,
                self._inertial,
                order,
                offsets,
                entries,
                corners,
                values,
                strains,
                *self._springs,
                before,
                self._holds,
                *bounds,
                self.record,
                self.bodies,
                self.integers,
                *time,
            )

        if damped:
            self._first.append((stage_name("strain", descent.material), remember))
        self._first.append((stage_name("start", descent.material), start))
        bounds = descent.starts.tolist()
        for colour in range(descent.colours):
            name = stage_name("descend", descent.material, colour)
            self._visits.append((name, descend(*bounds[colour : colour + 2])))

    # ------------------------------------------------------------------ a step

    @property
    def inertial(self) -> Any:
        """Inertial positions (SubstepSimulation)."""
        return self._inertial

    def begin_substep(self, place: int, substep: int) -> None:
        """Launch the stages before the iterations (SubstepSimulation)."""
        before, velocity = self.position[self._current], self.velocity[self._current]
        self._current = 1 - self._current
        now, new_velocity = self.position[self._current], self.velocity[self._current]
        self._substep_time = time = self._when(place, substep)
        self._brake(velocity)
        self._begin[self._flat](before, velocity, self._inertial, *self._lists, self.record, self.integers, *time)
        for _, launch in self._first:
            launch(before, velocity, now, time)
        self._drive(now, new_velocity, time)
        if self.contacts:
            self.contacts.find(before, now)

    def iterate(self, iteration: int) -> None:
        """Launch an iteration (SubstepSimulation)."""
        before, now = self.substep_start, self.position[self._current]
        for _, launch in self._visits:
            launch(before, self.velocity[1 - self._current], now, self._substep_time)
        self._go_on(now, iteration)
        if self.contacts:
            self.contacts.project(before, now)

    def _go_on(self, position: DeviceArray, iteration: int) -> None:
        """Launch the acceleration of sweeps, if the plan has it."""
        if self._iterates is not None:
            self._accelerate[self._flat](position, self._iterates, self._weights[iteration])

    @property
    def _launches(self) -> int:
        method = self.scene.method
        more = 2 * (self._pins is not None) + (self._slow is not None)
        find, project = (self.contacts.finding, self.contacts.projecting) if self.contacts else (0, 0)
        more += len(self._first) + find
        return method.substeps * (
            2 + more + method.iterations * (len(self._visits) + project + (self._iterates is not None))
        )

    def _time(self, moment: Moment) -> Arguments:
        return self._counter, np.int64(0), np.int64(moment.substeps), np.int64(moment.substep)

    def _stages(self) -> dict[str, StageRun]:
        position, velocity, before = self.position[0], self.velocity[0], self.position[1]

        def predict(moment: Moment) -> None:
            before.copy_to_device(position, stream=self.stream)
            self._set_counter(moment.step)
            time = self._time(moment)
            self._brake(velocity)
            self._begin[self._flat](before, velocity, self._inertial, *self._lists, self.record, self.integers, *time)

        def run(launch: Launch) -> StageRun:
            return lambda moment: launch(before, velocity, position, self._time(moment))

        stages = {name: run(launch) for name, launch in (*self._first, *self._visits)}
        stages[ACCELERATE] = lambda moment: self._go_on(position, moment.iteration)
        return super()._stages() | stages | {"predict": predict}
