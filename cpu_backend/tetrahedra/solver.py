"""Bodies of tetrahedra on CPU threads, position-based: two constraints per tetrahedron, sorted by colour.

M. Macklin et al., "XPBD", MIG 2016, algorithm 1; M. Macklin et al., "Small Steps in Physics Simulation", SCA 2019. The
loops are a mesh's (position_based/mesh.py); model/formulas/constraints/tetrahedron.py has the formulas. With surface contacts
a step is one call per pass: contacts are searched and projected between them.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from softlab.cpu_backend.contact.surfaces import SurfaceContacts
from softlab.cpu_backend.core.constraints import make_sweep_stage
from softlab.cpu_backend.position_based.mesh import MeshPositionBased
from softlab.cpu_backend.tetrahedra.sleep import make_sleep_stages
from softlab.model.core.plan import Executor, Moment, Node, Plan, Stage, StageRun
from softlab.model.particles.constraints import ConstraintSet, Projection
from softlab.model.particles.tetrahedra.topology import neighbours
from softlab.model.position_based.mesh_plan import FIND_CONTACTS, PROJECT_CONTACTS, TOUCH
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.constraints import SLEEP, SLEEPING, constraint_sets, projections_of, tetrahedra_plan
from softlab.model.tetrahedra.tables import cloth_lists

SWEEP = "sweep"  # a stage: all colours of an iteration


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
        return SurfaceContacts(self.scene, self.real, self.options.math, self._bands, self._position[:, 3])

    def _parameters_changed(self) -> None:
        super()._parameters_changed()
        if contacts := self.__dict__.get("contacts"):  # only if they exist already
            contacts.change(self.scene)

    def _stages(self) -> dict[str, StageRun]:
        stages, contacts = super()._stages(), self.contacts
        if contacts is not None:
            position, before = self._position, self._before
            stages[FIND_CONTACTS] = lambda moment: contacts.find(before, position)
            stages[PROJECT_CONTACTS] = lambda moment: contacts.project(before, position)
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
    def _passes(self) -> Executor:
        """Executor of a step, pass by pass; the colours of an iteration are one."""
        begin, iteration, end = self.plan.substep_parts
        touch, project = ([stage for stage in iteration if stage.name == name] for name in (TOUCH, PROJECT_CONTACTS))
        sweep, method = make_sweep_stage(self.real, self.options.math, self._projections), self.scene.method

        def run(moment: Moment) -> None:
            position, before, bands = self._position, self._before, self._bands
            sweep(bands, position, position, before, self._set_arrays, moment.fresh, self.parameters)

        passes = Node("iteration", (*touch, Stage(SWEEP, 0, 0, 0), *project), method.iterations)
        root = Node("step", (Node("substep", (*begin, passes, *end), method.substeps),))
        return Executor(replace(self.plan, root=root), self._stages() | {SWEEP: run})

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
        if self.contacts is None and SLEEPING not in self.plan.parts:
            super()._advance(step, steps)
        else:
            self._passes.run(step, steps)
