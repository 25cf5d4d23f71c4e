"""Soft and rigid bodies by shape matching on CPU threads: clusters in compressed form, any number per particle.

M. Mueller et al., "Meshless Deformations Based on Shape Matching", SIGGRAPH 2005, in substeps, with the masses divided
among clusters (model/assets/clusters.py). Kernels: `fused`, many steps in one call, and `stages`, one parallel
loop per stage. In `exact` math both give the same bits, for any number of threads.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from softlab.cpu_backend.contact.particles import ParticleContacts
from softlab.cpu_backend.contact.particles_project import PACES, make_settle_stage
from softlab.cpu_backend.core.constraints import make_constraint_stage
from softlab.cpu_backend.core.layout import aligned_zeros
from softlab.cpu_backend.core.simulation import ParticlesSimulation, chosen_kernel
from softlab.cpu_backend.shape_matching.arrays import BodyArrays, ClusterArrays, ParticleClusters, Steps, World
from softlab.cpu_backend.shape_matching.bodies_bounce import make_bodies_bounce_stage
from softlab.cpu_backend.shape_matching.couples import make_couples_stage
from softlab.cpu_backend.shape_matching.damping import make_damping_stage
from softlab.cpu_backend.shape_matching.kernels import AXES, LANES, QUATERNION, SCRATCH
from softlab.cpu_backend.shape_matching.lattice import make_lattice_stages
from softlab.cpu_backend.shape_matching.lattice_layout import Lattices
from softlab.cpu_backend.shape_matching.layout import bounds_of, layout_of
from softlab.cpu_backend.shape_matching.loops import make_bodies_apart, make_bodies_stages, make_matching_stages
from softlab.cpu_backend.shape_matching.material import ClusterMaterial
from softlab.cpu_backend.shape_matching.motions import FRAME
from softlab.cpu_backend.shape_matching.rebound import make_rebound_stages
from softlab.cpu_backend.shape_matching.rigid import make_rest_stage, make_steadying_stage
from softlab.cpu_backend.shape_matching.together import make_bodies_together
from softlab.model.contact.cloth_parameters import collider_numbers
from softlab.model.core.own_forces import POKED
from softlab.model.core.plan import Executor, Moment, StageRun
from softlab.model.core.simulation import Options
from softlab.model.particles.links import LINKS
from softlab.model.scene.scene import Scene
from softlab.model.shape_matching.cluster_tables import matching_factors, shaping
from softlab.model.shape_matching.plan import body_plan

UNEVEN = 1.3  # work of the busiest thread relative to the mean, above which threads share bodies


def choose_kernel(wanted: str | None) -> str:
    """Return the kernel `wanted`, or `fused`. Raises SceneError for any other."""
    return chosen_kernel(wanted, "bodies")


def _quaternions(*planes: np.ndarray) -> np.ndarray:
    """Return (clusters, 4) from flat arrays of four planes each."""
    return np.ascontiguousarray(np.concatenate([one.reshape(QUATERNION, -1) for one in planes], axis=1).T)


class Bodies(ParticlesSimulation):
    """Bodies on CPU threads; model/core/simulation.py defines the contract. `threads`: `1x`, `2x`, `4x` or a number."""

    def __init__(self, scene: Scene, options: Options, threads: str | int = "1x"):
        super().__init__(scene, options, threads)
        self.kernel, self.plan = choose_kernel(options.kernel), body_plan(scene, options.live)
        real = self.real
        body_set = scene.body_set
        self.clusters = body_set.loose
        self.layout = layout_of(self.clusters, bounds_of(body_set), real, self.threads)
        count, clusters = self.layout.count, self.clusters.count
        self._even, self._odd, self._velocity = (aligned_zeros(AXES * count, real) for _ in range(3))
        self._weights = aligned_zeros(count, real)
        self._weights_changed()
        self._rotation, self._view_rotation = (np.zeros(QUATERNION * clusters, real) for _ in range(2))
        self._frames = aligned_zeros(FRAME * clusters, real)
        self._factors = np.zeros(len(self.layout.of_entry), real)
        starts, clusters_of, rests = self.layout.of_particle
        self._particle_clusters = ParticleClusters(
            starts, clusters_of, rests, np.zeros(len(self.layout.of_particle_entry), real)
        )
        self.integers = np.zeros(2, np.uint64)  # of model/core/own_forces.py, particles by their places
        self._set_colliders(collider_numbers(scene, real))
        self._bands = max(1, min(self.threads, count // LANES))
        self._scratch = aligned_zeros(SCRATCH * LANES * self._bands, real)
        self._bad = np.zeros(self._bands, np.int64)
        self._bounds = self.layout.bands(self._bands)
        self._apart = not self.plan.parts & {"links", "contacts"} and self.layout.evenness(self._bands) <= UNEVEN
        links = body_set.links
        ends = self.layout.slots[links.ends].astype(np.int32)
        self._lattices = Lattices(body_set, self.layout.slots, count, self._bands, real)
        self._apart = self._apart and not body_set.lattices
        self._material = ClusterMaterial(self.clusters, self.layout, self.plan.parts, real)
        self._snapshot = [np.zeros_like(array) for array in self._state()]
        self._links = ends, np.zeros((links.count, 2), real), np.zeros((links.count, 1), real), links.starts
        self.contacts: ParticleContacts | None = None
        if scene.contact:
            place = self.layout.slots, count, self._bands
            self.contacts = ParticleContacts(scene, real, options.math, self.plan.parts, *place)
        self._set_factors()
        staged = self.kernel == "stages"
        self._executor = Executor(self.plan, self._stages() if staged else {}, None if staged else self._advance)
        self.reset()

    def _set_factors(self) -> None:
        method = self.scene.method
        self._material.change(method)
        self._lattices.change(method)
        factors = matching_factors(self.clusters, method.dt / method.substeps, method.iterations)
        self._factors[:] = np.append(factors, 0.0)[self.layout.of_entry]
        self._particle_clusters.factors[:] = factors[self.layout.of_particle_entry]
        body_set = self.scene.body_set
        self._links[1][:] = body_set.links.values(method.dt / method.substeps, body_set.mass)

    def _advance(self, step: int, steps: int) -> None:
        method, variant = self.scene.method, (self.real, self.options.math, self.plan.parts)
        arrays = BodyArrays(
            self._velocity, self._weights, self._material.steps, self._factors, self._particle_clusters, self._rotation,
            self._frames, self._scratch, self._world,
        )  # fmt: skip
        times, contacts = Steps(steps, step, method.substeps, method.iterations), self.contacts
        if self._apart:
            make_bodies_apart(*variant)(
                self._bands, self._bounds, self.layout.groups, times, self._even, self._odd, arrays
            )  # fmt: skip
        else:
            make_bodies_together(*variant)(
                self._bands, times, self._even, self._odd, arrays, (self._links,), contacts.arrays if contacts else (),
                self._lattices.arrays if self._lattices.copies else (),
            )  # fmt: skip
        if steps * method.substeps % 2:
            self._even, self._odd = self._odd, self._even

    @property
    def _world(self) -> World:
        return World(self.parameters, self.integers, self.bodies, self.kinds)

    def _stages(self) -> dict[str, StageRun]:
        """Return the function of each stage of the plan."""
        makes: Any = make_bodies_stages, make_couples_stage, make_settle_stage
        stage, turn, settle = (make(self.real, self.options.math, self.plan.parts) for make in makes)
        (travel, couples), keeps = self._material.touched, "rigid-motion" in self.plan.parts
        goals = make_matching_stages(self.real, self.options.math, shaping(self.plan.parts), keeps)
        bands, count = self._bands, self.layout.count
        position, before, velocity, a = self._even, self._odd, self._velocity, np.zeros_like(self._even)
        ends, values, multipliers, starts = self._links
        contacts: Any = self.contacts
        over_clusters = count, self._material.steps, self._scratch, SCRATCH * LANES
        bounce_bodies = make_bodies_bounce_stage(self.real, self.options.math)
        whole = make_rebound_stages(self.real, self.options.math)
        project_links = make_constraint_stage(self.real, self.options.math, LINKS, in_planes=True)

        def predict(moment: Moment) -> None:
            stage.predict(count, before, position, velocity, self._weights, self.record, a, travel)

        def particle_force(force: Any) -> StageRun:
            return lambda moment: force(count, self._weights, self.record, self.integers, a)

        def move(moment: Moment) -> None:
            goals.move(bands, position, count, self._particle_clusters, self._frames, travel)
            if self._lattices.copies:
                make_lattice_stages(self.real, self.options.math).move(bands, position, count, self._lattices.arrays)

        def collide(moment: Moment) -> None:
            if "rigid-rebound" in self.plan.parts:
                whole.note(bands, velocity, count, self._material.steps)
            stage.collide(bands, moment.number, before, position, velocity, self._weights, self._world)

        def rebound(moment: Moment) -> None:
            whole.rebound(bands, position, velocity, *over_clusters)

        def update(moment: Moment) -> None:
            if self.plan.parts & PACES:
                settle(bands, count, before, position, contacts.record, travel)
            if "contact-restitution" in self.plan.parts:
                contacts.old[:] = velocity
            stage.update(bands, before, position, velocity, self._weights, count, self.parameters, travel)

        def steady(moment: Moment) -> None:
            run = make_steadying_stage(self.real, self.options.math)
            run(bands, position, velocity, *over_clusters)

        def rest(moment: Moment) -> None:
            run = make_rest_stage(self.real, self.options.math)
            run(bands, before, position, velocity, count, self._material.steps)

        def damp(moment: Moment) -> None:
            run = make_damping_stage(self.real, self.options.math)
            run(bands, position, velocity, *over_clusters)

        def bounce(moment: Moment) -> None:
            if "rigid-bounce" not in self.plan.parts:
                contacts.bounce(position, velocity, self._weights)
                return
            arrays = contacts.arrays
            bounce_bodies(
                bands, position, arrays.old, velocity, self._weights, contacts.record, arrays.search.lists,
                arrays.contacts, self._material.steps, self._scratch, SCRATCH * LANES,
            )  # fmt: skip

        def link(number: int) -> StageRun:
            def run(moment: Moment) -> None:
                arguments = position, self._weights, before, ends, values, multipliers, moment.fresh, self.parameters
                project_links(bands, *starts[number : number + 2], *arguments)

            return run

        return {f"project links {number}": link(number) for number in range(len(starts) - 1)} | {
            "gravity": lambda moment: stage.gravity(count, self.record, a),
            **{name: particle_force(force) for name, force in stage.particle_forces.items()},
            "predict": predict,
            "match clusters": lambda moment: self._match(self._rotation, self._lattices.rotation, self._material.steps),
            "move to goals": move,
            "turn by friction": lambda moment: turn(bands, position, travel, self._weights, *over_clusters),
            "update velocity": update,
            "keep momenta": steady,
            "rest": rest,
            "damp clusters": damp,
            "collide": collide,
            "rebound": rebound,
            "find neighbours": lambda moment: contacts.find(position, self._weights),
            "project contacts": lambda moment: contacts.project(before, position, self._weights, travel, couples),
            "bounce": bounce,
        }

    @property
    def contacts_lost(self) -> int:
        """Number of neighbours of particles beyond the MAX_NEIGHBOURS of each, since the simulation was opened."""
        return self.contacts.lost if self.contacts else 0

    def _match(
        self, new_rotation: np.ndarray, of_lattices: np.ndarray, arrays: ClusterArrays, for_view: bool = False
    ) -> None:
        """Compute the clusters' rotations at the current positions, into `new_rotation` and `of_lattices`, and with their
        centres into the frames; those of lattices only with `for_view`."""
        variant = self.real, self.options.math, shaping(self.plan.parts), "rigid-motion" in self.plan.parts
        make_matching_stages(*variant).match(
            self._bands, self._even, self.layout.count, arrays, self._rotation, new_rotation, self._frames,
            self._scratch,
        )  # fmt: skip
        if self._lattices.copies:
            arguments = self._lattices.arrays, of_lattices, self._lattices.frames, for_view
            make_lattice_stages(self.real, self.options.math).match(
                self._bands, self._even, self.layout.count, *arguments
            )

    def _state(self) -> tuple[np.ndarray, ...]:
        return self._even, self._velocity, self._rotation, self._lattices.rotation, self._material.plastic

    def _store_snapshot(self) -> None:
        for stored, array in zip(self._snapshot, self._state(), strict=True):
            stored[:] = array

    def _restore(self) -> None:
        for stored, array in zip(self._snapshot, self._state(), strict=True):
            array[:] = stored

    def _places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        return self._even, self._velocity, self.layout.slots, self.layout.count

    @property
    def substep_start(self) -> np.ndarray:
        """Positions at the start of the substep (ParticlesSimulation)."""
        return self._odd

    @property
    def inertial(self) -> np.ndarray | None:
        """Inertial displacements of rigid bodies since the start of the substep (ParticlesSimulation)."""
        return self._material.travel if "rigid-motion" in self.plan.parts else None

    def _parameters_changed(self) -> None:
        self.integers[POKED] = self.layout.slots[self._poke_particle] + 1 if self._poke_particle >= 0 else 0
        if self.contacts:
            self.contacts.change(self.scene)
        self._set_factors()

    def _weights_changed(self) -> None:
        self._weights[self.layout.slots] = self.body.inverse_mass * self.scene.body_set.mass

    def _planes(self, array: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(array.reshape(AXES, -1)[:, self.layout.slots].T)

    def _download(self) -> tuple[np.ndarray, np.ndarray]:
        return self._planes(self._even), self._planes(self._velocity)

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        for array, values in ((self._even, position), (self._velocity, velocity)):
            array[:] = 0
            array.reshape(AXES, -1)[:, self.layout.slots] = values.T

    def _download_rotation(self) -> np.ndarray:
        return _quaternions(self._rotation, self._lattices.rotation)

    def _upload_rotation(self, rotation: np.ndarray | None) -> None:
        planes, others = (array.reshape(QUATERNION, -1) for array in (self._rotation, self._lattices.rotation))
        if rotation is not None:
            planes[:], others[:] = rotation[: planes.shape[1]].T, rotation[planes.shape[1] :].T
            return
        planes[:], others[:] = np.eye(QUATERNION, 1), np.eye(QUATERNION, 1)
        numba.set_num_threads(self.threads)
        self._match(self._rotation, self._lattices.rotation, self._material.view_steps, True)

    def _download_plastic(self) -> np.ndarray | None:
        plastic = self._material.plastic
        return plastic.reshape(-1, AXES, AXES).copy() if len(plastic) else None

    def _upload_plastic(self, plastic: np.ndarray | None) -> None:
        self._material.plastic.reshape(-1, AXES, AXES)[:] = np.eye(AXES) if plastic is None else plastic

    def _match_for_view(self) -> np.ndarray:
        """Return (clusters, 12): rotations, by rows, and centres of all clusters at the current positions."""
        numba.set_num_threads(self.threads)
        self._match(self._view_rotation, self._lattices.view_rotation, self._material.view_steps, True)
        return np.concatenate([self._frames, self._lattices.frames]).reshape(-1, FRAME)

    def _read_clusters(self) -> tuple[np.ndarray, np.ndarray]:
        centre = self._match_for_view()[:, 9:].copy()
        return _quaternions(self._view_rotation, self._lattices.view_rotation), centre

    def _read_deformation(self) -> np.ndarray:
        return self._match_for_view()[:, :9].reshape(-1, AXES, AXES).copy()
