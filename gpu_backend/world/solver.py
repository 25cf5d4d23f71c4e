"""A world on CUDA: members of several families on one stream, and contacts between them. Kernels: `launch`, members'
own launches with contacts between them; `graph`, the same captured as a CUDA graph; `stages`, stage by stage. In
`exact` math all give the same bits as the CPU."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.surfaces import SurfaceContacts, surface_contact_bytes
from softlab.gpu_backend.core.device import memory_info, require_gpu, simulated
from softlab.gpu_backend.core.launch import Graphs, can_capture, new_stream
from softlab.gpu_backend.core.substeps import Launched, SubstepSimulation, launched_kernel
from softlab.gpu_backend.fluid.among_solids import FluidAmongSolids
from softlab.gpu_backend.world.joined import THREADS, Joined
from softlab.model.base.components import named
from softlab.model.base.memory import require
from softlab.model.core.families import family_of, scene_plan
from softlab.model.core.plan import Executor
from softlab.model.core.simulation import Options, Simulation
from softlab.model.scene.scene import Scene
from softlab.model.world.meeting import MEMBERS_MEETING, cross_surface
from softlab.model.world.plan import coupled
from softlab.model.world.simulation import STAGES, WorldSimulation
from softlab.model.world.solids import solids_of


class World(WorldSimulation, Launched):
    """A world on CUDA (model/world/simulation.py)."""

    backend = "gpu"
    threads = THREADS
    members: dict[str, SubstepSimulation]  # type: ignore[assignment]
    joined: Joined | None = None
    contacts: SurfaceContacts | None = None
    _graphs: Graphs | None = None

    def __init__(self, scene: Scene, options: Options):
        self.device = require_gpu()
        super().__init__(scene, options)
        self.plan, self.kernel = scene_plan(scene, options.live), launched_kernel(options.kernel, "a world")
        if {"bodies", "fluid"} <= set(scene.members) and not scene.contact:
            self.kernel = STAGES  # without contacts, launches of bodies move to their goals too late for a fluid
        self.stream = new_stream()
        try:
            self._open_members(STAGES if self.kernel == STAGES else "launch")
            self._build()
            self.reset()
        except BaseException:
            self.close()
            raise

    def _open(self, scene: Scene, options: Options) -> Simulation:
        if scene.fluids:  # a fluid is opened last, among the solids of the other members
            solids, weights = solids_of(self.scene), self.body.inverse_mass * self.scene.grid.mass
            places = Joined(solids.particles, self.members, self.slices, weights, self.stream)
            return FluidAmongSolids(scene, options, solids.samples, places, self.stream)
        return named(family_of(scene).solvers[self.backend])(scene, options, self.stream)

    def _build(self) -> None:
        """Compile every kernel of a step, by running it once on arrays that `reset` then overwrites."""
        if coupled(self.scene):
            self._join()
        if self.kernel == STAGES:
            self._executor = Executor(self.plan, self._all_stages())
            return
        self._executor = Executor(self.plan, {}, self._advance_steps)
        if can_capture():
            self._advance_steps(0, 1)
            self.synchronize()
        if self.kernel == "graph" and can_capture():
            self._graphs = Graphs(self.stream, self._launch, self._count_on)

    def _join(self) -> None:
        """Allocate the particles in contact."""
        if not simulated():
            needed = surface_contact_bytes(self.scene, np.dtype(self.real).itemsize, MEMBERS_MEETING)
            count = self.scene.world_set.particle_count
            require(needed, memory_info()[0], "contact", f"{count} particles", "GPU memory")
        weights, meeting = self.body.inverse_mass * self.scene.grid.mass, cross_surface(self.scene)
        self.joined = Joined(meeting.particles, self.members, self.slices, weights, self.stream)
        variant = self.real, self.options.math
        self.contacts = SurfaceContacts(self.scene, *variant, self.joined.weights, self.stream, MEMBERS_MEETING)

    # ------------------------------------------------------------------ a step

    @property
    def _current(self) -> int:
        """Index of the members' buffers with the state: the same for all."""
        return next(iter(self.members.values()))._current

    @_current.setter
    def _current(self, parity: int) -> None:
        for member in self.members.values():
            member._current = parity

    def _count_on(self, passes: int) -> None:
        for member in self.members.values():
            member._count_on(passes)

    def _set_counter(self, step: int) -> None:
        for member in self.members.values():
            member._set_counter(step)

    def _substep(self, place: int, substep: int) -> None:
        members = self.members.values()
        for member in members:
            member.begin_substep(place, substep)
        self._find()
        for iteration in range(self.scene.method.iterations):
            for member in members:
                member.iterate(iteration)
            self._project()
        for member in members:
            member.end_substep(place, substep)

    def _find(self) -> None:
        if self.joined and self.contacts:
            self.joined.take(True)
            self.contacts.find(self.joined.before, self.joined.position)

    def _project(self) -> None:
        if self.joined and self.contacts:
            self.joined.take(False)
            self.contacts.project(self.joined.before, self.joined.position)
            self.joined.give()

    @property
    def _launches(self) -> int:
        """Number of launches of a step."""
        launches = sum(member._launches for member in self.members.values())
        if not self.joined or not self.contacts:
            return launches
        joined, contacts, method = self.joined, self.contacts, self.scene.method
        each = joined.taking + contacts.projecting + joined.giving
        cross = 2 * joined.taking + contacts.finding + method.iterations * each
        return launches + method.substeps * cross

    # ------------------------------------------------------------------ the contract

    def _read_position(self, into: Any) -> Any:
        if into is None or not hasattr(into, "__cuda_array_interface__"):
            return super()._read_position(into)
        whole = cuda.as_cuda_array(into)
        for name, member in self.members.items():
            member._read_position(whole[self.slices[name]])
        return into

    def close(self) -> None:
        """Close the world and all members."""
        if self._graphs is not None:
            self.synchronize()
            self._graphs.close()
            self._graphs = None
        super().close()
