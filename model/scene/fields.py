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


EXAMPLES = """
## Examples

Two blocks of water in a tank, in a plane; every other field has its default.

```toml
title = "Two blocks of water"

[water]
kind = "fluid"
dimensions = 2
size = [0.4, 0.6]           # m, from the origin
rest_distance = 0.02        # m
blocks = [{ origin = [0.8, 0.0], size = [0.2, 0.3] }]

[tank]
size = [1.2, 1.0]           # m

[gravity]

[method]
solver = "pbf"
```

Two of the lab's shapes: `resolution` is of the surface that is seen, `edge` of the voxels that are computed.

```toml
title = "A beam of jelly"

[beam]
kind = "tetrahedral_body"
shape = { name = "beam", resolution = 12 }
edge = 0.125                # m
young_modulus = 1e5         # Pa
pinned = ["left"]

[sign]
kind = "tetrahedral_body"
shape = { name = "letters", text = "SOFT", resolution = 20, scale = 0.5 }
edge = 0.1
origin = [0.0, 1.0, 0.0]    # m

[floor]
kind = "plane"
point = [0.0, -1.0, 0.0]

[gravity]

[contact]
```

A banner on four pins, which lets go of its right corner after a second, and of the rest after two.

```toml
title = "A banner that is let go"

[cloth]
rows = 9
columns = 17
spacing = 0.05              # m
pinned = [[0, 0], [0, 5], [0, 11], [0, 16]]

[structural]
compliance = 1e-5           # m/N

[shear]
compliance = 1e-3

[wind]
velocity = [1.0, 0.0, 2.0]  # m/s

[corner]
kind = "release"
pins = [[0, 16]]
time = 1.0                  # s

[rest]
kind = "release"            # all the other pins
time = 2.0

[floor]
kind = "plane"
point = [0.0, -1.5, 0.0]    # m

[gravity]

[method]
solver = "xpbd"
iterations = 20
```

A world, particles of four families: water, a rigid body of clusters, a body of tetrahedra and a cloth, in a tank.

```toml
title = "Water, a cloth, a brick and a jelly"

[water]
kind = "fluid"
size = [0.5, 0.2, 0.3]      # m, from the origin
rest_distance = 0.025       # m
viscosity = 1.0             # Pa s

[brick]                     # of wood: it floats
kind = "rigid_body"
shape = { name = "box", sides = [0.1, 0.075, 0.1] }
particle_spacing = 0.025    # m, the water's
volume_sampling = 1.0       # particles fill it, so that it holds as much water off as its volume
surface_sampling = 0.0
density = 600.0             # kg/m^3
origin = [0.1, 0.28, 0.15]  # m, of its middle

[jelly]
kind = "tetrahedral_body"
shape = { name = "box", sides = [0.1, 0.1, 0.1], resolution = 20 }
edge = 0.05                 # m
young_modulus = 2e4         # Pa
density = 400.0
origin = [0.36, 0.5, 0.15]

[cloth]                     # held above the water by two corners; the jelly falls on it
kind = "mesh"
shape = "sheet"
rows = 13
columns = 13
spacing = 0.025
placement = "flat"
density = 0.3               # kg/m^2
origin = [0.2, 0.4, 0.0]    # m, of row 0, column 0
pinned = "top-corners"

[structural]
compliance = 1e-5           # m/N

[bending]
model = "isometric"
stiffness = 1e-4            # N m

[contact]                   # of all that is solid
distance = 0.015            # m, between surfaces
sweeps = 4

[tank]                      # open at its top
size = [0.5, 1.0, 0.3]      # m

[gravity]

[method]
solver = "world"            # each part by the solver of its family
substeps = 4
iterations = 10
```
"""


def document() -> str:
    """Return the text of docs/scene.md: every kind of table, its fields, defaults, bounds and units."""
    lines = [
        "# Scene files",
        "",
        "A scene file is a TOML file with a `title` and tables. The name of a table is its kind. To have several tables of a",
        'kind, give them other names and a `kind`: `[ball]` with `kind = "sphere"`. Units are SI units. A field that is left',
        "out has its default; a table that is left out is not simulated. `softlab scenes --fields wind` prints one of the",
        "tables below. To begin, copy a scene from `model/catalogue/`: `lab-grid.toml` (a grid), `cloth-sphere.toml` or",
        "`cloth-xpbd.toml` (cloth), `jelly-drop.toml` (bodies). `model/scene/fields.py` writes this page from the code.",
        "",
        "| kinds | what for |",
        "|---|---|",
        "| grid, springs, damping, gravity, external, perturbation, method | masses in a plane |",
        "| cloth, structural, shear, bending, wind, motion, fold, load, attachments, self_collision | masses in space |",
        "| mesh, volume | a cloth of triangles, and a filling of a closed one that preserves its volume |",
        "| plane, tank, sphere, capsule, box, mesh_collider, distance_field | colliders |",
        "| soft_body, soft_sheet, soft_lattice, rigid_body, contact | soft and rigid bodies of particles |",
        "| fluid, emitter, sink, domain, foam | fluids of particles, sources and sinks, a periodic box, spray and foam |",
        "| tetrahedral_body, region, material, attachment | bodies of tetrahedra, with Young's modulus and Poisson's ratio |",
        "| release | pins that are released at a given time |",
        "| camera | the view of pictures and clips; no effect on the simulation |",
    ]
    for kind in TABLES:
        lines += ["", f"## {kind}", about(kind), "", "| field | default | allowed | |", "|---|---|---|---|"]
        cells = ((row.name, row.default, row.allowed, row.note) for row in rows_of(kind))
        lines += ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in cells]
    return "\n".join(lines) + "\n" + EXAMPLES
