"""Position-based dynamics (XPBD, PBD) of a triangle mesh on CPU threads, constraints in index arrays sorted by colour.

M. Macklin et al., "XPBD", MIG 2016, algorithm 1, in substeps. Kernels: `fused`, many steps in one call with one
parallel loop per colour, and `stages`, each of those loops separately. In `exact` math both give the same bits, for any
number of threads.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.cpu_backend.core.constraints import make_constraint_stage, no_sets, set_arrays
from softlab.cpu_backend.core.simulation import QuadsSimulation, chosen_kernel
from softlab.cpu_backend.core.steps import Steps
from softlab.cpu_backend.position_based.mesh_kernels import ALWAYS, World, make_mesh_advance, make_mesh_stages
from softlab.model.core.plan import Executor, Moment, Plan, StageRun
from softlab.model.core.simulation import Options
from softlab.model.geometry.tables import wind_lists
from softlab.model.geometry.topology import mesh_of
from softlab.model.particles.constraints import ConstraintSet, Projection
from softlab.model.position_based import mesh_plan
from softlab.model.position_based.mesh_constraints import attachment_set, constraint_sets, projections_of
from softlab.model.position_based.mesh_plan import RELEASE, TOUCH, TOUCHING, stage_name, xpbd_mesh_plan
from softlab.model.scene.scene import Scene


def choose_kernel(wanted: str | None, what: str = "a mesh") -> str:
    """Return the kernel `wanted`, or `fused`. Raises SceneError for any other."""
    return chosen_kernel(wanted, what)


class MeshPositionBased(QuadsSimulation):
    """A position-based mesh; model/core/simulation.py defines the contract. `threads`: `1x`, `2x`, `4x` or a number.

    Subclasses with other constrained particles override `_plan_of`, `_constraints` and `_wind_lists`.
    """

    what = "a mesh"

    def __init__(self, scene: Scene, options: Options, threads: str | int = "1x"):
        super().__init__(scene, options, threads)
        self.kernel, self.plan = choose_kernel(options.kernel, self.what), self._plan_of(scene, options.live)
        real, self.integers = self.real, self._seeds()
        self._set_driven()
        self._allocate(len(self.body.position))
        self._wind = self._wind_lists("wind" in self.plan.parts)
        self._sets, self._projections = self._constraints()
        self._set_arrays = tuple(set_arrays(*both, real) for both in zip(self._sets, self._projections, strict=True))
        touching = len(self._position) if TOUCHING in self.plan.parts else 0
        self._pushes = np.zeros((touching, 3), real)  # m, by colliders within a substep
        staged = self.kernel == "stages"
        self._executor = Executor(self.plan, self._stages() if staged else {}, None if staged else self._advance)
        self.reset()

    def _plan_of(self, scene: Scene, live: frozenset[str]) -> Plan:
        return xpbd_mesh_plan(scene, live)

    def _constraints(self) -> tuple[list[ConstraintSet], tuple[Projection, ...]]:
        """Return the sets in the order in which they are projected, and the projection of each."""
        sets = list(constraint_sets(self.scene))
        if "attachments" in self.plan.parts:
            sets.append(attachment_set(self.scene, self.body))
        return sets, projections_of(self.plan.parts)

    def _wind_lists(self, wanted: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return `wind_lists` of the mesh."""
        assert self.scene.mesh is not None
        return wind_lists(mesh_of(self.scene.mesh), wanted)

    def _variant(self) -> tuple[Any, str, frozenset[str]]:
        return self.real, self.options.math, self.plan.parts - ALWAYS  # so that fewer variants are compiled

    def _advance(self, step: int, steps: int) -> None:
        method = self.scene.method
        make_mesh_advance(*self._variant(), self._projections)(
            self._bands, Steps(steps, step, method.substeps, method.iterations), self._position, self._velocity,
            self._before, self._set_arrays or no_sets(self.real),
            World(self.parameters, self.integers, self._wind, self.bodies, self.kinds, self.driven), self._pushes,
        )  # fmt: skip

    def _stages(self) -> dict[str, StageRun]:
        """Return the function of each stage of the plan."""
        stage, bands = make_mesh_stages(*self._variant()), self._bands
        position, velocity, before = self._position, self._velocity, self._before

        def predict(moment: Moment) -> None:
            arguments = position, velocity, before, self.parameters, self.integers, self._wind
            stage.predict(bands, moment.step, moment.number, *arguments)

        def project(place: int, colour: int) -> StageRun:
            corners, values, multipliers, starts = self._set_arrays[place]
            kernel = make_constraint_stage(self.real, self.options.math, self._projections[place], in_planes=False)
            ends, constraints = (int(starts[colour]), int(starts[colour + 1])), (corners, values, multipliers)

            def run(moment: Moment) -> None:
                kernel(bands, ends, position, position, before, constraints, moment.fresh, self.parameters)

            return run

        def collide(moment: Moment) -> None:
            stage.collide(bands, moment.number, before, position, velocity, self.parameters, self.bodies, self.kinds)

        def touch(moment: Moment) -> None:
            arguments = before, position, self._pushes, self.parameters, self.bodies, self.kinds
            stage.touch(bands, moment.number, moment.fresh, *arguments)

        stages: dict[str, StageRun] = {
            mesh_plan.PREDICT: predict,
            TOUCH: touch,
            RELEASE: lambda moment: stage.release(bands, position, self._pushes),
            mesh_plan.UPDATE: lambda moment: stage.update(bands, before, position, velocity, self.parameters),
            mesh_plan.COLLIDE: collide,
            mesh_plan.PINS.name: lambda moment: stage.pins(
                bands, moment.number, position, velocity, self.parameters, self.bodies, self.driven
            ),
        }
        for place, one in enumerate(self._sets):
            for colour in range(one.colours):
                stages[stage_name(one.kind, one.model, colour)] = project(place, colour)
        return stages
