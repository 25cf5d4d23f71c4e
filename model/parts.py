"""The parts a scene can have, each a validated table: SI units, bounds, unknown keys refused."""

from __future__ import annotations

import re
from typing import Annotated, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    field_validator,
    model_serializer,
    model_validator,
)

IntegratorName = Literal["lab", "semi-implicit-euler", "velocity-verlet", "rk4", "explicit-euler", "taylor"]

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False, strict=True)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False, strict=True)]
AtLeastOne = Annotated[float, Field(ge=1, allow_inf_nan=False, strict=True)]
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


PIN_WORDS = ("none", "top", "top-corners", "left", "edges")
PIN_RULE = "none, top, top-corners, left, edges, every:K (of the top row, K >= 1) or a list [[row, column], ...]"


class Springs(Part):
    """A spring to each of the up to four neighbours: force = stiffness * (length - rest_length) along it.

    Every second spring along a row and down a column is `stiffness_ratio` times as stiff, those whose lower end has an odd
    column, or row; 1: all equal, and then left out where the scene is written.
    """

    stiffness: Positive = 10.0  # N/m
    rest_length: NotNegative = 1.0  # m
    stiffness_ratio: AtLeastOne = 1.0

    @property
    def alternate(self) -> bool:
        """Whether springs differ in stiffness."""
        return self.stiffness_ratio != 1

    @property
    def largest_stiffness(self) -> float:
        """Of the stiffest spring [N/m]."""
        return self.stiffness * self.stiffness_ratio

    @model_serializer(mode="wrap")
    def _without_an_idle_ratio(self, serialize: SerializerFunctionWrapHandler) -> dict[str, object]:
        """Scenes of equal springs keep the text that they are known by in stores of measurements."""
        fields = serialize(self)
        if not self.alternate:
            del fields["stiffness_ratio"]
        return fields


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
    """Start: every free mass displaced by amplitude * [sin(1.7 i + 0.9 j), cos(0.6 i - 1.3 j)] (i = row, j = column); in
    a cloth also along z, by amplitude * sin(0.8 i - 0.7 j)."""

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


GRID_KINDS: dict[str, type[Part]] = {
    "grid": Grid,
    "springs": Springs,
    "damping": Damping,
    "gravity": Gravity,
    "external": External,
    "perturbation": Perturbation,
    "manufactured": Manufactured,
    "method": Method,
}
