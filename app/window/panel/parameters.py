"""Parameters of a scene that the panel can change: every number, word and boolean of its tables, with unit, range and
whether a change needs a recompile. They are read from the tables, like docs/scene.md."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass
from math import isfinite
from typing import Literal, get_args, get_origin

from annotated_types import Ge, Gt, Le
from pydantic.fields import FieldInfo

from softlab.model.base.words import notes_of
from softlab.model.core.options import LIVE_PATHS
from softlab.model.scene.fields import marks_of
from softlab.model.scene.scene import Scene
from softlab.model.tables.parts import Elastic

UNIT = re.compile(r"(?:m/s\^2|m/s|kg/m\^[23]|kg|N s/m|N m|N/m|Pa|rad/s|rad|m/N|1/s\^2|1/s|mm|m|s|N|J)(?![\w/^])")
DECADES = 100.0  # a factor to either side of a positive value
MOST = {  # where a slider ends for which its own table knows no bound
    "acceleration": 30.0, "substeps": 64, "iterations": 64, "sweeps": 16,
}  # fmt: skip
WHERE_NONE = {"s": 0.0125, "m": 0.025}  # a quarter of a slider's length, of what is 0 where it begins; else 0.25
VECTOR = {"velocity": 20.0}  # to either side of 0
WHY = {  # why a field is not live, by kind of table
    "method": "the step is compiled for this value",
    "tetrahedral_body": "the constraint tables are built from it",
    "material": "the constraint tables are built from it",
    "foam": "the foam points were generated with it",
}
BUILT_FROM = "masses and springs are built from it"
WHY_OTHERS = "constants and tables are built from it"
SHAPES = ("grid", "cloth", "mesh", "soft_body", "soft_sheet", "soft_lattice", "rigid_body")


@dataclass(frozen=True)
class Parameter:
    """One field. `path`: dotted; `kind`: number, whole, truth, word or vector; `unit`: from the table's comment; `low`,
    `high`: the slider's ends; `logarithmic`: a slider of factors; `words`: allowed words; `live`: it can change during
    a run, else `why` not; `note`: its description in the table."""

    path: str
    kind: Literal["number", "whole", "truth", "word", "vector"]
    unit: str = ""
    low: float = 0.0
    high: float = 1.0
    logarithmic: bool = False
    words: tuple[str, ...] = ()
    live: bool = False
    why: str = ""
    note: str = ""

    @property
    def part(self) -> str:
        """Name of the table."""
        return self.path.partition(".")[0]

    @property
    def field(self) -> str:
        """Name of the field in its table."""
        return self.path.partition(".")[2].strip()

    @property
    def label(self) -> str:
        """Name of the field in words."""
        return {"dt": "dt", "young_modulus": "Young's modulus", "poisson_ratio": "Poisson's ratio"}.get(
            self.field, self.field.replace("_", " ")
        )


def parameters_of(scene: Scene, initial: Scene, live: Collection[str]) -> list[Parameter]:
    """Return the parameters of a scene, live ones first, in the order of its tables. Ranges follow from the values of the
    `initial` scene. `live`: names of LIVE_PATHS."""
    paths = {path for name in live for path in LIVE_PATHS[name]}
    parameters = []
    for part, table in scene.parts.items():
        fields = list(table.model_dump(mode="python"))  # what says nothing in this table is left out
        if f"{part}.stiffness" in paths and isinstance(table, Elastic) and table.compliance:
            fields.append("stiffness")  # which is live, whichever of both the table gives
        for field in fields:
            parameter = _parameter(scene, initial, part, field, f"{part}.{field}" in paths)
            if parameter is not None:
                parameters.append(parameter)
    return sorted(parameters, key=lambda one: not one.live)  # a stable order: what is live comes first


def _parameter(scene: Scene, initial: Scene, part: str, field: str, live: bool) -> Parameter | None:
    kind_of_part, table = scene.kinds[part], scene.parts[part]
    value = getattr(table, field)
    note, info = notes_of(type(table)).get(field, ""), type(table).model_fields[field]
    unit = matched.group() if (matched := UNIT.match(note)) else ""
    why = "" if live else _why(kind_of_part, field)
    path, initial_value = f"{part}.{field}", initial.value(f"{part}.{field}")
    words = _words(info)
    if isinstance(value, bool):
        return Parameter(path, "truth", live=live, why=why, note=note)
    if words:
        return Parameter(path, "word", words=words, live=live, why=why, note=note) if value in words else None
    if isinstance(value, tuple) and len(value) == 3 and all(isinstance(one, float | int) for one in value):
        bound = max(VECTOR.get(field, 0.0), *(2 * abs(float(one)) for one in (*value, *(initial_value or value))), 1.0)
        return Parameter(path, "vector", unit, -bound, bound, live=live, why=why, note=note)
    if not isinstance(value, int | float) or not isfinite(value):
        return None
    kind: Literal["number", "whole"] = "whole" if isinstance(value, int) and _whole(info) else "number"
    base = float(initial_value) if isinstance(initial_value, int | float) and isfinite(initial_value) else float(value)
    low, high, logarithmic = _range(field, info, kind, base or float(value) or WHERE_NONE.get(unit, 0.25))
    low, high = min(low, float(value)), max(high, float(value))
    return Parameter(path, kind, unit, low, high, logarithmic, live=live, why=why, note=note)


def _why(kind: str, field: str) -> str:
    if kind in SHAPES:
        return BUILT_FROM
    return WHY.get(kind, WHY_OTHERS)


def _words(info: FieldInfo) -> tuple[str, ...]:
    """Return the words that a field accepts, if it accepts only some."""
    annotation = info.annotation
    if get_origin(annotation) is Literal and all(isinstance(word, str) for word in get_args(annotation)):
        return tuple(get_args(annotation))
    return ()


def _whole(info: FieldInfo) -> bool:
    return info.annotation is int or int in get_args(info.annotation)


def _range(field: str, info: FieldInfo, kind: str, value: float) -> tuple[float, float, bool]:
    """Return (lowest, highest value, True if logarithmic) of a slider about a `value`, within the bounds of the field."""
    marks = marks_of(info)
    bounds = [mark.ge if isinstance(mark, Ge) else mark.gt for mark in marks if isinstance(mark, Ge | Gt)]
    least = max((float(bound) for bound in bounds if isinstance(bound, int | float)), default=None)
    above = any(isinstance(mark, Gt) for mark in marks)
    limits = [mark.le for mark in marks if isinstance(mark, Le)]
    most = min((float(limit) for limit in limits if isinstance(limit, int | float)), default=None)
    if field in MOST:
        return least or 0.0, float(MOST[field]), False
    if most is not None and most <= 1000:
        return least if least is not None else -most, most, False
    if kind == "whole":
        return least if least is not None else 0.0, max(4 * value, 8.0), False
    if above and value > 0:
        return value / DECADES, value * DECADES, True
    return least if least is not None else min(-4 * abs(value), -1.0), max(4 * abs(value), 1e-3), False
