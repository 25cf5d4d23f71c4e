"""The parts `motion` and `release`: pins that follow a path or let go, and the assignment of masses to motions.

The scene after a release is in model/scene/checks/releases.py.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import hypot, inf
from typing import Protocol, runtime_checkable

import numpy as np
from pydantic import field_validator, model_validator

from softlab.model.base.errors import SceneError
from softlab.model.base.pins import PIN_RULE, MeshPins, Pins, checked_pins, pin_indices
from softlab.model.base.table import NotNegative, Number, Part, Positive, Vector
from softlab.model.tables.parts import Grid

RELEASE, ALL = "release", "all"
MAX_RADIANS = 1e9  # of a whole motion: quarter turns are counted in integers


class Motion(Part):
    """Pinned masses that move together: they rotate about an axis through `center`, which itself moves.

    At t seconds after `start` a mass with the rest position p is at center + R(angular_velocity t) (p - center) +
    velocity t, R the rotation about `axis` (anticlockwise seen from where it points to). Before, it rests at p; after
    `duration`, it stays where it is. For tetrahedral bodies `pins` is a side, a region or `all`: the pinned vertices
    there, of one `body` or of every one.
    """

    pins: Pins  # pinned masses of the sheet, as its `pinned`; for tetrahedral bodies a side, a region or all
    body: str | None = None  # a tetrahedral one, or a cloth beside them; by default all of them
    velocity: Vector = (0.0, 0.0, 0.0)  # m/s
    axis: Vector = (1.0, 0.0, 0.0)
    center: Vector = (0.0, 0.0, 0.0)  # m
    angular_velocity: Number = 0.0  # rad/s
    start: NotNegative = 0.0  # s
    duration: Positive = 1.0  # s

    @field_validator("pins", mode="before")
    @classmethod
    def _pins_are_a_word_or_a_list(cls, value: object) -> object:
        pins = value if isinstance(value, str) else checked_pins(value)  # words depend on what has the pins
        if pins in ("none", "", []):
            raise ValueError(f"must name a mass: {PIN_RULE.removeprefix('none, ')}")
        return pins

    @model_validator(mode="after")
    def _turns_about_an_axis(self) -> Motion:
        if not 0 < hypot(*self.axis) < inf:
            raise ValueError("axis: must not be zero")
        radians = abs(self.angular_velocity) * self.duration
        if radians > MAX_RADIANS:
            raise ValueError(f"angular_velocity: turns by {radians:.3g} rad in all, at most {MAX_RADIANS:g}")
        return self

    def _idle_fields(self) -> set[str]:
        return super()._idle_fields() | ({"body"} if self.body is None else set())

    @property
    def moves(self) -> bool:
        """True if it moves at all."""
        return self.angular_velocity != 0 or any(self.velocity)


class Release(Part):
    """Pins that let go. From the first step that begins at `time` on, their masses are free; they start with the velocity
    that they have then, 0 or that of their motion.

    `pins`: of a sheet a side or masses, as in its `pinned`; of a tetrahedral body one of the words of its `pinned`, or the
    name of an attachment; `all`: every pin of the `body`. Motions and attachments of these pins end with them. A restart
    pins them again, and a state that is loaded has the pins of its time.
    """

    time: Positive  # s
    pins: str | list[int] | list[tuple[int, int]] = ALL  # as in `pinned`, an attachment, or all
    body: str | None = None  # the sheet or a tetrahedral body; each of them unless given

    @field_validator("pins", mode="before")
    @classmethod
    def _pins_are_a_word_or_a_list(cls, value: object) -> object:
        if isinstance(value, str) and value not in ("", "none"):
            return checked_pins(value) if value.startswith("every:") else value
        if isinstance(value, list | tuple) and value:
            return list(value) if all(type(one) is int for one in value) else checked_pins(value)
        raise ValueError(
            "must name pins: all, a side, a word of the body's `pinned`, an attachment, or a list of masses"
        )

    def _idle_fields(self) -> set[str]:
        return super()._idle_fields() | ({"body"} if self.body is None else set())


@runtime_checkable
class Pinned(Protocol):
    """A particle set that is no sheet of rows: it says itself which motion each of its pins follows."""

    def pin_motions(self, motions: Mapping[str, Motion]) -> np.ndarray: ...


def check_inside(places: Iterable[Sequence[int]], sheet: Grid, field: str) -> None:
    """Raise SceneError, which names `field`, for a (row, column) outside a sheet of `rows` and `columns`."""
    for row, column in places:
        if not (0 <= row < sheet.rows and 0 <= column < sheet.columns):
            reason = f"lies outside the sheet; rows are 0 to {sheet.rows - 1}, columns 0 to {sheet.columns - 1}"
            raise SceneError(field, [row, column], reason)


def masses_of(pins: MeshPins, sheet: Grid, field: str) -> np.ndarray:
    """Return the sorted indices (masses,) int64 of the masses of a sheet that `pins` names. Raises SceneError as
    `check_inside`."""
    places = [place for place in pins if isinstance(place, Sequence)] if isinstance(pins, list) else []
    check_inside(places, sheet, field)
    return pin_indices(pins, sheet.rows, sheet.columns)


def motions_of_pins(sheet: object, motions: Mapping[str, Motion]) -> np.ndarray:
    """Return for each pinned mass of the sheet, by index, the number of its motion in `motions`, or -1; (pins,) int64.

    Particle sets other than sheets of rows compute it themselves: `pin_motions`. Raises SceneError for a motion of
    masses that are not pinned, or that another motion moves.
    """
    if isinstance(sheet, Pinned):
        return sheet.pin_motions(motions)
    assert isinstance(sheet, Grid)
    pinned = pin_indices(sheet.pinned, sheet.rows, sheet.columns)
    numbers = np.full(len(pinned), -1, np.int64)
    names = list(motions)
    for number, (name, motion) in enumerate(motions.items()):
        if motion.body is not None:
            raise SceneError(f"{name}.body", motion.body, "applies to tetrahedral bodies; leave it out")
        if isinstance(motion.pins, str):
            try:
                checked_pins(motion.pins)
            except ValueError as error:
                raise SceneError(f"{name}.pins", motion.pins, str(error)) from None
        moved = masses_of(motion.pins, sheet, f"{name}.pins")
        loose = moved[~np.isin(moved, pinned)]
        if len(loose):
            place = list(divmod(int(loose[0]), sheet.columns))
            raise SceneError(f"{name}.pins", motion.pins, f"{place} is not pinned; name it in the sheet's `pinned`")
        at = np.searchsorted(pinned, moved)
        taken = np.flatnonzero(numbers[at] >= 0)
        if len(taken):
            place, other = list(divmod(int(moved[taken[0]]), sheet.columns)), names[numbers[at[taken[0]]]]
            raise SceneError(f"{name}.pins", motion.pins, f"{place} already follows {other}; a mass has one motion")
        numbers[at] = number
    return numbers
