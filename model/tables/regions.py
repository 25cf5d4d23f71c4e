"""The part `region`: parts of bodies by their initial position, in boxes, balls, capsules, half-spaces, or closed
meshes."""

from __future__ import annotations

from functools import cached_property
from math import hypot
from typing import ClassVar, Literal

import numpy as np
from pydantic import model_validator

from softlab.model.base.errors import InputError
from softlab.model.base.table import ZERO, Flag, Number, Part, Positive, Vector
from softlab.model.geometry.arithmetic.ordered import applied, dot, norm
from softlab.model.geometry.measures import rotation_about
from softlab.model.geometry.mesh import TriangleMesh, read_mesh
from softlab.model.geometry.shapes import Shape
from softlab.model.geometry.solid import solid
from softlab.model.geometry.topology import mesh_path
from softlab.model.geometry.voxels import winding_numbers
from softlab.model.tables.mesh_source import check_axis, check_digest

Side = Literal["left", "right", "bottom", "top", "back", "front"]  # of x, y and z: the lower one first
SIDES: tuple[Side, ...] = ("left", "right", "bottom", "top", "back", "front")
WORDS = (*SIDES, "all")
# a region has one of these
FIELD_SETS = (("low", "high"), ("center",), ("start", "end"), ("point", "normal"), ("shape",), ("file",))
OF_MESHES = ("scale", "fill_holes", "origin", "angle", "axis")


class Region(Part):
    """A region of space at the scene's start, by which tables of bodies select their vertices or tetrahedra.

    One of: a box from `low` to `high`, unbounded without one of them; a ball of `radius` about `center`; a capsule, all
    points within `radius` of the segment from `start` to `end`; the side of the plane through `point` to which `normal`
    points; or the inside of a closed mesh, one of the lab's `shape`s or a `file`, rotated by `angle` about `axis` and
    moved to `origin`.
    """

    choices: ClassVar[str] = "low and high, center and radius, start, end and radius, point and normal, shape, or file"

    low: Vector | None = None  # m
    high: Vector | None = None  # m
    center: Vector | None = None  # m
    start: Vector | None = None  # m
    end: Vector | None = None  # m
    radius: Positive | None = None  # m
    point: Vector | None = None  # m
    normal: Vector | None = None
    shape: Shape | None = None  # one of the lab's
    file: str | None = None  # .obj, .stl, .ply, .off, .glb, .gltf, .mesh or .msh
    digest: str | None = None  # of the file's bytes, stored where the scene is written: the file must still match
    scale: Positive = 1.0  # m per unit of the file
    fill_holes: Flag = False  # of a file
    origin: Vector = ZERO  # m
    angle: Number = 0.0  # degrees
    axis: Vector = (0.0, 1.0, 0.0)

    @model_validator(mode="after")
    def _is_one_of_them(self) -> Region:
        stated = [fields for fields in FIELD_SETS if any(getattr(self, field) is not None for field in fields)]
        if len(stated) != 1:
            raise ValueError(f"shape: a region is given by one of: {self.choices}")
        (fields,) = stated
        missing = [field for field in fields if getattr(self, field) is None and fields != ("low", "high")]
        round_one = fields in (("center",), ("start", "end"))
        if missing or round_one != (self.radius is not None):
            field = (missing or ["radius"])[0]
            raise ValueError(f"{field}: a region is given by one of: {self.choices}")
        if self.normal is not None and hypot(*self.normal) == 0:
            raise ValueError("normal: must not be zero")
        check_axis(self.angle, self.axis)
        if self.low and self.high and any(a > b for a, b in zip(self.low, self.high, strict=True)):
            raise ValueError(f"high: must be at least low, {list(self.low)}")
        if self.shape is not None and self.shape.name in ("sheet", "terrain"):
            raise ValueError(f"shape: a {self.shape.name} has no inside; take a box, a beam, a torus ...")
        if self.file is None and self.scale != 1:
            raise ValueError("scale: belongs to a file; a shape has a scale of its own")
        if self.file is None and self.fill_holes:
            raise ValueError("fill_holes: belongs to a file; the lab's shapes have none")
        check_digest(self)
        return self

    def _idle_fields(self) -> set[str]:
        idle = {name for name in type(self).model_fields if getattr(self, name) is None}
        idle |= set() if self.fill_holes else {"fill_holes"}
        return idle if self.shape or self.file else idle | set(OF_MESHES)

    def holds(self, position: np.ndarray, near: float) -> np.ndarray:
        """Return which of `position` (points, 3) [m] lie in the region, or at most `near` [m] outside, (points,) bool.

        For a mesh: inside. Raises InputError for a mesh without an inside.
        """
        if self.point is not None and self.normal is not None:
            normal = np.asarray(self.normal) / hypot(*self.normal)
            return np.asarray(dot(position - self.point, normal) >= -near)
        if self.radius is not None:
            start = np.asarray(self.start or self.center)
            axis = np.asarray(self.end or start) - start
            squared = float(dot(axis, axis))
            fraction = np.clip(dot(position - start, axis) / squared, 0, 1) if squared else np.zeros(len(position))
            apart = position - start - fraction[:, None] * axis
            return np.asarray(norm(apart) <= self.radius + near)
        if self.shape is not None or self.file is not None:
            return np.asarray(winding_numbers(position, *self._surface) > 0.5)
        low = -np.inf if self.low is None else np.asarray(self.low) - near
        high = np.inf if self.high is None else np.asarray(self.high) + near
        return np.asarray(((position >= low) & (position <= high)).all(axis=1))

    @cached_property
    def _surface(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (vertices (n, 3) [m], triangles) in the scene's coordinates. Raises InputError."""
        mesh: TriangleMesh = (
            self.shape.mesh() if self.shape else read_mesh(mesh_path(self.file or ""), self.scale, True)
        )
        try:
            body = solid(mesh, 0.0, "a box, a ball or a capsule", self.fill_holes)
        except InputError as error:
            raise InputError(f"{self.file or 'shape'}: {error}") from None
        return applied(rotation_about(self.axis, self.angle), body.position) + self.origin, body.triangles
