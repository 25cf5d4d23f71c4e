"""The parts of tetrahedral bodies: the source of a mesh, its tetrahedra, its material."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, ClassVar, Literal, TypeVar

import numpy as np
from pydantic import Field, model_validator

from softlab.model.assets.cooked import Repair, cooked, is_settled
from softlab.model.assets.tetrahedral_body import CookedBody
from softlab.model.base.table import ZERO, AtLeastOne, Count, Flag, NotNegative, Part, Positive, Vector
from softlab.model.geometry.topology import mesh_path
from softlab.model.tables.mesh_source import MeshSource

MaterialName = Literal["fixed-corotated", "corotated", "neo-hookean"]
LARGEST_RATIO = 0.499  # above it lambda / mu is over 500, and linear tetrahedra lock
Poisson = Annotated[float, Field(ge=0, le=LARGEST_RATIO, strict=True)]


Value = TypeVar("Value", float, np.ndarray)


def lame_of(young: Value, poisson: Value) -> tuple[Value, Value]:
    """Return (mu, lambda) [Pa] of Young's modulus [Pa] and Poisson's ratio, numbers or arrays."""
    return young / (2 * (1 + poisson)), young * poisson / ((1 + poisson) * (1 - 2 * poisson))


class TetrahedralBody(MeshSource):
    """A soft body with a Young's modulus and a Poisson's ratio: tetrahedra cut from a lattice of voxels.

    Voxels at most `edge` long, or `voxels` of them along the longest side, each cut into `tetrahedra`: an integer
    number of them fills the box around the mesh along each axis, and those that the surface cuts contribute mass and
    stiffness by their part inside. Alternatively the tetrahedra of a file (.msh, .mesh, .vtk, .ele with .node, .npz),
    unchanged. The `material` has the energy per volume of the stretches s and the volume ratio J, mu sum (s - 1)^2 +
    lambda / 2 (J - 1)^2 (`fixed-corotated`), with (sum (s - 1))^2 in place of (J - 1)^2 (`corotated`), or the stable
    neo-Hookean one. `damping` is a time: a stress damping * the rate at which the elastic one changes. `pinned`: sides
    of the mesh's box, regions or `all`, whose vertices stay in place, or follow a motion. `volume`: under xpbd each of
    the `tetrahedra` conserves its volume, which locks near a Poisson's ratio of 1/2, or each of the `voxels` of five,
    which hardly does. `mass_ratio` limits the ratio of neighbouring vertices' masses. With a `[contact]` bodies collide
    with one another, and with themselves if `self_collision` is set.
    """

    such_as: ClassVar[str] = "beam"
    contradicts: ClassVar[Mapping[str, tuple[str, ...]]] = {
        **MeshSource.contradicts, "edge": ("voxels",), "voxels": ("edge",),
    }  # fmt: skip

    file: str | None = None  # as for other bodies; tetrahedra: .msh, .mesh, .vtk, .ele with .node, .npz
    fill_holes: Flag = False  # of the surface
    edge: Positive | None = None  # m, of a voxel at most
    voxels: Count = 10  # along the longest side, unless an edge is given
    tetrahedra: Literal[5, 6, "conforming"] = 5  # per voxel; six lock sooner; or conforming, which follow the surface
    sweep: Literal["voxels", "tetrahedra"] = "voxels"  # unit of a colour; a voxel's tetrahedra follow one another
    volume: Literal["tetrahedra", "voxels"] = "tetrahedra"  # unit of constant volume: near 1/2 voxels of five lock less
    material: MaterialName = "fixed-corotated"
    young_modulus: Positive = 1e6  # Pa
    poisson_ratio: Poisson = 0.45
    density: Positive = 1000.0  # kg/m^3
    damping: NotNegative = 0.0  # s
    self_collision: Flag = False  # its distant parts collide
    mass_damping: NotNegative = 0.0  # 1/s: the rate at which velocities decay, the same for all masses
    mass_ratio: AtLeastOne | None = None  # largest ratio of neighbours' masses, by default unlimited; the total stays
    pinned: tuple[str, ...] = ()  # of left, right (x), bottom, top (y), back, front (z), all, and names of regions
    velocity: Vector = ZERO  # m/s
    spin: Vector = ZERO  # rad/s, about its centre

    @model_validator(mode="after")
    def _can_be_cut(self) -> TetrahedralBody:
        if self.shape is not None and self.shape.name in ("sheet", "terrain"):
            raise ValueError(f"shape: a {self.shape.name} has no inside to fill; take a box, a blob, a star ...")
        if {"edge", "voxels"} <= self.model_fields_set and self.edge is not None:
            raise ValueError("edge: says how long a voxel is; give edge or voxels")
        if self.volume == "voxels" and (self.tetrahedra != 5 or self.sweep != "voxels" or self.material == "corotated"):
            reason = 'needs tetrahedra = 5, sweep = "voxels" and the material fixed-corotated or neo-hookean'
            raise ValueError(f"volume: {reason}; or leave it out")
        return self

    @cached_property
    def cooked(self) -> CookedBody:
        """The body at its mesh's position, neither rotated nor moved, cached on disk. Raises InputError, SceneError."""
        source = self.shape or mesh_path(self.file or "")
        voxels = None if self.edge is not None or is_settled(source) else self.voxels
        return cooked(
            source, edge=self.edge, voxels=voxels, per_voxel=self.tetrahedra, scale=self.scale, density=self.density,
            repair=Repair(fill_holes=self.fill_holes),
        )  # fmt: skip

    @property
    def lame(self) -> tuple[float, float]:
        """Return (mu, lambda) [Pa] of its Young's modulus and Poisson's ratio."""
        mu, lame = lame_of(self.young_modulus, self.poisson_ratio)
        return float(mu), float(lame)

    def _idle_fields(self) -> set[str]:
        idle = {"voxels" if self.edge is not None else "edge"}
        idle |= {name for name in ("self_collision", "mass_damping") if not getattr(self, name)}
        return super()._idle_fields() | idle


class Material(Part):
    """The material of tetrahedra whose centres lie in a `region`, of one `body` or of all; omitted fields are the
    body's. Of several tables that contain a tetrahedron the last counts."""

    region: str  # the name of a table of kind region
    body: str | None = None  # a tetrahedral one; by default all of them
    young_modulus: Positive | None = None  # Pa
    poisson_ratio: Poisson | None = None
    density: Positive | None = None  # kg/m^3
    damping: NotNegative | None = None  # s

    def _idle_fields(self) -> set[str]:
        return {name for name in type(self).model_fields if getattr(self, name) is None}


TETRAHEDRAL_KINDS: dict[str, type[MeshSource]] = {"tetrahedral_body": TetrahedralBody}
