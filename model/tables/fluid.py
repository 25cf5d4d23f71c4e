"""The parts that are fluids: blocks of particles, and the periodic box in which they are."""

from __future__ import annotations

from math import prod
from typing import Annotated, Literal

from pydantic import Field, model_validator

from softlab.model.base.table import ZERO, Count, NotNegative, Number, Part, Positive, Vector

SUPPORT = 1 / 0.55  # rest distances, by default
AMONG_BODIES = 2.0  # rest distances, by default with bodies: a lattice that hardly resists shear (model/fluid/shear.py)
NARROWEST, WIDEST = 1.2, 4.0  # supports in rest distances: 6 and 250 neighbours on the lattice
WIDER = 1.001  # a cell's edge over the support: particles that rounding brings within it lie in an adjacent cell
SUPPORTS_PER_SUBSTEP = 0.5  # supports that a particle moves in a substep, at most
REPEATED = 3  # cells along a periodic side, at least: the cells around a particle must be three different ones
MOST_ALONG = 1e9  # particles along a side of a block: no memory can hold more in one row
Flat = tuple[Number, Number]
Sides = tuple[Positive, Positive, Positive] | tuple[Positive, Positive]  # of a block, m
AxisName = Literal["x", "y", "z"]


class Block(Part):
    """One more block of a fluid."""

    origin: Vector | Flat = ZERO  # m, its lowest corner
    size: Sides  # m, along x, y and z


class Fluid(Part):
    """A fluid of particles that conserve its density: blocks of them on a lattice of `rest_distance`, half of one from
    the sides.

    The neighbours of a particle are those within `support` of it. Fluids of a scene have one rest distance and one
    support; their other fields may differ. The speed limit is half a support per substep, so that no contact is missed,
    or `maximum_speed`. With `dimensions = 2` everything is computed in the plane z = 0, for a layer one metre thick.
    """

    dimensions: Literal[2, 3] = 3
    origin: Vector | Flat = ZERO  # m, the lowest corner of the block
    size: Sides | None = None  # m, along x, y and, in space, z; whole rest distances; none: it starts empty
    capacity: Count | None = None  # largest number of particles, including inactive ones; by default the initial number
    blocks: tuple[Block, ...] = ()  # further blocks, [{ origin = [0.5, 0.0, 0.0], size = [0.2, 0.2, 0.2] }, ...]
    rest_distance: Positive = 0.05  # m, of the lattice that has its density
    support: Positive | None = None  # m, radius of interaction; by default rest_distance / 0.55, 2 of them among bodies
    density: Positive = 1000.0  # kg/m^3
    velocity: Vector = ZERO  # m/s, at the start
    vortices: NotNegative = 0.0  # m/s, added to it: Taylor and Green's vortices, in a domain that repeats along x and y
    viscosity: NotNegative = 0.0  # Pa s, by XSPH, in addition to that of the method itself
    cohesion: NotNegative = 0.0  # N/m: attraction between particles; the resulting surface tension differs
    surface_tension: NotNegative = 0.0  # N/m: flattens a surface; without cohesion it drives the surface apart
    vorticity_confinement: NotNegative = 0.0  # m/s: acceleration over the vorticity, perpendicular to it
    drag: NotNegative = 0.0  # 1/s: the rate at which velocities decay
    free_surface_drag: NotNegative = 0.0  # 1/s: the same for particles at a surface, by their lack of density
    buoyancy: Number = 1.0  # fraction of gravity that acts
    maximum_speed: Positive | None = None  # m/s
    maximum_acceleration: Positive | None = None  # m/s^2, by neighbours and walls

    @model_validator(mode="after")
    def _it_can_be_filled(self) -> Fluid:
        across = self.support_radius / self.rest_distance
        if self.support is not None and across < 1:
            raise ValueError(f"rest_distance: must be less than the support, {self.support:g} m")
        if not NARROWEST <= across <= WIDEST:
            raise ValueError(
                f"support: must be {NARROWEST:g} to {WIDEST:g} rest distances, {NARROWEST * self.rest_distance:g} to "
                f"{WIDEST * self.rest_distance:g} m"
            )
        if self.size is None and self.capacity is None:
            raise ValueError("size: must be given, or a capacity if an emitter fills the fluid")
        for place, one in enumerate(self.all_blocks, int(self.size is None)):
            field = "blocks" if place else "size"
            if len(one.size) != self.dimensions:
                reason = f"must have {self.dimensions} numbers in {self.dimensions} dimensions"
                raise ValueError(f"{field}: {reason}")
            if min(one.size) < self.rest_distance / 2:
                raise ValueError(f"{field}: holds no particle; a side is half a rest distance long at least")
            if max(one.size) / self.rest_distance > MOST_ALONG:
                raise ValueError(
                    f"{field}: holds more than {MOST_ALONG:g} particles along a side, {self.rest_distance:g} m apart; use a "
                    "smaller one, or a larger rest_distance"
                )
            if self.dimensions == 2 and len(one.origin) == 3 and one.origin[2] != 0:
                raise ValueError("origin: must lie in the plane z = 0 in 2 dimensions")
            if self.dimensions == 3 and len(one.origin) != 3:
                raise ValueError("origin: must have 3 numbers in 3 dimensions")
        if self.capacity is not None and self.capacity < self.starting_count:
            raise ValueError(f"capacity: must be at least what it starts with, {self.starting_count} particles")
        if self.dimensions == 2 and self.velocity[2] != 0:
            raise ValueError("velocity: must lie in the plane z = 0 in 2 dimensions")
        return self

    def _idle_fields(self) -> set[str]:
        return super()._idle_fields() | {name for name in ("size", "capacity") if getattr(self, name) is None}

    @property
    def support_radius(self) -> float:
        """Radius [m] within which a particle has neighbours."""
        return self.rest_distance * SUPPORT if self.support is None else self.support

    @property
    def all_blocks(self) -> tuple[Block, ...]:
        """All blocks of the fluid: of its own size, if it has one, and the others."""
        return self.blocks if self.size is None else (Block(origin=self.origin, size=self.size), *self.blocks)

    @property
    def starting_count(self) -> int:
        """Number of particles at the start."""
        return sum(prod(self.counts(block)) for block in self.all_blocks)

    @property
    def most(self) -> int:
        """Largest number of particles, including those that wait for an emitter."""
        return self.starting_count if self.capacity is None else self.capacity

    def speed_limit(self, substep: float) -> float:
        """Speed limit [m/s]: half a support radius per substep [s], or `maximum_speed` if that is smaller."""
        stable = SUPPORTS_PER_SUBSTEP * self.support_radius / substep
        return stable if self.maximum_speed is None else min(stable, self.maximum_speed)

    def counts(self, block: Block) -> tuple[int, ...]:
        """Return the number of particles along each side of a block."""
        return tuple(max(1, round(side / self.rest_distance)) for side in block.size)


