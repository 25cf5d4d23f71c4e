"""All fluids of a scene as one set of particles: the initial state of its solvers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softlab.model.geometry.arithmetic.functions import cosine, sine, whole_power
from softlab.model.geometry.particle_row import PARKED, ParticleRow
from softlab.model.particles.fluid_lattice import Lattice, lattice_of
from softlab.model.tables.fluid import Domain, Fluid


@dataclass(frozen=True, eq=False)
class FluidSet(ParticleRow):
    """The particles of all fluids, one block after the other, in the order of the file; x runs fastest, then y.

    `position`, `velocity`: (particles, dimensions) float64 [m], [m/s]; `fluid`: (particles,) int32, index into `parts`.
    The last particles of a fluid wait for an emitter, and are PARKED. It has the attributes of a row of masses: `rows`
    1, `columns` the number of particles, `spacing` the rest distance [m], `mass` that of a particle of the first fluid
    [kg].
    """

    names: tuple[str, ...]
    parts: tuple[Fluid, ...]
    position: np.ndarray
    velocity: np.ndarray
    fluid: np.ndarray
    pinned: str = "none"

    @property
    def dimensions(self) -> int:
        """Number of dimensions, 2 or 3."""
        return self.parts[0].dimensions

    @property
    def spacing(self) -> float:
        """Rest distance [m]."""
        return self.parts[0].rest_distance

    @property
    def support(self) -> float:
        """Support radius [m]."""
        return self.parts[0].support_radius

    @property
    def lattice(self) -> Lattice:
        """Scales of the kernels."""
        return lattice_of(self.spacing, self.support, self.dimensions)

    @cached_property
    def particle_masses(self) -> tuple[float, ...]:
        """Mass of a particle of each fluid [kg], that of a cell of its lattice; a plane has a layer one metre thick."""
        return tuple(part.density * whole_power(self.spacing, self.dimensions) for part in self.parts)

    @property
    def mass(self) -> float:
        """Mass of a particle of the first fluid [kg]; those of others enter by their `lightness`."""
        return self.particle_masses[0]

    @property
    def lightest(self) -> float:
        """Mass of a particle of the first fluid [kg], by which solvers scale."""
        return self.mass

    @property
    def waiting(self) -> np.ndarray:
        """Particles that wait for an emitter, (particles,) bool."""
        return ~self.there(self.position)

    @property
    def pinned_vertices(self) -> np.ndarray:
        """Pinned particles: none, (0,) int64."""
        return np.zeros(0, np.int64)

    @property
    def masses(self) -> np.ndarray:
        """Mass of each particle, (particles,) float64 [kg]."""
        return np.array(self.particle_masses)[self.fluid]

    @cached_property
    def lightness(self) -> tuple[float, ...]:
        """Density of the first fluid over that of each fluid."""
        return tuple(self.parts[0].density / part.density for part in self.parts)

    @property
    def extent(self) -> float:
        """Longest side [m]."""
        there = self.position[self.there(self.position)]
        return (float(np.ptp(there, axis=0).max()) if len(there) else 0.0) + self.spacing

    @property
    def starting(self) -> tuple[int, ...]:
        """Number of each fluid's active particles at the start."""
        return tuple(part.starting_count for part in self.parts)

    @property
    def capacities(self) -> tuple[int, ...]:
        """Capacity of each fluid."""
        return tuple(part.most for part in self.parts)

    def there(self, position: np.ndarray) -> np.ndarray:
        """Return which particles are active, (particles,) bool, by positions (particles, dimensions) in any
        precision."""
        return np.asarray(position[:, 0] != PARKED)

    def __str__(self) -> str:
        """`4000 particles of 2 fluids`."""
        fluids = "1 fluid" if len(self.parts) == 1 else f"{len(self.parts)} fluids"
        return f"{self.particle_count} particles of {fluids}"


def vortices(place: np.ndarray, domain: Domain) -> np.ndarray:
    """Return velocities of G. I. Taylor and A. E. Green's vortices, of speed 1, (n, dimensions), at positions [m] of a
    periodic box.

    There is one wave along x and along y.
    """
    x, y = (2 * np.pi * (place[:, axis] - domain.origin[axis]) / domain.size[axis] for axis in (0, 1))
    velocity = np.zeros_like(place)
    velocity[:, 0], velocity[:, 1] = sine(x) * cosine(y), -cosine(x) * sine(y) * domain.size[1] / domain.size[0]
    return velocity


def make_fluid_set(parts: Mapping[str, Fluid], domain: Domain | None = None) -> FluidSet:
    """Return the set of a scene's fluids, by name, in the scene's box."""
    axes = next(iter(parts.values())).dimensions
    positions, velocities, numbers = [], [], []
    for number, part in enumerate(parts.values()):
        for block in part.all_blocks:
            counts = part.counts(block)
            steps = np.indices(counts[::-1]).reshape(axes, -1)[::-1].T  # x fastest
            positions.append(np.array(block.origin)[:axes] + (steps + 0.5) * part.rest_distance)
            velocity = np.tile(np.array(part.velocity)[:axes], (len(steps), 1))
            if part.vortices and domain is not None:
                velocity = velocity + part.vortices * vortices(positions[-1], domain)
            velocities.append(velocity)
            numbers.append(np.full(len(steps), number, np.int32))
        waiting = part.most - part.starting_count
        positions.append(np.full((waiting, axes), PARKED))
        velocities.append(np.zeros((waiting, axes)))
        numbers.append(np.full(waiting, number, np.int32))
    return FluidSet(
        names=tuple(parts),
        parts=tuple(parts.values()),
        position=np.concatenate(positions),
        velocity=np.concatenate(velocities),
        fluid=np.concatenate(numbers),
    )
