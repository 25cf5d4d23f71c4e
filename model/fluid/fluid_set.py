"""All fluids of a scene as one set of particles: the initial state of its solvers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from softlab.model.core.errors import SceneError
from softlab.model.core.memory import MAX_PARTICLES, available_bytes, require
from softlab.model.fluid.lattice import Lattice, lattice_of
from softlab.model.geometry.arithmetic.functions import cosine, sine, whole_power
from softlab.model.geometry.particle_row import PARKED, ParticleRow
from softlab.model.scene.fluid import REPEATED, WIDER, Domain, Fluid

PARTICLE_BYTES = 700  # on the host: state, sorted copies, a list of 64 neighbours
OF_ALL = ("dimensions", "rest_distance", "support_radius")  # fields in which fluids of a scene must agree
MAX_FLUIDS = 64


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


def particle_count(parts: Mapping[str, Fluid]) -> int:
    """Return the number of particles of fluids, before any is made."""
    return sum(part.most for part in parts.values())


def check_fluids(parts: Mapping[str, Fluid], domain: Domain | None, domain_name: str) -> None:
    """Raise SceneError for fluids that disagree in common fields, are too many, or do not fit into memory or into their
    box."""
    (first, one), *others = parts.items()
    for name, other in others:
        for field in OF_ALL:
            if getattr(other, field) != getattr(one, field):
                told = f"must be that of {first}, {getattr(one, field):g}: fluids of a scene meet"
                raise SceneError(f"{name}.{field.removesuffix('_radius')}", getattr(other, field), told)
    if len(parts) > MAX_FLUIDS:
        raise SceneError(first, len(parts), f"at most {MAX_FLUIDS} fluids")
    count = particle_count(parts)
    field, told = f"{first}.rest_distance", f"{one.rest_distance:g} m, {count} particles"
    if count > MAX_PARTICLES:
        raise SceneError(field, told, f"at most {MAX_PARTICLES} particles (32-bit indices)")
    require(count * PARTICLE_BYTES, available_bytes(), field, told, "main memory")
    for name, part in parts.items():
        if part.vortices and (domain is None or not {"x", "y"} <= set(domain.repeats)):
            raise SceneError(f"{name}.vortices", part.vortices, "needs a domain that repeats along x and y")
    if domain is None:
        return
    if len(domain.size) < one.dimensions:
        raise SceneError(f"{domain_name}.size", list(domain.size), f"must have {one.dimensions} numbers")
    if one.dimensions == 2 and "z" in domain.repeats:
        told = f'must be of x and y in 2 dimensions, such as repeats = ["{domain.repeats[0]}"]'
        raise SceneError(f"{domain_name}.repeats", list(domain.repeats), told)
    least = REPEATED * WIDER * one.support_radius
    for axis in domain.repeats:
        if domain.size["xyz".index(axis)] < least:
            told = f"must be {REPEATED} supports long at least where it repeats, {least:g} m along {axis}"
            raise SceneError(f"{domain_name}.size", list(domain.size), told)


def check_among_solids(scene: Any) -> None:
    """Raise SceneError for a scene of fluids that cannot interact with solids."""
    if scene.dimensions == 2:
        told = "must be 3 where a fluid meets solids, which lie in space"
        raise SceneError(f"{next(iter(scene.fluids))}.dimensions", 2, told)
    if scene.domain is not None:
        told = "is not supported together with solids, which have no periodic sides; leave it out"
        raise SceneError(f"{scene.name_of('domain')}.kind", "domain", told)
    if scene.method.scheme != "macklin":
        raise SceneError("method.scheme", scene.method.scheme, "must be macklin where a fluid meets solids")


def vortices(place: np.ndarray, domain: Domain) -> np.ndarray:
    """Return velocities of G. I. Taylor and A. E. Green's vortices, of speed 1, (n, dimensions), at positions [m] of a
    periodic box.

    There is one wave along x and along y.
    """
    x, y = (2 * np.pi * (place[:, axis] - domain.origin[axis]) / domain.size[axis] for axis in (0, 1))
    found = np.zeros_like(place)
    found[:, 0], found[:, 1] = sine(x) * cosine(y), -cosine(x) * sine(y) * domain.size[1] / domain.size[0]
    return found


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
