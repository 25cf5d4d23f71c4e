"""Soft and rigid bodies by shape matching on CUDA: clusters in compressed form, any number a particle.

M. Mueller et al., "Meshless Deformations Based on Shape Matching", SIGGRAPH 2005, in substeps, with the masses split among
clusters; see model/shape_matching/clusters.py. A substep: `begin` predicts positions; `iterations` times clusters are
summed up, turned, and particles moved towards their goals; the last of these ways also makes velocities and lets particles
meet the colliders. Kernels: `launch`, and `graph`, the same captured as a CUDA graph; `stages`, stage by stage. In `exact`
math all give the same bits, and the CPU's.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from gpu_backend.contact.particles import ParticleContacts, particle_contact_bytes
from gpu_backend.contact.particles_project import make_contact_ends
from gpu_backend.core.device import simulated
from gpu_backend.core.launch import Graphs, can_capture
from gpu_backend.core.quads import SIZE
from gpu_backend.core.substeps import SubstepSimulation, launched_kernel
from gpu_backend.mass_spring.cloth.kernels import make_cloth_tools
from gpu_backend.shape_matching.kernels import AXES, ROWS, THREADS, TOGETHER, make_bodies_clusters, make_bodies_ends
from gpu_backend.shape_matching.lattice import Lattices, lattice_bytes
from gpu_backend.shape_matching.links import DeviceLinks
from gpu_backend.shape_matching.material import ClusterMaterial
from gpu_backend.shape_matching.rebound import Rebounds
from gpu_backend.shape_matching.stages import bind_bodies_stages
from model.core.plan import Executor
from model.core.simulation import Options
from model.formulas.cluster import MOMENTS
from model.mass_spring.cloth_parameters import collider_numbers
from model.scene.scene import Scene
from model.shape_matching.cluster_tables import first_particles, leans, matching_factors
from model.xpbd.plan import xpbd_plan


class Bodies(SubstepSimulation):
    """See model/core/simulation.py for the contract. `threads` is the number of threads a block."""

    def __init__(self, scene: Scene, options: Options, stream: Any = None):
        super().__init__(scene, options, stream)
        self.plan, self.kernel = xpbd_plan(scene, options.live), launched_kernel(options.kernel, "bodies")
        self.threads, self.clusters = THREADS, scene.body_set.loose
        self._require_space()
        self._start(THREADS)

    def _require_space(self) -> None:
        item, entries, clusters = np.dtype(self.real).itemsize, len(self.clusters.indices), self.clusters.count
        needed = item * (8 * SIZE * self.particle_count + 2 * SIZE * entries + (MOMENTS + 7 * SIZE) * clusters)
        needed += 4 * (2 * entries + self.particle_count + 2 * clusters) + lattice_bytes(self.scene.body_set, item)
        if self.scene.contact:
            needed += particle_contact_bytes(self.scene, item)
        self._require_memory(needed, "bodies", f"{self.particle_count} particles, {entries} entries of clusters")

    # ------------------------------------------------------------------ arrays

    def _zeros(self, count: int) -> Any:
        return self.zeros(count, self.real)

    def _allocate(self) -> None:
        scene, real, clusters = self.scene, self.real, self.clusters
        self._allocate_quads(collider_numbers(scene, real))
        self.rotation, self.turned, self.kept_rotation = (self._zeros(SIZE * clusters.count) for _ in range(3))
        self._weight = (self.body.inverse_mass * scene.grid.mass).astype(real)
        members = np.concatenate([clusters.rest, clusters.masses[:, None]], axis=1).astype(real)
        self._firsts = self.on_device(first_particles(clusters))
        self._entries = (
            self.on_device(clusters.offsets), self._firsts, self.on_device(clusters.indices), self.on_device(members)
        )  # fmt: skip
        self._leans = self.on_device(leans(clusters, real))
        self._sums, self._frames = self._zeros(MOMENTS * clusters.count), self._zeros(ROWS * SIZE * clusters.count)
        self.contacts = ParticleContacts(scene, real, self.options.math, self.stream) if scene.contact else None
        starts, self._own = clusters.of_particle
        self._own_members = self.on_device(self._in_own_order())
        self._gathered = (
            self.on_device(starts), self.on_device(clusters.owner[self._own]), self._own_members, self._frames
        )  # fmt: skip

        variant = real, self.options.math
        self._material = ClusterMaterial(clusters, self._own, self._kernel_parts(), *variant, self.stream)
        self._material.change(scene.method)
        self._rebounds: Rebounds | None = None
        if self.plan.parts & {"rigid-rebound", "rigid-bounce"}:
            those = clusters, self._own, self.particle_count, self.contacts, self._kernel_parts()
            self._rebounds = Rebounds(*those, *variant, self.stream)
        self._lattices = Lattices(scene.body_set, *variant, self.stream)
        self._lattices.change(scene.method)
        given = scene.body_set, scene.method, *variant, self.stream
        self._links: Any = DeviceLinks(*given) if scene.body_set.links.count else None

    def _in_own_order(self) -> np.ndarray:
        """(entries, 4): rest offsets and factors, particle by particle."""
        method = self.scene.method
        factors = matching_factors(self.clusters, method.dt / method.substeps, method.iterations)
        return np.concatenate([self.clusters.rest, factors[:, None]], axis=1)[self._own].astype(self.real)

    # ------------------------------------------------------------------ kernels

    def _kernel_parts(self) -> frozenset[str]:
        found = self.plan.parts - {"clusters"} | {"load"}  # every particle has a weight of its own
        return found | {"pins"} if "spare" in found else found  # what is parked stays

    def _build(self) -> None:
        """Compile and load every kernel, by running it once on arrays that `reset` then overwrites."""
        variant = self.real, self.options.math
        self._parts = self._kernel_parts()
        self._tools, self._cluster_kernels = make_cloth_tools(self.real), make_bodies_clusters(*variant)
        self._ends = make_bodies_ends(*variant, self._parts)
        self._contact_ends: Any = make_contact_ends(*variant, self._parts) if self.contacts else None
        if self.kernel == "stages":
            self._executor = Executor(self.plan, bind_bodies_stages(self))
            return
        self._executor = Executor(self.plan, {}, self._advance_steps)
        if not simulated():
            self._upload(self.body.position, self.body.velocity)  # all in one place would all meet
            self._advance_steps(0, 1)
            if self.contacts:
                self.contacts.forget()
            self._move(self.position[0])
            cuda.synchronize()
        if self.kernel == "graph" and can_capture():
            self._graphs = Graphs(self.stream, self._launch, self._count_on)

    def _match(self, position: Any, turned: Any, look: bool = False) -> None:
        """The clusters' rotations for such positions, from those of the state into `turned`, and their frames; of lattices
        into the state's own, in a `look` into others. A `look` at the state makes nothing creep."""
        if self._lattices.copies:
            self._lattices.match(position, self._lattices.turned if look else self._lattices.rotation, look)
        if not self.clusters.count:
            return
        blocks = max(1, -(-self.clusters.count // TOGETHER))
        self._cluster_kernels.sum_up[blocks, THREADS, self.stream](position, *self._entries, self._sums)
        arrays = position, self._firsts, self._leans, self._sums, self.rotation, turned, self._frames
        if self._material.shaped:
            self._material.turn(self._over(self.clusters.count, THREADS), look, *arrays)
        else:
            self._cluster_kernels.turn[self._over(self.clusters.count, THREADS)](*arrays)

    def _move(self, position: Any) -> None:
        """Particles towards the goals of their loose clusters."""
        if self.clusters.count:
            self._cluster_kernels.move[self._flat](position, *self._gathered)

    # ------------------------------------------------------------------ a step

    def begin_substep(self, place: int, substep: int) -> None:
        """See SubstepSimulation."""
        before, velocity = self.position[self._current], self.velocity[self._current]
        self._current = 1 - self._current
        now = self.position[self._current]
        self._ends.begin[self._flat](before, velocity, now, self.record, self.integers)
        if self.contacts:
            self.contacts.find(now)

    def iterate(self, iteration: int) -> None:
        """See SubstepSimulation. Particles that meet nobody come to the goals of the last one as the substep ends."""
        before, now = self.substep_start, self.position[self._current]
        if iteration and not self.contacts:
            self._move(now)
        for number in range(self.scene.body_set.links.colours):
            self._links.project(now, self.record, number, iteration == 0)
        self._match(now, self.rotation)
        self._lattices.move(now)
        if self.contacts:
            self._move(now)
            self.contacts.project(before, now)

    def end_substep(self, place: int, substep: int) -> None:
        """See SubstepSimulation."""
        before, velocity = self.substep_start, self.velocity[1 - self._current]
        now, new_velocity = self.position[self._current], self.velocity[self._current]
        time = self._counter, np.int64(place), np.int64(self.scene.method.substeps), np.int64(substep)
        last = self.record, self.bodies, self.integers, *time
        if self._material.damped:
            self._damp(before, now, velocity, new_velocity)
            slowing = self._material.slowing(self._gathered)
            if self._rebounds and self._rebounds.turns:
                self._rebounds.strike[self._flat](before, now, new_velocity, self._rebounds.struck, *slowing, *last)
                self._rebound(now, new_velocity)
                return
            self._material.ends.finish[self._flat](before, now, new_velocity, *slowing, *last)
        elif self.contacts and self.contacts.bounces:
            self._part(before, now, velocity, new_velocity)
            self._contact_ends.collide[self._flat](before, now, new_velocity, *last)
        elif self.contacts:
            self._contact_ends.finish[self._flat](before, now, new_velocity, self.contacts.record, *last)
        else:
            self._ends.finish[self._flat](before, now, new_velocity, *self._gathered, *last)

    def _rebound(self, position: Any, velocity: Any) -> None:
        """Rigid bodies as a whole, of what colliders gave to their particles."""
        assert self._rebounds is not None
        self._rebounds.run(position, velocity, self._entries, self._leans, self._gathered)

    def _part(self, before: Any, now: Any, old: Any, velocity: Any) -> None:
        """Velocities of a substep that began with `old` ones, and whose particles have left their contacts."""
        assert self.contacts is not None
        self._contact_ends.update_velocity[self._flat](before, now, velocity, self.contacts.record, self.record)
        if self.contacts.bounces:
            self._bounce(now, old, velocity)

    def _bounce(self, position: Any, old: Any, velocity: Any) -> None:
        """Particles off each other, rigid bodies as wholes."""
        assert self.contacts is not None
        if self._rebounds and self._rebounds.contacts:
            self._rebounds.bounce(position, old, velocity, self._entries, self._leans, self._gathered)
        else:
            self.contacts.bounce(position, old, velocity)

    def _damp(self, before: Any, now: Any, old: Any, velocity: Any) -> None:
        """Velocities of a substep whose last goals are known, and the clusters' rigid motions of them."""
        if self.contacts:
            self._part(before, now, old, velocity)
        else:
            self._material.ends.rate[self._flat](before, now, velocity, *self._gathered, self.record)
        self._material.gather(now, velocity, self._entries, self._leans)

    @property
    def _launches(self) -> int:
        """Of a step."""
        method, contacts = self.scene.method, self.contacts
        iteration = 3 + self.scene.body_set.links.colours + (contacts.projecting if contacts else 0)
        iteration += self._lattices.launches
        ends = 1 + 2 * self._material.damped + (1 + contacts.finding if contacts else 0)
        if contacts and contacts.bounces:
            whole = self._rebounds is not None and self._rebounds.contacts is not None
            ends += (Rebounds.restitution_launches if whole else contacts.restitution_launches) + (
                not self._material.damped
            )
        ends += Rebounds.launches if self._rebounds and self._rebounds.turns else 0
        return method.substeps * (ends + iteration * method.iterations)

    # ------------------------------------------------------------------ the contract

    @property
    def contacts_lost(self) -> int:
        """Of particles' neighbours, those that there was no room for since the start."""
        return self.contacts.lost if self.contacts else 0

    def _keep(self) -> None:
        super()._keep()
        self.kept_rotation.copy_to_device(self.rotation, stream=self.stream)
        self._lattices.keep()
        self._material.keep()

    def _restore(self) -> None:
        super()._restore()
        self.rotation.copy_to_device(self.kept_rotation, stream=self.stream)
        self._lattices.restore()
        self._material.restore()

    def _parameters_changed(self) -> None:
        if self._links:
            self._links.change(self.scene.method)
        if self.clusters.count:
            self._own_members.copy_to_device(self._in_own_order().reshape(-1), stream=self.stream)
        self._material.change(self.scene.method)
        self._lattices.change(self.scene.method)
        if self.contacts:
            self.contacts.change(self.scene)
        super()._parameters_changed()

    def _weights_changed(self) -> None:
        self._weight = (self.body.inverse_mass * self.scene.body_set.mass).astype(self.real)

    def _of_all(self, loose: Any, of_lattices: Any, rows: int = 1) -> np.ndarray:
        """(clusters, rows * 4): arrays of quads, those of loose clusters first."""
        arrays = [loose] * bool(self.clusters.count) + [of_lattices] * bool(self._lattices.copies)
        return np.concatenate([self._quads(array).reshape(-1, rows * SIZE) for array in arrays])

    def _download_rotation(self) -> np.ndarray:
        return self._of_all(self.rotation, self._lattices.rotation)

    def _upload_rotation(self, rotation: np.ndarray | None) -> None:
        count = self.clusters.count
        start = np.zeros((count + self._lattices.clusters, SIZE), self.real)
        start[:, 0] = 1
        quads = start if rotation is None else rotation
        for array, values in ((self.rotation, quads[:count]), (self._lattices.rotation, quads[count:])):
            if len(values):
                array.copy_to_device(np.ascontiguousarray(values).reshape(-1), stream=self.stream)
        if rotation is None:
            self._match(self.position[self._current], self.rotation, look=True)
            self._lattices.settle()
        self.synchronize()

    def _download_plastic(self) -> np.ndarray | None:
        self.synchronize()
        return self._material.download()

    def _upload_plastic(self, plastic: np.ndarray | None) -> None:
        self._material.upload(plastic)

    def _look(self) -> np.ndarray:
        """(clusters, 3, 4): the rows of rotations, and centres, where particles are now."""
        self._match(self.position[self._current], self.turned, look=True)
        return self._of_all(self._frames, self._lattices.frames, ROWS).reshape(-1, ROWS, SIZE)

    def _read_deformation(self) -> np.ndarray:
        return np.ascontiguousarray(self._look()[:, :, :AXES])

    def _read_clusters(self) -> tuple[np.ndarray, np.ndarray]:
        centre = self._look()[:, :, AXES].copy()
        return self._of_all(self.turned, self._lattices.turned), centre
