"""The parts of a scene, each a validated table: SI units, bounds, unknown keys refused."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, ClassVar, Protocol, TypeVar

import numpy as np
from pydantic import Field, field_validator, model_validator

from softlab.model.base.errors import SceneError
from softlab.model.base.pins import MeshPins, checked_pins
from softlab.model.base.table import AtLeastOne, Count, NotNegative, Number, Part, Positive, Seed, Vector
from softlab.model.geometry.normals import vertex_normals
from softlab.model.geometry.sheets import sheet_triangles


class Rubbing(Protocol):
    """A part with friction."""

    @property
    def static_friction(self) -> float: ...
    @property
    def dynamic_friction(self) -> float: ...


RubbingPart = TypeVar("RubbingPart", bound=Rubbing)


def friction_is_ordered(part: RubbingPart) -> RubbingPart:
    """Validate a part with friction: the dynamic coefficient is at most the static one."""
    if part.dynamic_friction > part.static_friction:
        raise ValueError(
            f"dynamic_friction: must be at most static_friction, {part.static_friction:g}; raise static_friction as well"
        )
    return part


class Grid(Part):
    """N rows x M columns of point masses, row 0 on top, at rest at (column * spacing, -row * spacing).

    The hand-out counts quadrilateral elements: its N x M elements are (N + 1) x (M + 1) masses here. `pinned` names rows
    or columns at its borders, or `every:K`, every K-th mass of the top row, or a list of masses [row, column].
    """

    rows: Count  # masses
    columns: Count  # masses
    spacing: Positive = 1.0  # m
    mass: Positive = 0.01  # kg, each
    pinned: MeshPins = "none"  # top, bottom, left, right, top-bottom, left-right, top-corners, edges, every:K, [[i, j]]

    @field_validator("pinned", mode="before")
    @classmethod
    def _pinned_is_a_word_or_a_list(cls, value: object) -> object:
        return checked_pins(value)

    @model_validator(mode="after")
    def _is_valid(self) -> Grid:
        self._check_pins()
        return self

    def _check_pins(self) -> None:
        """Raise ValueError for pins [row, column] outside the sheet."""
        for place in self.pinned if isinstance(self.pinned, list) else ():
            if isinstance(place, tuple) and not (0 <= place[0] < self.rows and 0 <= place[1] < self.columns):
                raise ValueError(
                    f"pinned: {list(place)} lies outside the grid; rows are 0 to {self.rows - 1}, "
                    f"columns 0 to {self.columns - 1}"
                )

    @property
    def particle_count(self) -> int:
        """Number of masses."""
        return self.rows * self.columns

    @property
    def extent(self) -> float:
        """Longest side [m], approximately."""
        return max(self.rows, self.columns) * self.spacing

    def triangles(self) -> np.ndarray:
        """Return the triangles, (triangles, 3) uint32, counter-clockwise from the front."""
        return sheet_triangles(self.rows, self.columns)

    def masses_by_area(self) -> np.ndarray | None:
        """Return the mass [kg] of each particle by the area around it, (particles,) float64; None where all have `mass`."""
        return None

    def normals(self, position: np.ndarray) -> np.ndarray:
        """Return the unit normals of the masses at `position` (particles, 3), (particles, 3) float64."""
        return vertex_normals(position, self.rows, self.columns)

    @property
    def spring_count(self) -> int:
        """Number of springs to neighbours in row and column."""
        return self.rows * (self.columns - 1) + (self.rows - 1) * self.columns


class Elastic(Part):
    """A spring's material: its stiffness, or its inverse, the compliance, which may be 0 for a position-based solver.
    With a compliance, the stiffness follows from it. Only the stated one is written."""

    contradicts: ClassVar[Mapping[str, tuple[str, ...]]] = {"stiffness": ("compliance",), "compliance": ("stiffness",)}

    stiffness: Positive = 10.0  # N/m
    compliance: NotNegative | None = None  # m/N; 0: inextensible

    @model_validator(mode="before")
    @classmethod
    def _stiffness_follows(cls, fields: object) -> object:
        if not isinstance(fields, dict):
            return fields
        fields = dict(fields)
        compliance = fields.get("compliance")
        if isinstance(compliance, bool) or not isinstance(compliance, int | float) or not 0 < compliance < math.inf:
            return fields
        if 1 / compliance == math.inf:
            raise ValueError("compliance: its inverse, the stiffness, is no finite number; use 0 or at least 1e-300")
        stiffness = fields.setdefault("stiffness", 1 / compliance)
        if isinstance(stiffness, int | float) and not math.isclose(stiffness, 1 / compliance, rel_tol=1e-9):
            raise ValueError(f"stiffness: must be 1 / compliance, {1 / compliance:g}; give one of them")
        return fields

    @property
    def inextensible(self) -> bool:
        """True if its length cannot change: compliance 0."""
        return self.compliance == 0

    @property
    def storing_stiffness(self) -> float:
        """Stiffness [N/m] with which a stretch stores energy; 0 for an inextensible spring."""
        return 0.0 if self.inextensible else self.stiffness

    def softness(self, ratio: float = 1.0) -> float:
        """Return the compliance [m/N] of a spring `ratio` times as stiff."""
        return 0.0 if self.inextensible else 1 / (self.stiffness * ratio)

    def _idle_fields(self) -> set[str]:
        return {"compliance" if self.compliance is None else "stiffness"}


class Springs(Elastic):
    """A spring to each of the up to four neighbours: force = stiffness * (length - rest_length) along it.

    With a `stiffness_ratio` other than 1, every second spring of a row or column is that many times as stiff: those
    that begin at an odd column or row.
    """

    rest_length: NotNegative = 1.0  # m, whatever grid.spacing is
    stiffness_ratio: AtLeastOne = 1.0

    def _idle_fields(self) -> set[str]:
        return super()._idle_fields() | (set() if self.alternate else {"stiffness_ratio"})

    @property
    def alternate(self) -> bool:
        """True if springs differ in stiffness."""
        return self.stiffness_ratio != 1

    @property
    def largest_stiffness(self) -> float:
        """Stiffness of the stiffest spring [N/m]."""
        return self.stiffness * self.stiffness_ratio


class Damping(Part):
    """A damper on each mass: force = -coefficient * velocity."""

    coefficient: NotNegative = 0.03  # N s/m


class Gravity(Part):
    """Gravity along -y; `enabled = false` omits it (and G switches it on in the demo)."""

    enabled: Annotated[bool, Field(strict=True)] = True
    acceleration: NotNegative = 9.81  # m/s^2, along -y


class External(Part):
    """A random force per mass, axis and step, uniform in (-magnitude, magnitude); with 0 the stage does not exist."""

    magnitude: NotNegative = 0.0  # N
    seed: Seed = 0


class Perturbation(Part):
    """Start: every free mass displaced by amplitude * [sin(1.7 i + 0.9 j), cos(0.6 i - 1.3 j)] (i = row, j = column); in
    a cloth also along z, by amplitude * sin(0.8 i - 0.7 j)."""

    amplitude: NotNegative = 0.05  # m


GRID_KINDS: dict[str, type[Part]] = {
    "grid": Grid,
    "springs": Springs,
    "damping": Damping,
    "gravity": Gravity,
    "external": External,
    "perturbation": Perturbation,
}


CAMERA = "camera"  # the table's name


class CameraPart(Part):
    """The camera of pictures. `yaw` [degrees] rotates it about the vertical, `pitch` [degrees] lifts it above the
    horizontal; both in space only. `target` [m] is at the centre of the picture, whose height at that depth is `size`
    [m]. By default a field follows from what the run shows."""

    yaw: Number | None = None
    pitch: Annotated[float, Field(ge=-89, le=89, allow_inf_nan=False, strict=True)] | None = None
    target: Vector | None = None
    size: Positive | None = None

    def check(self, dimensions: int) -> None:
        """Raise SceneError for a rotated camera in a scene of two `dimensions`."""
        for name, value in (("yaw", self.yaw), ("pitch", self.pitch)):
            if dimensions == 2 and value is not None:
                raise SceneError(f"{CAMERA}.{name}", value, "applies to a scene in space; this one is plane")

    def _idle_fields(self) -> set[str]:
        return {name for name in type(self).model_fields if getattr(self, name) is None}
