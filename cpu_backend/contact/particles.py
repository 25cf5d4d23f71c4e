"""Contacts between particles of bodies on CPU threads: the stages "find neighbours", "project contacts" and "bounce",
and their arrays (model/tables/particle_contact.py). Particles are in the order of
cpu_backend/shape_matching/layout.py."""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.contact.arrays import ContactArrays, Contacts, PairRows
from softlab.cpu_backend.contact.neighbours import Neighbours
from softlab.cpu_backend.contact.particles_bounce import make_bounce_stage
from softlab.cpu_backend.contact.particles_cells import AXES
from softlab.cpu_backend.contact.particles_project import make_clear_stage, make_project_stage
from softlab.cpu_backend.core.layout import aligned_zeros
from softlab.model.base.types import Real
from softlab.model.contact.particle_parameters import (
    G_SEARCH_RADIUS,
    MAX_NEIGHBOURS,
    kinds_of_particles,
    pair_rows,
    particle_contact_record,
)
from softlab.model.scene.scene import Scene


class ParticleContacts:
    """The contacts of a substep. `slots` (particles,): place of each particle in planes of `count`; `bands`: threads.

    `find` searches the `neighbours` of particles at predicted positions; `project` sweeps over the contacts among them.
    Both take positions as three planes, flat, and `weights` (count,), inverse masses of any unit; a particle of weight
    0 has no contacts. `old`: buffer for the velocities at the start of the substep, if particles bounce; `bounce` takes
    those at its end. `arrays` is the argument of kernels.
    """

    def __init__(
        self, scene: Scene, real: Real, math: str, parts: frozenset[str], slots: np.ndarray, count: int, bands: int
    ):
        assert scene.contact is not None
        self.real, self.bands, self.sweeps = real, bands, scene.contact.sweeps
        rest: np.ndarray
        body, kind, rest = np.zeros(count, np.int32), np.zeros(count, np.int32), np.zeros(AXES * count, real)
        body[slots], kind[slots] = scene.body_set.body, kinds_of_particles(scene)
        rest.reshape(AXES, -1)[:, slots] = scene.body_set.position.T
        self.neighbours = Neighbours(real, math, body, kind, rest, len(scene.bodies), bands)
        acting = np.zeros(count * MAX_NEIGHBOURS, np.uint32)  # unsigned: no check for negative indices
        self._keeps = "rigid-motion" in parts
        pressed: np.ndarray = np.zeros(len(acting) if self._keeps else 0, real)
        self._contacts = Contacts(acting, np.zeros(count, real), np.zeros(AXES * count, real), pressed)
        self.old = aligned_zeros(AXES * count if "contact-restitution" in parts else 0, real)
        variant = "contact-friction" in parts, "contact-adhesion" in parts, self._keeps, "couples" in parts
        self._project, self._clear = make_project_stage(real, math, *variant), make_clear_stage(real, math)
        self._bounce = make_bounce_stage(real, math)
        self.change(scene)

    def change(self, scene: Scene) -> None:
        """Apply the parameters that may change during a run."""
        self.record = particle_contact_record(scene, self.real)
        self.reach = self.real(pair_rows(scene)[:, :, G_SEARCH_RADIUS].max())

    @property
    def lost(self) -> int:
        return self.neighbours.lost

    @property
    def arrays(self) -> ContactArrays:
        """Arrays of the contacts, as kernels take them."""
        rows = PairRows(self.record, self.reach, self.neighbours.kinds)
        return ContactArrays(rows, self.sweeps, self.neighbours.search, self._contacts, self.old)

    def find(self, position: np.ndarray, weights: np.ndarray) -> None:
        self.neighbours.find(position, weights, self.record, self.reach)
        if self._keeps:
            self._clear(self.bands, self.neighbours.pair_lists, self._contacts)

    def project(
        self,
        before: np.ndarray,
        position: np.ndarray,
        weights: np.ndarray,
        travel: np.ndarray | None = None,
        couples: np.ndarray | None = None,
    ) -> None:
        """Sweep over the contacts. `travel`: of shape_matching/particles.py, if bodies are rigid; `couples`: of
        shape_matching/couples.py, if friction turns clusters."""
        self._project(
            self.bands, before, position, weights, self.arrays,
            *(np.zeros_like(position) if one is None else one for one in (travel, couples)),
        )  # fmt: skip

    def bounce(self, position: np.ndarray, velocity: np.ndarray, weights: np.ndarray) -> None:
        self._bounce(self.bands, position, velocity, weights, self.arrays)
