"""Bodies of tetrahedra on CPU threads by vertex block descent: free vertices sorted by colour, each with its
tetrahedra.

A. H. Chen et al., "Vertex Block Descent", ACM TOG 43 (2024), algorithm 1, without acceleration. Start and end of a
substep are a mesh's (position_based/mesh_kernels.py). Kernels: `fused`, many steps in one call, and `stages`. In `exact` math
both give the same bits, for any number of threads.
"""

from __future__ import annotations

from functools import cached_property
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.contact.surfaces import SurfaceContacts
from softlab.cpu_backend.core.steps import Steps
from softlab.cpu_backend.position_based.mesh_kernels import World, make_mesh_stages
from softlab.cpu_backend.tetrahedra.descent_acceleration import make_accelerate_stage
from softlab.cpu_backend.tetrahedra.descent_contact import CarriedContacts
from softlab.cpu_backend.tetrahedra.descent_kernels import (
    DescentArrays,
    descent_arrays,
    make_descent_advance,
    make_descent_stages,
)
from softlab.cpu_backend.tetrahedra.solver import Tetrahedra
from softlab.model.core.plan import Executor, Moment, Plan, StageRun
from softlab.model.formulas.elastic.chebyshev import weights
from softlab.model.particles.constraints import ConstraintSet, Projection
from softlab.model.position_based.mesh_plan import PREDICT
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra import descent as vbd
from softlab.model.tetrahedra.constraints import DAMPED
from softlab.model.tetrahedra.descent import Descent, descents, stage_name, vbd_plan, visited
from softlab.model.tetrahedra.newton import holding
from softlab.model.tetrahedra.springs import springs


class VertexBlockDescent(Tetrahedra):
    """Vertex block descent; model/core/simulation.py defines the contract. `threads`: `1x`, `2x`, `4x` or a number."""

    def _plan_of(self, scene: Scene, live: frozenset[str]) -> Plan:
        return vbd_plan(scene, live)

    def _constraints(self) -> tuple[list[ConstraintSet], tuple[Projection, ...]]:
        return [], ()

    @property
    def _damped(self) -> bool:
        return DAMPED in self.plan.parts

    @cached_property
    def _descents(self) -> tuple[DescentArrays, ...]:
        spring_set = springs(self.scene.tetrahedra_set, "vbd")
        return tuple(descent_arrays(descent, self.real, self._damped, spring_set) for descent in descents(self.scene))

    @cached_property
    def _holds(self) -> np.ndarray:
        """Stiffness that holds each particle, (particles, 1) [N/m], which sets that of colliders."""
        return holding(self.scene.tetrahedra_set).astype(self.real)[:, None]

    @cached_property
    def _iterates(self) -> np.ndarray:
        """Positions after the last two sweeps."""
        return np.zeros((2, *self._position.shape), self.real)

    @cached_property
    def _weights(self) -> np.ndarray:
        method = self.scene.method
        return weights(method.chebyshev, method.iterations, self.real)

    @cached_property
    def _inertial(self) -> np.ndarray:
        """Positions of vertices by inertia and all forces except elastic ones."""
        return np.zeros_like(self._position)

    @cached_property
    def contacts(self) -> SurfaceContacts | None:
        """Contacts between bodies, or None."""
        if self.scene.contact is None:
            return None
        return CarriedContacts(
            self.scene, self.real, self.options.math, self._bands, self._position[:, 3], self._inertial
        )

    @property
    def inertial(self) -> np.ndarray:
        """Inertial positions (ParticlesSimulation)."""
        return self._inertial.reshape(-1)

    def _advance(self, step: int, steps: int) -> None:
        if self.contacts is not None:
            self._passes.run(step, steps)
            return
        method, numbers = self.scene.method, tuple(descent.number for descent in descents(self.scene))
        make_descent_advance(*self._variant(), numbers, self._damped)(
            self._bands, Steps(steps, step, method.substeps, method.iterations),
            (self._position, self._velocity, self._before, self._inertial), self._descents, self._holds,
            World(self.parameters, self.integers, self._wind, self.bodies, self.kinds, self.driven),
            (self._iterates, self._weights),
        )  # fmt: skip

    @cached_property
    def _passes(self) -> Executor:
        """Executor of a step, stage by stage."""
        return Executor(self.plan, self._stages())

    def _stages(self) -> dict[str, StageRun]:
        stages, stage, bands = super()._stages(), make_mesh_stages(*self._variant()), self._bands
        position, velocity, before, inertial = self._position, self._velocity, self._before, self._inertial

        def predict(moment: Moment) -> None:
            inertial[...] = position
            arguments = inertial, velocity, before, self.parameters, self.integers, self._wind
            stage.predict(bands, moment.step, moment.number, *arguments)

        stages[PREDICT] = predict
        accelerate = make_accelerate_stage(self.real, self.options.math)
        stages[vbd.ACCELERATE] = lambda moment: accelerate(
            bands, position, self._iterates, self._weights[moment.iteration]
        )
        for one, arrays in zip(descents(self.scene), self._descents, strict=True):
            stages |= self._of_material(one, arrays)
        return stages

    def _visits_of(self, one: Descent) -> SimpleNamespace:
        parts = visited(self.plan.parts)
        stages: SimpleNamespace = make_descent_stages(self.real, self.options.math, one.number, self._damped, parts)
        return stages

    def _of_material(self, one: Descent, arrays: DescentArrays) -> dict[str, StageRun]:
        """Return the functions of a material's stages of the plan."""
        stage, bands = self._visits_of(one), self._bands
        position, velocity, before, inertial = self._position, self._velocity, self._before, self._inertial

        def descend(first: int, last: int) -> StageRun:
            return lambda moment: stage.descend(
                bands, first, last, position, inertial, arrays, self.parameters,
                (moment.number, before, self._holds, self.bodies, self.kinds),
            )  # fmt: skip

        def start(moment: Moment) -> None:
            stage.start(bands, 0, one.free, before, velocity, inertial, position, arrays, self.parameters)

        stages: dict[str, StageRun] = {stage_name(vbd.START, one.material): start}
        if self._damped:
            many = len(one.corners)
            stages[stage_name(vbd.STRAIN, one.material)] = lambda moment: stage.remember(bands, 0, many, before, arrays)
        bounds = one.starts.tolist()
        for colour in range(one.colours):
            stages[stage_name(vbd.DESCEND, one.material, colour)] = descend(*bounds[colour : colour + 2])
        return stages
