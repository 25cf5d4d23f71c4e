"""Bodies of tetrahedra on CUDA by vertex block descent: one thread per vertex of a colour, one launch per colour.

A. H. Chen et al., "Vertex Block Descent", ACM TOG 43 (2024), algorithm 1, without acceleration. Start and end of a
substep, and the capture of launches, are a mesh's (position_based/mesh.py). In `exact` math all kernels give the same bits
as the CPU.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from softlab.gpu_backend.contact.surfaces import SurfaceContacts
from softlab.gpu_backend.core.compile import Kernel
from softlab.gpu_backend.core.device import Arguments, DeviceArray
from softlab.gpu_backend.core.quads import SIZE, pack
from softlab.gpu_backend.core.substeps import launched_kernel
from softlab.gpu_backend.position_based.mesh import THREADS
from softlab.gpu_backend.tetrahedra.descent_contact import CarriedContacts
from softlab.gpu_backend.tetrahedra.descent_kernels import DescentArrays, make_accelerate, make_visits
from softlab.gpu_backend.tetrahedra.solver import Tetrahedra
from softlab.model.core.plan import Moment, Plan, StageRun
from softlab.model.formulas.elastic.chebyshev import weights
from softlab.model.formulas.elastic.descent import STRAINS
from softlab.model.particles.constraints import ConstraintSet, Projection
from softlab.model.position_based.mesh_plan import FIND_CONTACTS, PINS, PREDICT, PROJECT_CONTACTS
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra import descent as vbd
from softlab.model.tetrahedra.constraints import DAMPED
from softlab.model.tetrahedra.descent import CHEBYSHEV, Descent, descents, stage_name, vbd_plan, visited
from softlab.model.tetrahedra.newton import holding
from softlab.model.tetrahedra.springs import SpringArrays, springs


class Substep(NamedTuple):
    """Arguments of a substep's launches: positions and velocities at its start, positions that are iterated, velocities
    at its end (quads); arguments of `clock`; number of the iteration."""

    before: DeviceArray
    velocity: DeviceArray
    position: DeviceArray
    new_velocity: DeviceArray
    time: Arguments
    iteration: int = 0


Launch = Callable[[Substep], None]


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

    def _contacts(self) -> SurfaceContacts | None:
        if self.scene.contact is None:
            return None
        return CarriedContacts(self.scene, self.real, self.options.math, self._weight, self.stream, self._inertial)

    def _build(self) -> None:
        """Bind the stages before the end of a substep, by name, and compile all."""
        method, size = self.scene.method, 2 * SIZE * self.particle_count
        self._accelerate = make_accelerate(self.real, self.options.math)
        self._iterates = self.on_device(np.zeros(size if CHEBYSHEV in self.plan.parts else 0, self.real))
        self._weights = weights(method.chebyshev, method.iterations, self.real)
        self._launch_of: dict[str, Launch] = {
            PREDICT: self._predict,
            PINS.name: self._move_pins,
            FIND_CONTACTS: self._find,
            PROJECT_CONTACTS: self._project,
            vbd.ACCELERATE: self._extrapolate,
        }
        holds = self.on_device(holding(self.scene.tetrahedra_set).astype(self.real))
        spring_arrays = SpringArrays._make(
            map(self.on_device, springs(self.scene.tetrahedra_set, "vbd").arrays(self.real))
        )
        for descent in descents(self.scene):
            self._bind(descent, spring_arrays, holds)
        super()._build()

    def _bind(self, descent: Descent, spring_arrays: SpringArrays, holds: DeviceArray) -> None:
        """Bind the stages of a material."""
        damped, put, count = DAMPED in self.plan.parts, self.on_device, len(descent.corners)
        kernels = make_visits(self.real, self.options.math, descent.number, damped, visited(self.plan.parts))
        values, strains = pack(descent.values.astype(self.real)), np.zeros(STRAINS * count * damped, self.real)
        lists = (descent.order, descent.offsets, descent.entries, descent.falls, pack(descent.corners), values, strains)
        arrays = DescentArrays._make([*map(put, lists), spring_arrays, holds, np.int32(count)])
        launch_of, material, vertices = self._launch_of, descent.material, np.int32(len(descent.order))
        if damped:
            launch_of[stage_name(vbd.STRAIN, material)] = partial(self._remember, kernels.remember, arrays)
        launch_of[stage_name(vbd.START, material)] = partial(self._start_sweeps, kernels.start, arrays, vertices)
        for colour, (first, stop) in enumerate(pairwise(map(np.int32, descent.starts))):
            visit = partial(self._descend, kernels.descend, arrays, first, stop)
            launch_of[stage_name(vbd.DESCEND, material, colour)] = visit

    # ------------------------------------------------------------------ stages

    def _predict(self, at: Substep) -> None:
        self._brake(at.velocity)
        self._begin[self._flat](
            at.before, at.velocity, self._inertial, *self._lists, self.record, self.integers, *at.time
        )

    def _remember(self, kernel: Kernel, arrays: DescentArrays, at: Substep) -> None:
        kernel[self._over(int(arrays.number), THREADS)](at.before, arrays)

    def _start_sweeps(self, kernel: Kernel, arrays: DescentArrays, vertices: np.int32, at: Substep) -> None:
        kernel[self._over(int(vertices), THREADS)](
            at.before, at.velocity, self._inertial, at.position, arrays, vertices, self.record
        )

    def _descend(self, kernel: Kernel, arrays: DescentArrays, first: np.int32, stop: np.int32, at: Substep) -> None:
        kernel[self._over(int(stop - first), THREADS)](
            at.before, self._inertial, at.position, arrays, first, stop, self.record, self.bodies, self.integers, at.time
        )  # fmt: skip

    def _extrapolate(self, at: Substep) -> None:
        self._accelerate[self._flat](at.position, self._iterates, self._weights[at.iteration])

    def _move_pins(self, at: Substep) -> None:
        self._drive(at.position, at.new_velocity, at.time)

    def _find(self, at: Substep) -> None:
        self.contacts.find(at.before, at.position)

    def _project(self, at: Substep) -> None:
        self.contacts.project(at.before, at.position)

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
        self._substep_now = Substep(before, velocity, now, new_velocity, self._when(place, substep))
        for stage in self.plan.substep_parts[0]:
            self._launch_of[stage.name](self._substep_now)

    def iterate(self, iteration: int) -> None:
        """Launch an iteration (SubstepSimulation)."""
        for stage in self.plan.substep_parts[1]:
            self._launch_of[stage.name](self._substep_now._replace(iteration=iteration))

    def _stages(self) -> dict[str, StageRun]:
        position, velocity, before = self.position[0], self.velocity[0], self.position[1]

        def at(moment: Moment) -> Substep:
            time = self._counter, np.int64(0), np.int64(moment.substeps), np.int64(moment.substep)
            return Substep(before, velocity, position, velocity, time, moment.iteration)

        def bound(launch: Launch) -> StageRun:
            return lambda moment: launch(at(moment))

        def predict(moment: Moment) -> None:
            before.copy_to_device(position, stream=self.stream)
            self._set_counter(moment.step)
            self._predict(at(moment))

        stages = {name: bound(launch) for name, launch in self._launch_of.items()}
        return super()._stages() | stages | {PREDICT: predict}
