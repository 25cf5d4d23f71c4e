"""Bodies of tetrahedra on CUDA, position-based: two constraints per tetrahedron, one thread per tetrahedron of a
colour, or per voxel.

M. Macklin et al., "XPBD", MIG 2016, algorithm 1; M. Macklin et al., "Small Steps in Physics Simulation", SCA 2019.
Launches are a mesh's (position_based/mesh.py); model/formulas/constraints/tetrahedron.py has the formulas. Kernels besides a
mesh's: `resident`, all steps in one launch, of bodies of voxels that fit on the chip (resident.py); `resident:4` in
slabs of 4 layers. In `exact` math all give the same bits as the CPU.
"""

from __future__ import annotations

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.surfaces import SurfaceContacts, surface_contact_bytes
from softlab.gpu_backend.core.device import DeviceArray, simulated
from softlab.gpu_backend.core.substeps import launched_kernel
from softlab.gpu_backend.position_based.mesh import MeshPositionBased
from softlab.gpu_backend.tetrahedra.resident_launch import (
    ResidentSet,
    chosen_slabs,
    default_slabs,
    launched_only,
    layers_of,
)
from softlab.gpu_backend.tetrahedra.sleep import make_sleep
from softlab.model.base.errors import SceneError
from softlab.model.core.plan import Executor, Plan, StageRun
from softlab.model.particles.constraints import ConstraintSet, Projection
from softlab.model.particles.tetrahedra.topology import neighbours
from softlab.model.position_based.mesh_plan import COLLIDE, FIND_CONTACTS, PREDICT, PROJECT_CONTACTS
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.constraints import SLEEP, SLEEPING, constraint_sets, projections_of, tetrahedra_plan
from softlab.model.tetrahedra.tables import cloth_lists, surface_lists


class Tetrahedra(MeshPositionBased):
    """Position-based tetrahedra on CUDA; model/core/simulation.py defines the contract. `threads`: threads per
    block."""

    what, named = "tetrahedral bodies", "tetrahedral_body"
    _residents: tuple[ResidentSet, ...] = ()

    def _plan_of(self, scene: Scene, live: frozenset[str]) -> Plan:
        return tetrahedra_plan(scene, live)

    def _constraints(self) -> tuple[list[ConstraintSet], tuple[Projection, ...]]:
        return list(constraint_sets(self.scene)), projections_of(self.plan.parts)

    def _surface_lists(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return surface_lists(self.scene.tetrahedra_set)

    def _wind_lists(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return cloth_lists(self.scene.tetrahedra_set)

    def _contacts(self) -> SurfaceContacts | None:
        if self.scene.contact is None:
            return None
        return SurfaceContacts(self.scene, self.real, self.options.math, self._weight, self.stream)

    def _require_memory(self, needed: int, field: str, value: str) -> None:
        if self.scene.contact is not None:
            needed += surface_contact_bytes(self.scene, np.dtype(self.real).itemsize)
        super()._require_memory(needed, field, value)

    # ------------------------------------------------------------------ sleeping vertices

    def _allocate(self) -> None:
        super()._allocate()
        if SLEEPING in self.plan.parts:
            method, near = self.scene.method, neighbours(self.scene.tetrahedra_set.tetrahedra, self.particle_count)
            self._sleepers = make_sleep(self.real, self.options.math)
            self._slow_ones, self._earlier = self.on_device(np.zeros(self.particle_count, np.int32)), self.new_array()
            self._near = self.on_device(near.offsets), self.on_device(near.indices)
            self._sleeping_speed = self.real(method.sleeping_speed)

    def _restore_resting(self, before: DeviceArray, position: DeviceArray, velocity: DeviceArray) -> None:
        kernels, slow = self._sleepers, self._slow_ones
        kernels.find_slow[self._flat](velocity, self._earlier, slow, self._sleeping_speed, self.record)
        kernels.restore_resting[self._flat](before, position, velocity, self._earlier, slow, *self._near)

    def end_substep(self, place: int, substep: int) -> None:
        """Launch the stages after the iterations (SubstepSimulation)."""
        super().end_substep(place, substep)
        if SLEEPING in self.plan.parts:
            self._restore_resting(self.substep_start, self.position[self._current], self.velocity[self._current])

    def state_taken(self) -> None:
        """Take the velocities of a replaced state as the earlier ones, as a substep has ended."""
        if SLEEPING in self.plan.parts:
            self._earlier.copy_to_device(self.velocity[self._current], stream=self.stream)

    @property
    def _launches(self) -> int:
        """Number of launches of a step, from its plan: one per stage, with exceptions."""
        launches = {PREDICT: 1 + (self._slow is not None), COLLIDE: 0, SLEEP: 2}  # UPDATE collides, too
        if contacts := self.contacts:
            launches |= {FIND_CONTACTS: contacts.finding, PROJECT_CONTACTS: contacts.projecting}
        return sum(launches.get(stage.name, 1) for stage in self.plan.root.stages())

    def _stages(self) -> dict[str, StageRun]:
        position, velocity, before = self.position[0], self.velocity[0], self.position[1]
        return super()._stages() | {SLEEP: lambda moment: self._restore_resting(before, position, velocity)}

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Upload the state; its velocities become the earlier ones."""
        super()._upload(position, velocity)
        self.state_taken()

    # ------------------------------------------------------------------ the kernel `resident`

    def _choose_kernel(self, wanted: str | None) -> str:
        alone = launched_only(self.scene, self.plan.parts)
        if wanted is not None and wanted.partition(":")[0] == "resident":
            if alone:
                raise SceneError("--kernel", wanted, f"knows no {alone}; use graph")
            self._slabs = chosen_slabs(self.scene, self.real, layers_of(wanted))
            return wanted
        if wanted is None and not alone and not simulated():
            self._slabs = default_slabs(self.scene, self.real)
            if self._slabs:
                return "resident"
        return launched_kernel(wanted, self.what, ("resident",))

    def _build(self) -> None:
        if not self.kernel.startswith("resident"):
            super()._build()
            return
        self._make_tools()
        sets = zip(self._slabs, *self._constraints(), strict=True)
        self._residents = tuple(ResidentSet(self, *one) for one in sets)
        self.threads = max(one.slabs.threads for one in self._residents)
        self._executor = Executor(self.plan, {}, self._advance_resident)
        if not simulated():
            self._advance_resident(0, 1)
            cuda.synchronize()

    def _advance_resident(self, step: int, steps: int) -> None:
        self._set_counter(step)
        for one in self._residents:
            one.launch(steps)
        self._current = 1 - self._current
        self._count_on(steps)

    def _first_diverged(self) -> int:
        for one in self._residents:
            one.require_exchange()
        return super()._first_diverged()
