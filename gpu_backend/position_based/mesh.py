"""Position-based dynamics (XPBD, PBD) of a triangle mesh on CUDA: constraints in index arrays sorted by colour.

M. Macklin et al., "XPBD", MIG 2016, algorithm 1, in substeps. A substep: `begin` predicts positions; `iterations` times
colliders act where the plan says so (touching.py), and every colour of the edges, the hinges, the long-range attachments
is projected by a launch (core/constraints.py); `end` computes velocities and collisions. Kernels: `launch`, and `graph`,
the same captured as a CUDA graph; `stages`, stage by stage. In `exact` math all give the same bits as the CPU.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.pins import make_drive
from softlab.gpu_backend.core.constraints import device_corners, make_projections, places
from softlab.gpu_backend.core.device import Arguments, DeviceArray, Stream, simulated
from softlab.gpu_backend.core.driven import DrivenSimulation
from softlab.gpu_backend.core.forces import forces_of
from softlab.gpu_backend.core.launch import Graphs, can_capture
from softlab.gpu_backend.core.quads import AXES, SIZE, pack
from softlab.gpu_backend.core.sheet import make_cloth_tools, make_mesh_tools
from softlab.gpu_backend.core.substeps import SubstepSimulation, launched_kernel
from softlab.gpu_backend.position_based.kernels import make_end
from softlab.gpu_backend.position_based.mesh_kernels import make_mesh_begin, make_slow
from softlab.gpu_backend.position_based.stages import make_xpbd_stages
from softlab.gpu_backend.position_based.touching import make_touching
from softlab.model.core.plan import Executor, Moment, Plan, StageRun
from softlab.model.core.simulation import Options
from softlab.model.geometry.tables import wind_lists
from softlab.model.geometry.topology import mesh_of
from softlab.model.particles.constraints import ConstraintSet, Projection
from softlab.model.position_based import mesh_plan
from softlab.model.position_based.mesh_constraints import attachment_set, constraint_sets, projections_of
from softlab.model.position_based.mesh_plan import BODY_DAMPING, RELEASE, TOUCH, TOUCHING, stage_name, xpbd_mesh_plan
from softlab.model.scene.scene import Scene

THREADS = 128  # per block: small blocks distribute a colour's few thousand constraints over more processors


class MeshPositionBased(DrivenSimulation, SubstepSimulation):
    """A position-based mesh on CUDA; model/core/simulation.py defines the contract. `threads`: number of threads per
    block.

    Subclasses with other constrained particles override `_plan_of`, `_constraints` and `_surface_lists`.
    """

    what, named = "a mesh", "mesh"

    def __init__(self, scene: Scene, options: Options, stream: Stream | None = None):
        super().__init__(scene, options, stream)
        self.plan = self._plan_of(scene, options.live)
        self.kernel, self.threads = self._choose_kernel(options.kernel), THREADS
        self._require_space()
        self._start(THREADS)

    def _choose_kernel(self, wanted: str | None) -> str:
        """Return the kernel `wanted`, or the fastest. Raises SceneError."""
        return launched_kernel(wanted, self.what)

    def _require_space(self) -> None:
        item = np.dtype(self.real).itemsize
        needed = 8 * SIZE * self.particle_count * item
        for constraint_set in self._constraints()[0]:
            needed += (
                constraint_set.corners.nbytes + (constraint_set.values.size + 3 * len(constraint_set.corners)) * item
            )
        self._require_memory(needed, self.named, f"{self.particle_count} vertices")

    def _plan_of(self, scene: Scene, live: frozenset[str]) -> Plan:
        return xpbd_mesh_plan(scene, live)

    def _constraints(self) -> tuple[list[ConstraintSet], tuple[Projection, ...]]:
        """Return the sets in the order in which they are projected, and the projection of each."""
        sets = list(constraint_sets(self.scene))
        if "attachments" in self.plan.parts:
            sets.append(attachment_set(self.scene, self.body))
        return sets, projections_of(self.plan.parts)

    def _surface_lists(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return `wind_lists` of the surface, for normals."""
        assert self.scene.mesh is not None
        return wind_lists(mesh_of(self.scene.mesh))

    def _wind_lists(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return `wind_lists` of the surface that wind acts on."""
        return self._surface_lists()

    def _contacts(self) -> Any:
        """Return the contacts of surfaces, or None."""
        return None

    # ------------------------------------------------------------------ arrays

    def _allocate(self) -> None:
        scene, real = self.scene, self.real
        self._allocate_driven()
        self.driven = self.on_device(self.body.pinned.astype(np.int32)) if self._first_pin else None
        self._weight = (self.body.inverse_mass * scene.grid.mass).astype(real)
        self._surface = [self.on_device(array) for array in self._surface_lists()]
        self._lists = (
            [self.on_device(array) for array in self._wind_lists()] if "wind" in self.plan.parts else self._surface
        )
        self.contacts = self._contacts()

    # ------------------------------------------------------------------ kernels

    def _build(self) -> None:
        """Compile and load every kernel, by running it once on arrays that `reset` then overwrites."""
        self._make_tools()
        variant, parts = (self.real, self.options.math), forces_of(self.plan.parts)
        self._begin, self._end = make_mesh_begin(*variant, parts), make_end(*variant, parts, AXES)
        self._pins = make_drive(*variant) if self._first_pin else None
        self._slow, self._rates, self._touching = None, None, None
        if TOUCHING in self.plan.parts:
            self._touching, self._pushes = make_touching(*variant, parts), self.new_array()
        if BODY_DAMPING in self.plan.parts:
            self._slow = make_slow(*variant)
            self._rates = self.on_device(self.scene.tetrahedra_set.damping_rates.astype(self.real))
        self._colours: list[tuple[str, Callable[[Any, Any, bool], None]]] = []
        for constraint_set, projection in zip(*self._constraints(), strict=True):
            self._colours += self._projections(constraint_set, projection)
        if self.kernel == "stages":
            self._executor = Executor(self.plan, self._stages())
            return
        self._executor = Executor(self.plan, {}, self._advance_steps)
        if not simulated():
            self._upload(self.body.position, self.body.velocity)  # surfaces at one position would all be in contact
            self._advance_steps(0, 1)
            cuda.synchronize()
        if self.kernel == "graph" and can_capture():
            self._graphs = Graphs(self.stream, self._launch, self._count_on)

    def _make_tools(self) -> None:
        self._tools = SimpleNamespace(**vars(make_cloth_tools(self.real)) | vars(make_mesh_tools(self.real)))

    def _projections(
        self, constraint_set: ConstraintSet, projection: Projection
    ) -> list[tuple[str, Callable[[Any, Any, bool], None]]]:
        """Return (stage, project(before, position, fresh)) of every colour of a set of constraints."""
        kernel, count = make_projections(self.real, self.options.math, projection), len(constraint_set.corners)
        multipliers = self.on_device(np.zeros(max(1, projection.soft * projection.multipliers * count), self.real))
        order, run = places(constraint_set), constraint_set.run
        corners = self.on_device(device_corners(projection, constraint_set.corners[order], constraint_set.starts))
        values = self.on_device(pack(constraint_set.values[order].astype(self.real)))

        def project(start: int, stop: int) -> Callable[[Any, Any, bool], None]:
            launch, bounds = (
                self._over((stop - start) // run, THREADS),
                (np.int32(start), np.int32(stop), np.int32(count)),
            )
            return lambda before, position, fresh: kernel[launch](
                position, before, corners, values, multipliers, *bounds, np.int32(fresh), self.record
            )

        bounds, name = constraint_set.starts.tolist(), (constraint_set.kind, constraint_set.model)
        return [(stage_name(*name, c), project(*bounds[c : c + 2])) for c in range(constraint_set.colours)]

    # ------------------------------------------------------------------ a step

    def _drive(self, position: DeviceArray, velocity: DeviceArray, time: Arguments) -> None:
        """Launch the motion of driven pins to a substep's end, if there are any; `time`: counter, place, substeps,
        substep."""
        if self._pins is not None:
            count = len(self.body.pinned)
            first = np.int32(self._first_pin), np.int32(count)
            self._pins[self._over(count, THREADS)](
                position, velocity, self.record, self.bodies, self.driven, *first, *time
            )

    def _brake(self, velocity: DeviceArray) -> None:
        """Launch the damping of bodies that have a damping rate."""
        if self._slow is not None:
            self._slow[self._flat](velocity, self._rates, self.record)

    def _touch(self, before: DeviceArray, position: DeviceArray, time: Arguments) -> None:
        """Launch the colliders before an iteration."""
        if self._touching is not None:
            self._touching.touch[self._flat](
                before, position, self._pushes, self.record, self.bodies, self.integers, *time
            )

    def _release(self, position: DeviceArray) -> None:
        """Launch the end of colliders within iterations."""
        if self._touching is not None:
            self._touching.release[self._flat](position, self._pushes)

    def _when(self, place: int, substep: int) -> Arguments:
        """Return the time arguments of kernels of a substep."""
        return self._counter, np.int64(place), np.int64(self.scene.method.substeps), np.int64(substep)

    def begin_substep(self, place: int, substep: int) -> None:
        """Launch the stages before the iterations (SubstepSimulation)."""
        before, velocity = self.position[self._current], self.velocity[self._current]
        self._current = 1 - self._current
        now, new_velocity = self.position[self._current], self.velocity[self._current]
        time = self._substep_time = self._when(place, substep)
        self._brake(velocity)
        self._begin[self._flat](before, velocity, now, *self._lists, self.record, self.integers, *time)
        self._drive(now, new_velocity, time)
        if self.contacts:
            self.contacts.find(before, now)

    def iterate(self, iteration: int) -> None:
        """Launch an iteration (SubstepSimulation)."""
        before, now = self.substep_start, self.position[self._current]
        self._touch(before, now, self._substep_time)
        for _, project in self._colours:
            project(before, now, iteration == 0)
        if self.contacts:
            self.contacts.project(before, now)

    def end_substep(self, place: int, substep: int) -> None:
        """Launch the stages after the iterations (SubstepSimulation)."""
        before, now, velocity = self.substep_start, self.position[self._current], self.velocity[self._current]
        time = self._when(place, substep)
        self._release(now)
        self._end[self._flat](before, now, velocity, self.record, self.bodies, self.integers, *time)
        self._drive(now, velocity, time)

    @property
    def _launches(self) -> int:
        """Number of launches of a step."""
        method, find, project = self.scene.method, 0, 0
        if self.contacts:
            find, project = self.contacts.finding, self.contacts.projecting
        touching = self._touching is not None
        more = 2 * (self._pins is not None) + (self._slow is not None) + touching
        return method.substeps * (2 + more + find + method.iterations * (len(self._colours) + project + touching))

    def _stages(self) -> dict[str, StageRun]:
        """Return the function of each stage of the plan. The state stays in its buffer; the positions at the start of a
        substep are copied."""
        flat = self._flat
        position, velocity, before = self.position[0], self.velocity[0], self.position[1]
        stage = make_xpbd_stages(self.real, self.options.math, forces_of(self.plan.parts), AXES)

        def predict(moment: Moment) -> None:
            before.copy_to_device(position, stream=self.stream)
            self._set_counter(moment.step)
            time = self._counter, np.int64(0), np.int64(moment.substeps), np.int64(moment.substep)
            self._brake(velocity)
            self._begin[flat](before, velocity, position, *self._lists, self.record, self.integers, *time)

        def colour(project: Callable[[Any, Any, bool], None]) -> StageRun:
            return lambda moment: project(before, position, moment.fresh)

        def update(moment: Moment) -> None:
            stage.update_velocity[flat](before, position, velocity, self.record)

        def collide(moment: Moment) -> None:
            stage.collide[flat](
                before, position, velocity, self.record, self.bodies, self.integers, np.int64(moment.number)
            )

        def pins(moment: Moment) -> None:
            time = self._counter, np.int64(0), np.int64(moment.substeps), np.int64(moment.substep)
            self._drive(position, velocity, time)

        def touch(moment: Moment) -> None:
            time = self._counter, np.int64(0), np.int64(moment.substeps), np.int64(moment.substep)
            self._touch(before, position, time)

        contacts = self.contacts
        touching: dict[str, StageRun] = {}
        if contacts:
            touching[mesh_plan.FIND_CONTACTS] = lambda moment: contacts.find(before, position)
            touching[mesh_plan.PROJECT_CONTACTS] = lambda moment: contacts.project(before, position)
        return (
            {name: colour(project) for name, project in self._colours}
            | touching
            | {TOUCH: touch, RELEASE: lambda moment: self._release(position), mesh_plan.PREDICT: predict}
            | {mesh_plan.PINS.name: pins, mesh_plan.UPDATE: update, mesh_plan.COLLIDE: collide}
        )

    # ------------------------------------------------------------------ the contract

    def _parameters_changed(self) -> None:
        if self.contacts:
            self.contacts.change(self.scene)
        super()._parameters_changed()

    def _normal_arguments(self) -> Arguments:
        return tuple(self._surface)
