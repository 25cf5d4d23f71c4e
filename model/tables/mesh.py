"""The part `mesh`: a cloth of any triangles, read from a file, or a rectangular sheet cut into triangles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal

import numpy as np
from pydantic import field_validator, model_validator

from softlab.model.base.pins import MeshPins, checked_pins
from softlab.model.base.table import Count, Part, Positive
from softlab.model.geometry.normals import mesh_normals
from softlab.model.geometry.topology import describe, mesh_of, vertex_masses
from softlab.model.tables.cloth import Cloth
from softlab.model.tables.mesh_source import OF_FILES

Diagonals = Literal["one", "alternating"]
OF_SHEETS = ("shape", "rows", "columns", "spacing", "diagonals", "placement")
FILE_PINS = "none, top (the highest vertices) or a list of vertices, numbered from 0 as in the file"


class Mesh(Cloth):
    """A cloth whose edges are those of a triangle mesh, solved position-based: `[method] solver = "xpbd"`.

    From a `file` (.obj, .stl, .ply, .off, .glb ...; one of model/catalogue/meshes, or a path), or `shape = "sheet"`: a
    cloth's rows and columns, with every cell split along the diagonal from its first mass (`one`), or cells along
    either diagonal in turn (`alternating`). Each vertex has `mass`, or a third of every triangle at it times `density`.
    The other fields are a cloth's; for a file `rows` is 1, `columns` the number of vertices, `spacing` the mean edge,
    `mass` the mean mass. In a scene with a `[contact]` it collides with tetrahedral bodies, on both sides, and
    attachments can hold it.
    """

    contradicts: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "density": ("mass",), "mass": ("density",), "file": ("digest", *OF_SHEETS), "shape": OF_FILES,
    }  # fmt: skip

    rows: Count = 1
    columns: Count = 1
    file: str | None = None
    digest: str | None = None  # of the file's bytes, stored where the scene is written: the file must still match
    scale: Positive = 1.0  # m per unit of the file
    shape: Literal["sheet"] | None = None
    diagonals: Diagonals = "one"
    density: Positive | None = None  # kg/m^2
    pinned: MeshPins = "none"  # none, top, or for a file a list of vertices, numbered from 0

    @model_validator(mode="before")
    @classmethod
    def _one_source(cls, fields: object) -> object:
        if not isinstance(fields, dict):
            return fields
        if ("file" in fields) == ("shape" in fields):
            raise ValueError('file: give either a file or shape = "sheet"')
        for name in OF_SHEETS if "file" in fields else OF_FILES:
            if name in fields:
                raise ValueError(f"{name}: belongs to {'a sheet' if 'file' in fields else 'a file'}; leave it out")
        if "density" in fields and "mass" in fields:
            raise ValueError("density: gives every vertex its mass; give density or mass")
        return fields

    @field_validator("pinned", mode="before")
    @classmethod
    def _pinned_is_a_word_or_a_list(cls, value: object) -> object:
        if isinstance(value, list | tuple) and all(type(k) is int for k in value):
            return list(value)
        return checked_pins(value)

    @model_validator(mode="after")
    def _is_valid(self) -> Mesh:
        """Read the file and set the fields that follow from the mesh."""
        if self.file is not None and not (self.pinned in ("none", "top") or _vertices(self.pinned)):
            raise ValueError(f"pinned: {FILE_PINS}")
        if self.file is None and self.pinned and _vertices(self.pinned):
            raise ValueError("pinned: a sheet's masses must be given as [[row, column], ...]")
        if self.file is None:
            self._check_pins()
        self.__dict__.update(describe(self))  # the part is frozen for other code
        return self

    @property
    def extent(self) -> float:
        """Longest side [m]."""
        return float((mesh_of(self).position.max(axis=0) - mesh_of(self).position.min(axis=0)).max())

    def triangles(self) -> np.ndarray:
        """Return the triangles, (triangles, 3) uint32, as in the file."""
        return mesh_of(self).triangles.astype(np.uint32)

    def masses_by_area(self) -> np.ndarray | None:
        """Return the masses of the vertices from `density`, see Grid."""
        return None if self.density is None else vertex_masses(self)

    def normals(self, position: np.ndarray) -> np.ndarray:
        """Return the unit normals of the vertices at `position` (particles, 3), (particles, 3) float64."""
        return mesh_normals(position, self.triangles())

    def _idle_fields(self) -> set[str]:
        """Return the fields that must not be written, so that the written scene can be read again."""
        return {"density" if self.density is None else "mass", *(OF_FILES if self.file is None else OF_SHEETS)}


def _vertices(pinned: object) -> bool:
    return isinstance(pinned, list) and all(isinstance(k, int) for k in pinned)


MESH_KINDS: dict[str, type[Part]] = {"mesh": Mesh}
