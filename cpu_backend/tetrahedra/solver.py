"""Bodies of tetrahedra on CPU threads, position-based: two constraints per tetrahedron, sorted by colour.

M. Macklin et al., "XPBD", MIG 2016, algorithm 1; M. Macklin et al., "Small Steps in Physics Simulation", SCA 2019. The
loops are a mesh's (position_based/mesh.py); model/formulas/constraints/tetrahedron.py has the formulas. With surface contacts
a step is one call per pass: contacts are searched and projected between them.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from softlab.cpu_backend.contact.surfaces import SurfaceContacts
from softlab.cpu_backend.core.constraints import make_sweep_stage
from softlab.cpu_backend.position_based.mesh import MeshPositionBased
from softlab.cpu_backend.position_based.mesh_kernels import make_mesh_stages
from softlab.cpu_backend.tetrahedra.sleep import make_sleep_stages
from softlab.model.core.plan import Executor, Moment, Plan, StageRun
from softlab.model.particles.constraints import ConstraintSet, Projection
from softlab.model.particles.tetrahedra.topology import neighbours
from softlab.model.position_based.mesh_plan import TOUCHING
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.constraints import SLEEP, SLEEPING, constraint_sets, projections_of, tetrahedra_plan
from softlab.model.tetrahedra.tables import cloth_lists


class Tetrahedra(MeshPositionBased):
    """Position-based tetrahedra; model/core/simulation.py defines the contract. `threads`: `1x`, `2x`, `4x` or a
    number."""

    what = "tetrahedral bodies"

    def _plan_of(self, scene: Scene, live: frozenset[str]) -> Plan:
        return tetrahedra_plan(scene, live)

    def _allocate(self, max_bands: int) -> None:
        super()._allocate(max_bands)
        self._velocity[:, 3] = self.scene.tetrahedra_set.damping_rates

    def _constraints(self) -> tuple[list[ConstraintSet], tuple[Projection, ...]]:
        return list(constraint_sets(self.scene)), projections_of(self.plan.parts)

    def _wind_lists(self, wanted: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return cloth_lists(self.scene.tetrahedra_set, wanted)

    @cached_property
    def contacts(self) -> SurfaceContacts | None:
        """Contacts between bodies, or None."""
        if self.scene.contact is None:
            return None
        return self._contacts_of(self.scene, self.real, self.options.math, self._bands, self._position[:, 3])

    def _contacts_of(self, *arguments: Any) -> SurfaceContacts:
        return SurfaceContacts(*arguments)

    def _parameters_changed(self) -> None:
        super()._parameters_changed()
        if contacts := self.__dict__.get("contacts"):  # only if they exist already
            contacts.change(self.scene)

    def _stages(self) -> dict[str, StageRun]:
        stages, contacts = super()._stages(), self.contacts
        if contacts is not None:
            position, before = self._position, self._before
            stages["find contacts"] = lambda moment: contacts.find(before, position)
            stages["project contacts"] = lambda moment: contacts.project(before, position)
        if SLEEPING in self.plan.parts:
            stages[SLEEP] = self._sleep()
        return stages

    def _sleep(self) -> StageRun:
        """Return the stage that keeps vertices slower than `sleeping_speed` at their positions."""
        stage, tetrahedra_set, bands = (
            make_sleep_stages(self.real, self.options.math), self.scene.tetrahedra_set, self._bands
        )  # fmt: skip
        near = neighbours(tetrahedra_set.tetrahedra, tetrahedra_set.particle_count)
        slow, speed = np.zeros(tetrahedra_set.particle_count, np.int32), self.real(self.scene.method.sleeping_speed)

        def run(moment: Moment) -> None:
            stage.find_slow(bands, self._velocity, self._earlier, slow, speed, self.parameters)
            stage.restore_resting(
                bands, self._before, self._position, self._velocity, self._earlier, slow, near.offsets, near.indices
            )

        return run

    @cached_property
    def _staged(self) -> Executor:
        """Return the executor of a step stage by stage."""
        return Executor(self.plan, self._stages())

    @cached_property
    def _earlier(self) -> np.ndarray:
        """Velocities at the end of the last substep, (particles, 3) [m/s]."""
        return np.zeros((self.scene.tetrahedra_set.particle_count, 3), self.real)

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Upload the state; its velocities become the earlier ones."""
        super()._upload(position, velocity)
        if SLEEPING in self.plan.parts:
            self._earlier[...] = self._velocity[:, :3]

    def take_particles(self, places: np.ndarray, state: np.ndarray) -> None:
        """Replace particles; their velocities become the earlier ones, as a substep has just ended."""
        super().take_particles(places, state)
        if SLEEPING in self.plan.parts:
            self._earlier[places] = state[1]

    def _advance(self, step: int, steps: int) -> None:
        contacts, method, bands = self.contacts, self.scene.method, self._bands
        if SLEEPING in self.plan.parts:
            self._staged.run(step, steps)
            return
        if contacts is None:
            super()._advance(step, steps)
            return
        stage = make_mesh_stages(*self._variant())
        sweep = make_sweep_stage(self.real, self.options.math, self._projections)
        position, velocity, before, parameters = self._position, self._velocity, self._before, self.parameters
        driven, touching = "motion" in self.plan.parts, TOUCHING in self.plan.parts
        for number in range(step * method.substeps, (step + steps) * method.substeps):
            now, lists = number // method.substeps, self._wind
            stage.predict(bands, now, number, position, velocity, before, parameters, self.integers, lists)
            if driven:
                stage.pins(bands, number, position, velocity, parameters, self.bodies, self.driven)
            contacts.find(before, position)
            for iteration in range(method.iterations):
                if touching:
                    given = before, position, self._pushes, parameters, self.bodies, self.kinds
                    stage.touch(bands, number, iteration == 0, *given)
                sweep(bands, position, position, before, self._set_arrays, iteration == 0, parameters)
                contacts.project(before, position)
            if touching:
                stage.release(bands, position, self._pushes)
            stage.update(bands, before, position, velocity, parameters)
            if self.scene.colliders:
                stage.collide(bands, number, before, position, velocity, parameters, self.bodies, self.kinds)
            if driven:
                stage.pins(bands, number, position, velocity, parameters, self.bodies, self.driven)
