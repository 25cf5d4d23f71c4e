"""Data that a mass's step reads besides the masses, passed through device functions as one object."""

from __future__ import annotations

from typing import Any, NamedTuple


class World(NamedTuple):
    """`parameters`: the constants, by name, a record or its values in registers; `colliders`: rows of colliders, of
    motions and of pins, flat (model/contact/cloth_parameters.py); `integers`: of core/integers.py."""

    parameters: Any
    colliders: Any
    integers: Any


class Cell(NamedTuple):
    """Position of a mass in its sheet: row `i` of `rows` and column `j` of `columns`."""

    i: Any
    j: Any
    rows: Any
    columns: Any
