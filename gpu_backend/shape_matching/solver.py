"""Soft and rigid bodies by shape matching on CUDA: clusters in compressed form, any number per particle.

M. Mueller et al., "Meshless Deformations Based on Shape Matching", SIGGRAPH 2005, in substeps, with the masses divided
among clusters (model/assets/clusters.py). A substep: `begin` predicts positions; `iterations` times clusters
are summed, turned, and particles moved towards their goals; the last of these moves also computes velocities and
collisions. Kernels: `launch`, and `graph`, the same captured as a CUDA graph; `stages`, stage by stage. In `exact` math
all give the same bits as the CPU.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.particles_project import make_contact_ends
from softlab.gpu_backend.core.device import DeviceArray, Stream, simulated
from softlab.gpu_backend.core.launch import Graphs, can_capture
from softlab.gpu_backend.core.sheet import make_cloth_tools
from softlab.gpu_backend.core.substeps import launched_kernel
from softlab.gpu_backend.shape_matching.couples import Couples
from softlab.gpu_backend.shape_matching.kernels import THREADS, TOGETHER, make_bodies_clusters, make_bodies_ends
from softlab.gpu_backend.shape_matching.rebound import Rebounds
from softlab.gpu_backend.shape_matching.stages import bind_bodies_stages
from softlab.gpu_backend.shape_matching.state import BodiesState
from softlab.model.core.plan import Executor
from softlab.model.core.simulation import Options
from softlab.model.scene.scene import Scene
from softlab.model.shape_matching.plan import body_plan


class Bodies(BodiesState):
    """Bodies on CUDA; model/core/simulation.py defines the contract. `threads` is the number of threads per block."""

    def __init__(self, scene: Scene, options: Options, stream: Stream | None = None):
        super().__init__(scene, options, stream)
        self.plan, self.kernel = body_plan(scene, options.live), launched_kernel(options.kernel, "bodies")
        self.threads, self.clusters = THREADS, scene.body_set.loose
        self._require_space()
        self._start(THREADS)

    # ------------------------------------------------------------------ kernels

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
            self._upload(self.body.position, self.body.velocity)  # at one position all would be in contact
            self._advance_steps(0, 1)
            if self.contacts:
                self.contacts.forget()
            self._move(self.position[0])
            cuda.synchronize()
        if self.kernel == "graph" and can_capture():
            self._graphs = Graphs(self.stream, self._launch, self._count_on)

    def _match(self, position: DeviceArray, new_rotation: DeviceArray, for_view: bool = False) -> None:
        """Compute the clusters' rotations at `position`, from those of the state into `new_rotation`, and their frames.

        Those of lattices go into the state's own arrays, with `for_view` into others. A `for_view` at the state causes no
        creep.
        """
        if self._lattices.copies:
            self._lattices.match(
                position, self._lattices.view_rotation if for_view else self._lattices.rotation, for_view
            )
        if not self.clusters.count:
            return
        blocks = max(1, -(-self.clusters.count // TOGETHER))
        self._cluster_kernels.sum_up[blocks, THREADS, self.stream](position, *self._entries, self._sums)
        arrays = position, self._firsts, self._leans, self._sums, self.rotation, new_rotation, self._frames
        if self._material.shaped:
            self._material.turn(self._over(self.clusters.count, THREADS), for_view, arrays)
        else:
            self._cluster_kernels.turn[self._over(self.clusters.count, THREADS)](*arrays)

    def _move(self, position: DeviceArray) -> None:
        """Move particles towards the goals of their loose clusters."""
        if self._rigid:
            self._rigid.ends.move[self._flat](position, *self._gathered, self._rigid.travel)
        elif self.clusters.count:
            self._cluster_kernels.move[self._flat](position, *self._gathered)

    # ------------------------------------------------------------------ a step

    def begin_substep(self, place: int, substep: int) -> None:
        """Launch the stages before the iterations (SubstepSimulation)."""
        before, velocity = self.position[self._current], self.velocity[self._current]
        self._current = 1 - self._current
        now = self.position[self._current]
        arguments = before, velocity, now, self.record, self.integers
        if self._rigid:
            self._rigid.begins.begin[self._flat](*arguments, self._rigid.travel)
        else:
            self._ends.begin[self._flat](*arguments)
        if self.contacts:
            self.contacts.find(now)

    def iterate(self, iteration: int) -> None:
        """Launch an iteration (SubstepSimulation). Without contacts, particles move to the goals of the last iteration
        at the substep's end."""
        before, now = self.substep_start, self.position[self._current]
        if iteration and not self.contacts:
            self._move(now)
        for number in range(self.scene.body_set.links.colours):
            self._links.project(now, self.record, number, iteration == 0)
        self._match(now, self.rotation)
        self._lattices.move(now)
        if self.contacts:
            self._move(now)
            self.contacts.project(before, now, self.inertial, self.couples)

    def end_substep(self, place: int, substep: int) -> None:
        """Launch the stages after the iterations (SubstepSimulation)."""
        before, velocity = self.substep_start, self.velocity[1 - self._current]
        now, new_velocity = self.position[self._current], self.velocity[self._current]
        time = self._counter, np.int64(place), np.int64(self.scene.method.substeps), np.int64(substep)
        last = self.record, self.bodies, self.integers, *time
        if self._couples:
            self._couples.turn(now, self.inertial)
        if self._rigid:
            self._end_rigid(before, now, new_velocity)
            if self._rebounds and self._rebounds.turns:
                self._rebounds.store_impulses[self._flat](before, now, new_velocity, self._rebounds.impulses, *last)
                self._rebound(now, new_velocity)
            if self.contacts:
                self._bounce(now, velocity, new_velocity)
            self._rigid.rest(before, now, new_velocity, self._entries)
        elif self._material.damped:
            self._damp(before, now, velocity, new_velocity)
            slowing = self._material.slowing(self._gathered)
            self._material.ends.finish[self._flat](before, now, new_velocity, *slowing, *last)
        elif self.contacts and self.contacts.bounces:
            self._part(before, now, velocity, new_velocity)
            self._contact_ends.collide[self._flat](before, now, new_velocity, *last)
        elif self.contacts:
            self._contact_ends.finish[self._flat](before, now, new_velocity, self.contacts.record, *last)
        else:
            self._ends.finish[self._flat](before, now, new_velocity, *self._gathered, *last)

    def _end_rigid(self, before: DeviceArray, now: DeviceArray, velocity: DeviceArray) -> None:
        """Compute velocities before colliders, in a scene with rigid bodies."""
        assert self._rigid is not None
        last = self.record, self._rigid.travel
        if self.contacts:
            self._rigid.ends.update_calmed[self._flat](before, now, velocity, self.contacts.record, *last)
        else:
            self._rigid.ends.rate[self._flat](before, now, velocity, *self._gathered, *last)
        self._rigid.steady(now, velocity, self._entries, self._leans, self._gathered)
        if self._material.damped:
            self._material.gather(now, velocity, self._entries, self._leans)
            self._material.ends.slow[self._flat](now, velocity, *self._material.slowing(self._gathered))

    def _rebound(self, position: DeviceArray, velocity: DeviceArray) -> None:
        """Apply the response of whole rigid bodies to the impulses of colliders."""
        assert self._rebounds is not None
        self._rebounds.run(position, velocity, self._entries, self._leans, self._gathered)

    def _part(self, before: DeviceArray, now: DeviceArray, old: DeviceArray, velocity: DeviceArray) -> None:
        """Compute velocities of a substep that began with `old` ones, with restitution at contacts."""
        assert self.contacts is not None
        self._contact_ends.update_velocity[self._flat](before, now, velocity, self.contacts.record, self.record)
        if self.contacts.bounces:
            self._bounce(now, old, velocity)

    def _bounce(self, position: DeviceArray, old: DeviceArray, velocity: DeviceArray) -> None:
        """Bounce particles off each other, rigid bodies as wholes."""
        assert self.contacts is not None
        if self._rebounds and self._rebounds.contacts:
            assert self._rigid is not None
            self._rebounds.bounce(
                position, old, velocity, self._rigid.travel, self._entries, self._leans, self._gathered
            )
        else:
            self.contacts.bounce(position, old, velocity)

    def _damp(self, before: DeviceArray, now: DeviceArray, old: DeviceArray, velocity: DeviceArray) -> None:
        """Compute velocities of a substep after its last goals, and the clusters' rigid motions."""
        if self.contacts:
            self._part(before, now, old, velocity)
        else:
            self._material.ends.rate[self._flat](before, now, velocity, *self._gathered, self.record)
        self._material.gather(now, velocity, self._entries, self._leans)

    @property
    def _launches(self) -> int:
        """Number of launches of a step."""
        method, contacts = self.scene.method, self.contacts
        iteration = 3 + self.scene.body_set.links.colours + (contacts.projecting if contacts else 0)
        iteration += self._lattices.launches
        ends = 1 + 2 * self._material.damped + (1 + contacts.finding if contacts else 0)
        ends += self._rigid.launches if self._rigid else 0
        ends += Couples.launches if self._couples else 0
        if contacts and contacts.bounces:
            whole = self._rebounds is not None and self._rebounds.contacts is not None
            ends += (Rebounds.restitution_launches if whole else contacts.restitution_launches) + (
                not self._material.damped
            )
        ends += Rebounds.launches if self._rebounds and self._rebounds.turns else 0
        return method.substeps * (ends + iteration * method.iterations)
