"""The parts that are bodies made from meshes: their source, their copies, and their initial positions."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, model_validator

from softlab.model.assets.baked import baked
from softlab.model.assets.baked_body import BakedBody
from softlab.model.assets.soft_body import MATERIAL, RigidBody, SoftBody
from softlab.model.assets.soft_lattice import SoftLattice
from softlab.model.assets.soft_sheet import SoftSheet
from softlab.model.base.table import ZERO, Count, NotNegative, Part, Positive, Vector
from softlab.model.geometry.measures import rotation_about
from softlab.model.geometry.topology import mesh_path
from softlab.model.tables.mesh_source import MeshSource

MAX_COPIES = 1_000_000
Copies = tuple[Count, Count, Count]
Spare = Annotated[int, Field(ge=0, le=MAX_COPIES, strict=True)]
Group = Annotated[int, Field(ge=0, le=31, strict=True)]


class Placed(MeshSource):
    """Initial positions of a body's copies: a block of `copies` along x, y and z, `apart` from each other, the first at
    `origin`. Each is rotated by `angle` about `axis` through the mesh's origin, moves at `velocity` and spins at `spin`
    about its centre."""

    such_as: ClassVar[str] = "star"
    contradicts: ClassVar[Mapping[str, tuple[str, ...]]] = {
        **MeshSource.contradicts, "density": ("mass",), "mass": ("density",),
    }  # fmt: skip

    copies: Copies = (1, 1, 1)
    spare: Spare = 0  # further copies, inactive until `Simulation.add_body` activates them
    apart: Vector = (1.0, 1.0, 1.0)  # m
    velocity: Vector = ZERO  # m/s
    spin: Vector = ZERO  # rad/s
    radius: Positive | None = None  # m, of a particle in contacts; half the particle spacing
    group: Group = 0  # number that others may avoid
    avoids: tuple[Group, ...] = ()  # groups that its particles pass through
    self_collision: bool | None = None  # whether the body collides with itself; by default a soft one does
    adhesion: NotNegative = 0.0  # m/s^2, holding acceleration of contacts that are pulled apart; of two the larger

    @model_validator(mode="after")
    def _can_be_placed(self) -> Placed:
        if self.shape is not None and self.shape.name == "terrain":
            raise ValueError("shape: a terrain is a surface that bodies fall on; it belongs to a mesh_collider")
        if self.count > MAX_COPIES:
            raise ValueError(f"copies: at most {MAX_COPIES} together")
        return self

    @property
    def count(self) -> int:
        """Number of copies."""
        return self.copies[0] * self.copies[1] * self.copies[2]

    @property
    def contact_radius(self) -> float:
        """Radius of a particle in contacts [m]."""
        return self.baked.spacing / 2 if self.radius is None else self.radius

    @property
    def self_colliding(self) -> bool:
        """True if the body's particles collide with those of the same copy."""
        return isinstance(self, SoftBody) if self.self_collision is None else self.self_collision

    @cached_property
    def baked(self) -> BakedBody:
        """The body, from the user's cache if it was made before. Raises SceneError, InputError."""
        if not isinstance(self, RigidBody):
            raise TypeError("a placed body is a soft or a rigid one")
        body_class = next(kind for kind in (SoftSheet, SoftLattice, SoftBody, RigidBody) if isinstance(self, kind))
        stated = {name: getattr(self, name) for name in body_class.model_fields if name in self.model_fields_set}
        parameters = body_class(**stated)
        source = self.shape if self.shape is not None else mesh_path(self.file or "")
        return baked(parameters, source, scale=self.scale)

    def places(self) -> np.ndarray:
        """Return the origin of each copy's mesh, (copies, 3) float64 [m], x first."""
        nx, ny, nz = self.copies
        z, y, x = np.meshgrid(np.arange(nz), np.arange(ny), np.arange(nx), indexing="ij")
        steps = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
        return np.asarray(self.origin) + steps * np.asarray(self.apart)

    def turn(self) -> np.ndarray:
        """Return the initial rotation, (3, 3) float64."""
        return rotation_about(self.axis, self.angle)

    def _idle_fields(self) -> set[str]:
        assert isinstance(self, RigidBody)
        idle = {*self.lacks, "density" if self.mass is not None else "mass"}
        return super()._idle_fields() | idle | {name for name in MATERIAL if not getattr(self, name, None)}


class SoftBodyPart(Placed, SoftBody):
    """A soft body, see model/assets/soft_body.py, and its copies."""


class SoftSheetPart(Placed, SoftSheet):
    """A sheet of cloth, see model/assets/soft_sheet.py, and its copies."""


class SoftLatticePart(Placed, SoftLattice):
    """A box filled with a regular lattice, see model/assets/soft_lattice.py, and its copies."""


class RigidBodyPart(Placed, RigidBody):
    """A rigid body and its copies."""


BODY_KINDS: dict[str, type[Part]] = {
    "soft_body": SoftBodyPart,
    "soft_sheet": SoftSheetPart,
    "soft_lattice": SoftLatticePart,
    "rigid_body": RigidBodyPart,
}
