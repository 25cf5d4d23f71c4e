"""Soft and rigid bodies by shape matching on CUDA: their device arrays, snapshots, and transfers."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np

from softlab.gpu_backend.contact.particles import ParticleContacts, particle_contact_bytes
from softlab.gpu_backend.core.device import Arguments, DeviceArray
from softlab.gpu_backend.core.quads import AXES, ROWS, SIZE
from softlab.gpu_backend.core.substeps import SubstepSimulation
from softlab.gpu_backend.shape_matching.couples import Couples
from softlab.gpu_backend.shape_matching.lattice import Lattices, lattice_bytes
from softlab.gpu_backend.shape_matching.links import DeviceLinks
from softlab.gpu_backend.shape_matching.material import ClusterMaterial
from softlab.gpu_backend.shape_matching.rebound import Rebounds
from softlab.gpu_backend.shape_matching.rigid import RigidMotion
from softlab.model.assets.clusters import Clusters
from softlab.model.contact.cloth_parameters import collider_numbers
from softlab.model.formulas.shape_matching.cluster import MOMENTS
from softlab.model.shape_matching.cluster_tables import first_particles, leans, matching_factors
from softlab.model.shape_matching.simulation import BodiesSimulation


class BodiesState(BodiesSimulation, SubstepSimulation):
    """The device arrays of a simulation of bodies (gpu_backend/shape_matching/solver.py)."""

    clusters: Clusters  # those in no lattice

    @abstractmethod
    def _match(self, position: DeviceArray, new_rotation: DeviceArray, for_view: bool = False) -> None:
        """Compute the clusters' rotations at `position` into `new_rotation`, and their frames."""

    def _require_space(self) -> None:
        item, entries, clusters = np.dtype(self.real).itemsize, len(self.clusters.indices), self.clusters.count
        needed = item * (8 * SIZE * self.particle_count + 2 * SIZE * entries + (MOMENTS + 7 * SIZE) * clusters)
        needed += 4 * (2 * entries + self.particle_count + 2 * clusters) + lattice_bytes(self.scene.body_set, item)
        if self.scene.contact:
            needed += particle_contact_bytes(self.scene, item)
        every = self.scene.body_set.clusters
        if "couples" in self.plan.parts and every.count > clusters:
            needed += len(every.indices) * ((SIZE + 1) * item + 8) + every.count * (3 * SIZE * item + 8)
        self._require_memory(needed, "bodies", f"{self.particle_count} particles, {entries} entries of clusters")

    def _kernel_parts(self) -> frozenset[str]:
        parts = self.plan.parts - {"clusters"} | {"load"}  # every particle has its own weight
        return parts | {"pins"} if "spare" in parts else parts  # parked particles stay

    def _zeros(self, count: int) -> DeviceArray:
        return self.zeros(count, self.real)

    def _allocate(self) -> None:
        scene, real, clusters = self.scene, self.real, self.clusters
        self._allocate_quads(collider_numbers(scene, real))
        self.rotation, self.view_rotation, self.stored_rotation = (self._zeros(SIZE * clusters.count) for _ in range(3))
        self._weight = (self.body.inverse_mass * scene.grid.mass).astype(real)
        self._entries = self._entries_of(clusters)
        self._firsts = self._entries[1]
        self._leans = self.on_device(leans(clusters, real))
        self._sums, self._frames = self._zeros(MOMENTS * clusters.count), self._zeros(ROWS * SIZE * clusters.count)
        self.contacts: ParticleContacts | None = None
        if scene.contact:
            self.contacts = ParticleContacts(scene, real, self.options.math, self.stream, self.plan.parts)
        self._particle_order = clusters.of_particle[1]
        self._particle_members = self.on_device(self._in_particle_order())
        self._gathered = (*self._clusters_of_particles(clusters), self._particle_members, self._frames)

        variant = real, self.options.math
        self._material = ClusterMaterial(clusters, self._particle_order, self._kernel_parts(), *variant, self.stream)
        self._material.change(scene.method)
        self._rigid: RigidMotion | None = None
        if "rigid-motion" in self.plan.parts:
            whole = clusters, self._particle_order, self.particle_count, self._kernel_parts()
            self._rigid = RigidMotion(*whole, *variant, self.stream)
        self._rebounds: Rebounds | None = None
        if self.plan.parts & {"rigid-rebound", "rigid-bounce"}:
            those = clusters, self._particle_order, self.particle_count, self.contacts, self._kernel_parts()
            self._rebounds = Rebounds(*those, *variant, self.stream)
        self._couples: Couples | None = None
        if "couples" in self.plan.parts:
            every, arrays = scene.body_set.clusters, (self._entries, self._leans, self._gathered[:2])
            if every.count > clusters.count:  # windows of lattices
                arrays = self._entries_of(every), self.on_device(leans(every, real)), self._clusters_of_particles(every)
            self._couples = Couples(every, arrays, self.particle_count, self.plan.parts, *variant, self.stream)
        self._lattices = Lattices(scene.body_set, *variant, self.stream)
        self._lattices.change(scene.method)
        arguments = scene.body_set, scene.method, *variant, self.stream
        self._links: Any = DeviceLinks(*arguments) if scene.body_set.links.count else None

    def _entries_of(self, clusters: Clusters) -> Arguments:
        """Return the device arrays of clusters: offsets, first particles, particles, rest offsets and masses."""
        members = np.concatenate([clusters.rest, clusters.masses[:, None]], axis=1).astype(self.real)
        arrays = clusters.offsets, first_particles(clusters), clusters.indices, members
        return tuple(self.on_device(array) for array in arrays)

    def _clusters_of_particles(self, clusters: Clusters) -> Arguments:
        """Return the device arrays of the particles' clusters: first of each particle, clusters."""
        starts, entries = clusters.of_particle
        return self.on_device(starts), self.on_device(clusters.owner[entries])

    @property
    def inertial(self) -> Any:
        """Inertial displacements of rigid bodies since the start of the substep (SubstepSimulation)."""
        return self._rigid.travel if self._rigid else None

    @property
    def couples(self) -> Any:
        """Quads of particles: moments of friction at contacts in the substep so far; None if friction turns nothing."""
        return self._couples.sums if self._couples else None

    def _in_particle_order(self) -> np.ndarray:
        """Return (entries, 4): rest offsets and factors, particle by particle."""
        method = self.scene.method
        factors = matching_factors(self.clusters, method.dt / method.substeps, method.iterations)
        return np.concatenate([self.clusters.rest, factors[:, None]], axis=1)[self._particle_order].astype(self.real)

    @property
    def contacts_lost(self) -> int:
        """Number of neighbours that did not fit into the lists since the start."""
        return self.contacts.lost if self.contacts else 0

    def _store_snapshot(self) -> None:
        super()._store_snapshot()
        self.stored_rotation.copy_to_device(self.rotation, stream=self.stream)
        self._lattices.store()
        self._material.store()

    def _restore(self) -> None:
        super()._restore()
        self.rotation.copy_to_device(self.stored_rotation, stream=self.stream)
        self._lattices.restore()
        self._material.restore()

    def _parameters_changed(self) -> None:
        if self._links:
            self._links.change(self.scene.method)
        if self.clusters.count:
            self._particle_members.copy_to_device(self._in_particle_order().reshape(-1), stream=self.stream)
        self._material.change(self.scene.method)
        self._lattices.change(self.scene.method)
        if self.contacts:
            self.contacts.change(self.scene)
        super()._parameters_changed()

    def _weights_changed(self) -> None:
        self._weight = (self.body.inverse_mass * self.scene.body_set.mass).astype(self.real)

    def _of_all(self, loose: Any, of_lattices: Any, rows: int = 1) -> np.ndarray:
        """Return (clusters, rows * 4) from arrays of quads, those of loose clusters first."""
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
            self._match(self.position[self._current], self.rotation, for_view=True)
            self._lattices.settle()
        self.synchronize()

    def _download_plastic(self) -> np.ndarray | None:
        self.synchronize()
        return self._material.download()

    def _upload_plastic(self, plastic: np.ndarray | None) -> None:
        self._material.upload(plastic)

    def _match_for_view(self) -> np.ndarray:
        """Return (clusters, 3, 4): the rows of rotations, and centres, at the current positions."""
        self._match(self.position[self._current], self.view_rotation, for_view=True)
        return self._of_all(self._frames, self._lattices.frames, ROWS).reshape(-1, ROWS, SIZE)

    def _read_deformation(self) -> np.ndarray:
        return np.ascontiguousarray(self._match_for_view()[:, :, :AXES])

    def _read_clusters(self) -> tuple[np.ndarray, np.ndarray]:
        centre = self._match_for_view()[:, :, AXES].copy()
        return self._of_all(self.view_rotation, self._lattices.view_rotation), centre