class Domain(Part):
    """A periodic box: a fluid that leaves it through a repeating side enters through the opposite one."""

    origin: Vector | Flat = ZERO  # m, its lowest corner
    size: Sides  # m, along x, y and z
    repeats: Annotated[tuple[AxisName, ...], Field(min_length=1)] = ("x", "z")  # axes along which it repeats

    @model_validator(mode="after")
    def _each_axis_has_numbers(self) -> Domain:
        if len(self.origin) < len(self.size):
            raise ValueError(f"origin: must have {len(self.size)} numbers, as the size has")
        if "z" in self.repeats and len(self.size) < 3:
            raise ValueError("repeats: has a z, and the size none")
        return self


class Foam(Part):
    """Spray, foam and bubbles, drawn as points with the fluids (M. Ihmsen and others 2012): they form where fast fluid
    traps air or breaks over a crest. They do not act on the fluid: runs and their errors are the same without."""

    rate: NotNegative = 80.0  # 1/s, points per particle, at most
    speed: Positive | None = None  # m/s, at which `rate` is reached; by default sqrt(gravity times the fluids' length)
    lifetime: Positive = 3.0  # s, of the strongest foam; the weakest lives a quarter as long
    buoyancy: NotNegative = 2.0  # of gravity, upward, on bubbles
    drag: Positive | None = None  # 1/s, of bubbles; by default they rise at a seventh of the speed
    most: Annotated[int, Field(ge=1, le=10**6, strict=True)] = 50000  # points; the oldest are removed
    seed: Annotated[int, Field(ge=0, le=2**31 - 1, strict=True)] = 0


FLUID_KINDS: dict[str, type[Part]] = {"fluid": Fluid, "domain": Domain, "foam": Foam}
