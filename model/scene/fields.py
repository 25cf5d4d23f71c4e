"""Reference of a scene file's tables, generated from the parts: fields, defaults, and their comments."""

from __future__ import annotations

import inspect
import re
from dataclasses import dataclass
from typing import Literal, get_args, get_origin

from annotated_types import Ge, Gt, Le
from pydantic.fields import FieldInfo

from softlab.model.base.errors import SceneError
from softlab.model.base.table import Part
from softlab.model.base.words import notes_of, suggestion
from softlab.model.geometry.shapes import Shape
from softlab.model.tables.kinds import KINDS
from softlab.model.tables.mesh_source import MeshSource
from softlab.model.tables.parts import CAMERA, CameraPart
from softlab.model.tables.tank import TANK, Tank

TABLES = KINDS | {TANK: Tank, CAMERA: CameraPart, "shape": Shape}  # a shape is a field of a body or mesh, not a table
REQUIRED = "(must be given)"
WIDE = 2**31 - 1  # no bound for a reader: the limit of an index or a seed


@dataclass(frozen=True)
class Row:
    """A field of a table: its `default` as in a file, the `allowed` values, and a `note`, mostly its unit."""

    name: str
    default: str
    allowed: str
    note: str


def kind_named(kind: str) -> type[Part]:
    """Return the class of the part of that kind. Raises SceneError."""
    if kind not in TABLES:
        raise SceneError("--fields", kind, f"unknown kind{suggestion(kind, TABLES)}; known: {', '.join(TABLES)}")
    return TABLES[kind]


def about(kind: str) -> str:
    """Return the description of a kind of table: the docstrings of its part and of the bases that it shares with
    others.

    Other kinds from which it is derived are left out. Raises SceneError.
    """
    part = kind_named(kind)
    untold = (Part, MeshSource, *TABLES.values())
    owners = [part, *(owner for owner in part.__mro__[1:] if issubclass(owner, Part) and owner not in untold)]
    return "\n\n".join(_unwrapped(owner.__doc__ or "") for owner in owners)


def _unwrapped(docstring: str) -> str:
    """Return a docstring with one line for each paragraph and each item of a list."""
    paragraphs = [re.split(r"\n(?=- )", text) for text in inspect.cleandoc(docstring).split("\n\n")]
    return "\n\n".join("\n".join(" ".join(item.split()) for item in items) for items in paragraphs)


def rows_of(kind: str) -> list[Row]:
    """Return the fields of a table of that kind, in their order. Raises SceneError."""
    part = kind_named(kind)
    notes = notes_of(part)
    return [
        Row(name, _default(field), _allowed(field), notes.get(name, "")) for name, field in part.model_fields.items()
    ]


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return REQUIRED
    value: object = field.get_default(call_default_factory=True)
    if value is None:
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    return str(list(value)) if isinstance(value, tuple) else f"{value:g}" if isinstance(value, float) else str(value)


def _allowed(field: FieldInfo) -> str:
    """Return the bounds of a field, or the words that it accepts."""
    marks = marks_of(field)
    bounds = [f"> {_number(m.gt)}" for m in marks if isinstance(m, Gt)]
    bounds += [f">= {_number(m.ge)}" for m in marks if isinstance(m, Ge)]
    bounds += [
        f"<= {_number(m.le)}" for m in marks if isinstance(m, Le) and isinstance(m.le, int | float) and m.le < WIDE
    ]
    words = [str(word) for word in _leaves(field.annotation)]
    return ", ".join(dict.fromkeys(bounds or words))


def _number(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def marks_of(field: FieldInfo) -> list[object]:
    """Return the bounds of a field, including those within its annotation: of `Positive | None`, of a list's numbers."""
    return [*field.metadata, *_marks(field.annotation)]


def _marks(annotation: object) -> list[object]:
    marks: list[object] = []
    for part in get_args(annotation):
        marks += part.metadata if isinstance(part, FieldInfo) else [part] if isinstance(part, Ge | Gt | Le) else []
        marks += _marks(part)
    return marks


def _leaves(annotation: object) -> list[object]:
    """Return the values of all literals within an annotation."""
    if not get_args(annotation):
        return []
    if get_origin(annotation) is Literal:
        return list(get_args(annotation))
    return [leaf for part in get_args(annotation) for leaf in _leaves(part)]


def document() -> str:
    """Return the part of docs/scene.md about every kind of table: its fields, defaults, bounds and units."""
    lines: list[str] = []
    for kind in TABLES:
        lines += ["", f"## {kind}", about(kind), "", "| field | default | allowed | |", "|---|---|---|---|"]
        cells = ((row.name, row.default, row.allowed, row.note) for row in rows_of(kind))
        lines += ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in cells]
    return "\n".join(lines) + "\n"
