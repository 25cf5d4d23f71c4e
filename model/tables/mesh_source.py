"""The common base of parts made from a mesh, bodies and colliders: its source, position and rotation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Protocol

from pydantic import model_validator

from softlab.model.base.table import ZERO, Number, Part, Positive, Vector
from softlab.model.geometry.shapes import Shape
from softlab.model.geometry.topology import file_digest, mesh_path

OF_FILES = ("file", "digest", "scale")


class FromFile(Protocol):
    """A part that may come from a file; `digest`: the stated one."""

    file: str | None
    digest: str | None


def check_axis(angle: float, axis: Vector) -> None:
    """Raise ValueError where a part is rotated about a zero axis."""
    if angle != 0 and not any(axis):
        raise ValueError("axis: must point somewhere, such as [0.0, 1.0, 0.0]")


def check_digest(part: FromFile) -> None:
    """Store the digest of a part's file in the part. Raises ValueError where it differs from the stated one."""
    if part.file is not None:
        digest = file_digest(mesh_path(part.file))
        if part.digest not in (None, digest):
            raise ValueError(f"digest: {part.file} is another file by now ({digest}); leave it out")
        part.__dict__["digest"] = digest  # the part is frozen for other code


class MeshSource(Part):
    """A part made from one of the lab's shapes or from a file."""

    such_as: ClassVar[str]  # a shape for the message where none is given
    contradicts: ClassVar[Mapping[str, tuple[str, ...]]] = {"shape": OF_FILES, "file": ("shape", "digest")}

    shape: Shape | None = None  # one of the lab's
    file: str | None = None  # .obj, .stl, .ply, .off, .glb, .gltf, .mesh or .msh
    digest: str | None = None  # of the file's bytes, stored where the scene is written: the file must still match
    scale: Positive = 1.0  # m per unit of the file
    origin: Vector = ZERO  # m
    angle: Number = 0.0  # degrees
    axis: Vector = (0.0, 1.0, 0.0)

    @model_validator(mode="after")
    def _one_source(self) -> MeshSource:
        if (self.shape is None) == (self.file is None):
            raise ValueError(f'file: give either a file or a shape, such as shape = {{ name = "{self.such_as}" }}')
        if self.shape is not None and (self.digest is not None or self.scale != 1):
            raise ValueError("scale: belongs to a file; a shape has a scale of its own")
        if self.shape is not None and getattr(self, "fill_holes", False):
            raise ValueError("fill_holes: belongs to a file; the lab's shapes have none")
        check_axis(self.angle, self.axis)
        check_digest(self)
        return self

    def _idle_fields(self) -> set[str]:
        """Return the fields that must not be written, so that the written scene can be read again."""
        idle = set(OF_FILES) if self.shape is not None else {"shape"}
        idle |= set() if getattr(self, "fill_holes", None) else {"fill_holes"}
        return super()._idle_fields() | idle | {name for name in type(self).model_fields if getattr(self, name) is None}
