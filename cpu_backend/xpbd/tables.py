"""Weights of masses and reciprocals of constraints, in rows. Equal rows of a sheet are stored once.

So a constraint costs one load from a short row in the first-level cache, whatever the pins, the edges, and the live
parameters: a reciprocal is 0 where there is no constraint, and kernels need no case for it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from softlab.model.base.types import Real
from softlab.model.base.variant import plain_formulas
from softlab.model.contact.substep_parameters import Constants, constants_of
from softlab.model.core.build import Body
from softlab.model.formulas import distance
from softlab.model.position_based.plan import FAMILIES, Family, families
from softlab.model.scene.scene import Scene


def mass_weights(scene: Scene, body: Body, real: Real) -> np.ndarray:
    """Return (rows, columns): 1, 0 if pinned, and a load's inverse mass relative to the sheet's."""
    mass = scene.grid.mass
    weights = np.where(body.inverse_mass == 1 / mass, 1.0, body.inverse_mass * mass)
    return weights.astype(real).reshape(body.rows, body.columns)


def kind_of(family: Family, colour: int, parts: frozenset[str]) -> str:
    """Return the kind whose constants in the record apply to a colour of a family."""
    stiff = family.kind == "structural" and colour == 1 and "alternating" in parts
    return "stiff" if stiff else family.kind


def index_columns(family: Family, columns: int) -> tuple[slice, slice]:
    """Return the columns of the first and of the second ends of a row's constraints, in the order of their index."""
    count, right = max(0, columns - abs(family.columns)), family.columns
    return slice(max(0, -right), max(0, -right) + count), slice(max(0, right), max(0, right) + count)


def valence(family: Family, i: int, columns: int, rows: int) -> np.ndarray:
    """Return (columns,): the number of constraints of a family at the masses of row `i`."""
    first, second = index_columns(family, columns)
    count = np.zeros(columns, np.int64)
    if i + family.rows < rows:
        count[first] += 1
    if i - family.rows >= 0:
        count[second] += 1
    return count


@dataclass
class _Rows:
    """Different rows (n, columns), and the numbers of a sheet's rows among them."""

    known: dict[object, int]
    rows: list[np.ndarray]

    def number(self, key: object, make: Callable[[], np.ndarray]) -> int:
        if key not in self.known:
            self.known[key] = len(self.rows)
            self.rows.append(make())
        return self.known[key]


class Tables:
    """Tables of a scene's sheet in the arithmetic `real`.

    `weights` (n, columns) and `weight_row` (rows,), the number of a row's weights; `uneven` (rows,): true if a row has
    a weight other than 1. `reciprocals` and `valences` come from functions, since the record may change.
    """

    def __init__(self, scene: Scene, body: Body, real: Real, parts: frozenset[str]):
        self.real, self.parts, self.rows, self.columns = real, parts, body.rows, body.columns
        self._formulas = plain_formulas(distance, real)
        rows = _Rows({}, [])
        sheet = mass_weights(scene, body, real)
        self.weight_row = np.array([rows.number(row.tobytes(), row.copy) for row in sheet], np.int64)
        self.weights = np.array(rows.rows)
        self.uneven = (self.weights != 1).any(axis=1)[self.weight_row]

    @cached_property
    def _valence_rows(self) -> list[np.ndarray]:
        """Valences of every row; inner rows are one array."""
        by_key: dict[tuple[int, int], np.ndarray] = {}
        rows = []
        for i in range(self.rows):
            key = min(i, 2), min(self.rows - 1 - i, 2)
            if key not in by_key:
                total = np.zeros(self.columns, np.int64)
                for family in families(self.parts):
                    total += valence(family, i, self.columns, self.rows)
                by_key[key] = total.astype(self.real)
            rows.append(by_key[key])
        return rows

    def valences(self) -> tuple[np.ndarray, np.ndarray]:
        """Return ((n, columns) as `real`, (rows,) the number of a row's)."""
        rows = _Rows({}, [])
        number = [rows.number(id(row), partial(np.asarray, row)) for row in self._valence_rows]
        return np.array(rows.rows), np.array(number, np.int64)

    def reciprocals(self, record: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return ((n, columns), (len(FAMILIES), rows) the number of a row's) of the constraints by their index (i, j),
        0 where there is none."""
        rows = _Rows({}, [])
        nothing = rows.number(None, lambda: np.zeros(self.columns, self.real))
        number = np.full((len(FAMILIES), self.rows), nothing, np.int64)
        for family in families(self.parts):
            k = FAMILIES.index(family)
            for i in range(self.rows - family.rows):
                colour = i % 2 if family.rows and "alternating" in self.parts else 0
                key: tuple[object, ...] = family.name, colour, self.weight_row[i], self.weight_row[i + family.rows]
                if "jacobi" in self.parts:
                    key = *key, id(self._valence_rows[i]), id(self._valence_rows[i + family.rows])
                number[k, i] = rows.number(key, partial(self._row, family, i, record))
        return np.array(rows.rows), number

    def _row(self, family: Family, i: int, record: np.ndarray) -> np.ndarray:
        out: np.ndarray = np.zeros(self.columns, self.real)
        first, second = index_columns(family, self.columns)
        upper, lower = self.weight_row[i], self.weight_row[i + family.rows]
        w_first, w_second = self.weights[upper][first], self.weights[lower][second]
        if "jacobi" in self.parts:
            w_first = self._formulas.weighted_valence(self._valence_rows[i][first], w_first)
            w_second = self._formulas.weighted_valence(self._valence_rows[i + family.rows][second], w_second)
        total = w_first + w_second
        for colour in (0, 1):
            # along a row, only every second constraint can differ in colour
            selected = slice(None) if family.rows else slice(colour, None, 2)
            constants = constants_of(record, kind_of(family, i % 2 if family.rows else colour, self.parts))
            out[: len(total)][selected] = self._values(total[selected], constants)
        return out

    def _values(self, total: np.ndarray, constants: Constants) -> np.ndarray:
        different, which = np.unique(total, return_inverse=True)
        if self.parts & {"load", "jacobi", "averaged-jacobi"}:
            values = [
                self._formulas.reciprocal(weight, constants.stiffening, constants.compliance) for weight in different
            ]
        else:
            values = [{2: constants.both, 1: constants.one, 0: self.real(0)}[int(weight)] for weight in different]
        return np.array(values, self.real)[which]
