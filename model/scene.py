"""The validated description of a scene: TOML <-> objects. Frozen, SI units, only the parts the scene names.

Top-level tables are named parts; `kind` defaults to the table's name, so `[grid]` is the part *grid* of kind *grid*.
A part that is not there is not simulated: it has no stage, no array and no branch in the compiled kernel.
"""

from __future__ import annotations

import difflib
import json
import re
import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from model.errors import InputError, SceneError

IntegratorName = Literal["lab", "semi-implicit-euler", "velocity-verlet", "rk4", "explicit-euler", "taylor"]
INTEGRATORS: tuple[str, ...] = get_args(IntegratorName)

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False, strict=True)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False, strict=True)]
Count = Annotated[int, Field(ge=1, strict=True)]
Seed = Annotated[int, Field(ge=0, le=2**64 - 1, strict=True)]


class Part(BaseModel):
    """Base of every table of a scene: frozen, unknown keys refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Grid(Part):
    """N rows x M columns of point masses, row 0 on top, at rest at (column * spacing, -row * spacing).

    The hand-out counts quadrilateral elements: its N x M elements are (N + 1) x (M + 1) masses here.
    """

    rows: Count  # masses
    columns: Count  # masses
    spacing: Positive = 1.0  # m
    mass: Positive = 0.01  # kg, each
    pinned: str | list[tuple[int, int]] = "none"

    @field_validator("pinned", mode="before")
    @classmethod
    def _pinned_is_a_word_or_a_list(cls, value: object) -> object:
        if isinstance(value, str):
            every = re.fullmatch(r"every:([1-9][0-9]*)", value)
            if value not in PIN_WORDS and not every:
                raise ValueError(PIN_RULE)
            return value
        if not isinstance(value, list | tuple):
            raise ValueError(PIN_RULE)
        for pair in value:
            if (
                not isinstance(pair, list | tuple)
                or len(pair) != 2
                or not all(isinstance(k, int) and not isinstance(k, bool) for k in pair)
            ):
                raise ValueError(PIN_RULE)
        return [tuple(pair) for pair in value]

    @model_validator(mode="after")
    def _pins_lie_inside(self) -> Grid:
        if isinstance(self.pinned, list):
            for row, column in self.pinned:
                if not (0 <= row < self.rows and 0 <= column < self.columns):
                    raise ValueError(
                        f"pinned: [{row}, {column}] lies outside the grid; rows are 0 to {self.rows - 1}, "
                        f"columns 0 to {self.columns - 1}"
                    )
        return self

    @property
    def particle_count(self) -> int:
        return self.rows * self.columns

    @property
    def spring_count(self) -> int:
        return self.rows * (self.columns - 1) + (self.rows - 1) * self.columns


PIN_WORDS = ("none", "top", "top-corners", "edges")
PIN_RULE = "none, top, top-corners, edges, every:K (of the top row, K >= 1) or a list [[row, column], ...]"


class Springs(Part):
    """A spring to each of the up to four neighbours: force = stiffness * (length - rest_length) along it."""

    stiffness: Positive = 10.0  # N/m
    rest_length: NotNegative = 1.0  # m


class Damping(Part):
    """A damper on each mass: force = -coefficient * velocity."""

    coefficient: NotNegative = 0.03  # N s/m


class Gravity(Part):
    """Gravity along -y; `enabled = false` leaves it out (and G switches it on in the demo)."""

    enabled: Annotated[bool, Field(strict=True)] = True
    acceleration: NotNegative = 9.81  # m/s^2, along -y


class External(Part):
    """A random force per mass, axis and step, uniform in (-magnitude, magnitude); 0 = the stage does not exist."""

    magnitude: NotNegative = 0.0  # N
    seed: Seed = 0


class Perturbation(Part):
    """Start: every free mass displaced by amplitude * [sin(1.7 i + 0.9 j), cos(0.6 i - 1.3 j)] (i = row, j = column)."""

    amplitude: NotNegative = 0.05  # m


class Manufactured(Part):
    """The method of manufactured solutions: the force that makes p*(t) the exact solution of the scene.

    p*(t) = rest + amplitude * [sin(2 t + 1.7 i + 0.9 j), cos(3 t + 0.6 i - 1.3 j)]; the masses start on p*(0), p*'(0).
    `inertia` times the mass is what the force is made for (2 for the `lab` step, which moves as if masses were double).
    """

    amplitude: Positive = 0.1  # m
    inertia: Positive = 1.0


class Method(Part):
    """How the scene is solved."""

    solver: Literal["mass-spring"] = "mass-spring"
    integrator: IntegratorName = "velocity-verlet"
    dt: Positive = 0.01  # s


KINDS: dict[str, type[Part]] = {
    "grid": Grid,
    "springs": Springs,
    "damping": Damping,
    "gravity": Gravity,
    "external": External,
    "perturbation": Perturbation,
    "manufactured": Manufactured,
    "method": Method,
}


class Scene:
    """A validated scene. `parts` maps a part's name to its object, `kinds` the name to its kind.

    The parts a solver asks for have properties (`grid`, `springs`, ...): the part, or None where the scene lacks it.
    Raises SceneError for anything a scene cannot be.
    """

    def __init__(self, data: Mapping[str, Any], name: str = "scene"):
        tables = dict(data)
        self.name = name
        self.title = tables.pop("title", name)
        if not isinstance(self.title, str):
            raise SceneError("title", self.title, "a text")
        self.parts: dict[str, Part] = {}
        self.kinds: dict[str, str] = {}
        for part_name, table in tables.items():
            if not isinstance(table, Mapping):
                raise SceneError(part_name, table, f"unknown key; a scene has a title and tables: {', '.join(KINDS)}")
            fields = dict(table)
            kind = fields.pop("kind", part_name)
            if not isinstance(kind, str) or kind not in KINDS:
                raise SceneError(
                    part_name if kind == part_name else f"{part_name}.kind",
                    kind,
                    f"unknown part{_suggestion(str(kind), KINDS)}; known kinds: {', '.join(KINDS)}",
                )
            try:
                self.parts[part_name] = KINDS[kind](**fields)
            except ValidationError as error:
                raise _scene_error(part_name, error, KINDS[kind]) from None
            except TypeError:  # a key that is not even a name
                raise SceneError(part_name, sorted(map(str, fields)), "its keys must be names") from None
            self.kinds[part_name] = kind
        for kind in KINDS:
            if kind != "grid" and sum(k == kind for k in self.kinds.values()) > 1:
                raise SceneError(kind, [n for n, k in self.kinds.items() if k == kind], "one part of this kind a scene")
        grids = [n for n, k in self.kinds.items() if k == "grid"]
        if len(grids) != 1:
            raise SceneError("grid", grids or None, "a scene needs one part of kind grid, with rows and columns")
        if self._one("method") is None:
            self.parts["method"], self.kinds["method"] = Method(), "method"

    def _one(self, kind: str) -> Any:
        return next((self.parts[n] for n, k in self.kinds.items() if k == kind), None)

    @property
    def grid(self) -> Grid:
        return self._one("grid")

    @property
    def springs(self) -> Springs | None:
        return self._one("springs")

    @property
    def damping(self) -> Damping | None:
        return self._one("damping")

    @property
    def gravity(self) -> Gravity | None:
        return self._one("gravity")

    @property
    def external(self) -> External | None:
        return self._one("external")

    @property
    def perturbation(self) -> Perturbation | None:
        return self._one("perturbation")

    @property
    def manufactured(self) -> Manufactured | None:
        return self._one("manufactured")

    @property
    def method(self) -> Method:
        return self._one("method")

    def as_dict(self) -> dict[str, Any]:
        """The scene as nested tables, defaults filled in: what a TOML file of it would hold."""
        tables: dict[str, Any] = {"title": self.title}
        for part_name, part in self.parts.items():
            kind = self.kinds[part_name]
            tables[part_name] = ({} if kind == part_name else {"kind": kind}) | part.model_dump(mode="json")
        return tables

    def canonical(self) -> str:
        """Canonical JSON of what is simulated (no title): equal texts mean equal scenes."""
        tables = {key: table for key, table in self.as_dict().items() if key != "title"}
        return json.dumps(tables, sort_keys=True, separators=(",", ":"))

    def replace(self, changes: Mapping[str, Any]) -> Scene:
        """A new, validated scene with fields replaced by dotted path: `scene.replace({"grid.rows": 64})`.

        A path into a known part that the scene lacks creates that part with its defaults.
        """
        tables = self.as_dict()
        for path, value in changes.items():
            part_name, _, field = path.partition(".")
            if not field or "." in field:
                raise SceneError(path, value, "a dotted path such as grid.rows or method.dt")
            kind = self.kinds.get(part_name, part_name)
            if kind not in KINDS:
                raise SceneError(path, value, f"unknown part{_suggestion(part_name, KINDS)}; known: {', '.join(KINDS)}")
            known = KINDS[kind].model_fields
            if field not in known:
                raise SceneError(path, value, f"unknown key{_suggestion(field, known)}; known: {', '.join(known)}")
            tables.setdefault(part_name, {})[field] = value
        return Scene(tables, self.name)


def _suggestion(word: str, known: Any) -> str:
    close = difflib.get_close_matches(word, list(known), n=1)
    return f" (did you mean {close[0]}?)" if close else ""


def _scene_error(part: str, error: ValidationError, kind: type[Part]) -> SceneError:
    """The first complaint of pydantic, in the words of a scene."""
    first = error.errors(include_url=False)[0]
    location = [str(step) for step in first["loc"]]
    if first["type"] == "missing":
        return SceneError(f"{part}.{location[0]}", None, "must be given")
    if first["type"] == "extra_forbidden":
        known = kind.model_fields
        return SceneError(
            f"{part}.{location[0]}",
            first["input"],
            f"unknown key{_suggestion(location[0], known)}; known: {', '.join(known)}",
        )
    message = first["msg"].removeprefix("Value error, ")
    if not location and ": " in message:  # a check across fields names its field itself
        field, _, allowed = message.partition(": ")
        return SceneError(
            f"{part}.{field}", first["input"].get(field) if isinstance(first["input"], dict) else None, allowed
        )
    words = {
        "int_type": "must be a whole number",
        "int_from_float": "must be a whole number",
        "float_type": "must be a number",
        "finite_number": "must be a finite number",
        "bool_type": "must be true or false",
    }
    allowed = words.get(first["type"], message)
    if first["type"] == "greater_than":
        allowed = f"must be greater than {first['ctx']['gt']:g}"
    elif first["type"] == "greater_than_equal":
        allowed = f"must be at least {first['ctx']['ge']:g}"
    elif first["type"] == "less_than_equal":
        allowed = f"must be at most {first['ctx']['le']:g}"
    elif first["type"] == "literal_error":
        allowed = f"must be one of {first['ctx']['expected'].replace(chr(39), '')}"
    return SceneError(".".join([part, *location[:1]]), first["input"], allowed)


def catalogue() -> dict[str, Path]:
    """The named scenes that come with the lab: name -> TOML file."""
    root = Path(str(resources.files("model"))) / "catalogue"
    return {file.relative_to(root).with_suffix("").as_posix(): file for file in sorted(root.rglob("*.toml"))}


def load_scene(name_or_path: str | Path) -> Scene:
    """The scene of a catalogue name (`lab-grid`) or of a TOML file.

    Raises InputError (no such name, unreadable, not TOML) or SceneError (a field that cannot be).
    """
    text = str(name_or_path)
    known = catalogue()
    path = known.get(text)
    if path is None:
        path = Path(text)
        looks_like_a_name = path.suffix == "" and len(path.parts) <= 1 and not path.exists()
        if looks_like_a_name:
            raise InputError(
                f"unknown scene {text!r}{_suggestion(text, known)}; known: {', '.join(known)}, or a .toml file"
            )
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except IsADirectoryError:
        raise InputError(f"{text} is a directory; a scene is a .toml file") from None
    except FileNotFoundError:
        raise InputError(f"{text}: no such file; `softlab scenes` lists the scenes that come with the lab") from None
    except (OSError, ValueError) as error:
        if isinstance(error, tomllib.TOMLDecodeError):
            raise InputError(f"{text} is not TOML: {error}") from None
        if isinstance(error, UnicodeDecodeError):
            raise InputError(f"{text} is not a text file in UTF-8; a scene is a .toml file") from None
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"{text} cannot be read: {reason}") from None
    return Scene(data, name=text if text in known else path.stem)


def parse_value(text: str) -> Any:
    """The value of `--set key=value`: read as TOML (numbers, true, lists), else taken as a plain word."""
    try:
        parsed = tomllib.loads(f"value = {text}")
        return parsed["value"] if set(parsed) == {"value"} else text
    except tomllib.TOMLDecodeError:
        return text


def parse_settings(settings: list[str] | None) -> dict[str, Any]:
    """`["grid.rows=64", ...]` as {path: value}. Raises SceneError where the equals sign is missing."""
    changes: dict[str, Any] = {}
    for setting in settings or []:
        path, equals, text = setting.partition("=")
        if not equals or not path.strip():
            raise SceneError("--set", setting, "must be key=value, such as grid.rows=64")
        changes[path.strip()] = parse_value(text.strip())
    return changes
