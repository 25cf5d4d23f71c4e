"""Attachments of tetrahedral bodies as springs, for solvers that minimise an energy: |a - p|^2 / (2 compliance) each.

A rigid one is a spring HARD times as stiff as the softer of its ends (`holding`), so that it yields less the finer the
mesh is. Stiffer ones would be more accurate, and vertex block descent would need as many more sweeps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softlab.model.base.types import Real
from softlab.model.base.variant import features_of
from softlab.model.contact.attachments import attachment_sets, part_of
from softlab.model.formulas.elastic.spring import AT_POINT, AT_STIFFNESS, CORNERS, COUNT
from softlab.model.geometry.arithmetic.ordered import total
from softlab.model.geometry.lists import grouped
from softlab.model.particles.tetrahedra.topology import bodies_of_particles
from softlab.model.particles.tetrahedra_set import TetrahedraSet
from softlab.model.tables.cloth import COLLIDER_KINDS
from softlab.model.tetrahedra.constraints import DAMPED
from softlab.model.tetrahedra.newton import holding

HARD = {"vbd": 10.0, "newton": 100.0}  # by solver
PARTS = frozenset({part_of("world"), part_of("bodies")})  # parts of a plan with springs
PAIRS = CORNERS * CORNERS  # blocks of a spring, by rows


def kernel_features(parts: frozenset[str]) -> dict[str, bool]:
    """Return the features of the kernels of a plan's parts, for solvers that minimise an energy."""
    colliders = bool(parts & set(COLLIDER_KINDS))
    return features_of(parts) | {"springs": bool(parts & PARTS), "colliders": colliders, "damped": DAMPED in parts}


class SpringArrays(NamedTuple):
    """Arrays of Springs that kernels read."""

    offsets: np.ndarray
    entries: np.ndarray
    corners: np.ndarray
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class Springs:
    """Springs of attachments.

    `corners` (springs, CORNERS) int32: the vertex, and those that carry its place; the vertex itself where that is in
    the world. `values` (springs, COUNT) float64: model/formulas/elastic/spring.py. Particle k is a corner of
    `entries[offsets[k]]` ... before `entries[offsets[k + 1]]`, int32, each 16 spring + 2 corner, plus one where it counts
    the energy: the first free corner of a spring. `bodies` (springs,) bool: True if another body carries it.
    """

    corners: np.ndarray
    values: np.ndarray
    offsets: np.ndarray
    entries: np.ndarray
    bodies: np.ndarray

    def arrays(self, real: Real) -> SpringArrays:
        return SpringArrays(self.offsets, self.entries, self.corners, np.ascontiguousarray(self.values, real))

    @property
    def fours(self) -> np.ndarray:
        """Rows that contain any two corners of a spring between bodies together, as those of tetrahedra do, (n, 4)
        int32."""
        chosen = self.corners[self.bodies]
        fours: np.ndarray = np.concatenate([np.delete(chosen, n, axis=1) for n in range(CORNERS)])
        return fours

    @property
    def pairs(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (row, column, index in `blocks`), (n,) int64 each, of the blocks that springs add to a matrix of 3 x 3
        blocks."""
        wide, many = self.corners.astype(np.int64), len(self.corners)
        row, column = np.repeat(wide, CORNERS, axis=1), np.tile(wide, (1, CORNERS))
        block = np.arange(many * PAIRS, dtype=np.int64).reshape(many, PAIRS)
        there = self.bodies[:, None] | (np.arange(PAIRS) == 0)
        return row[there], column[there], block[there]

    @property
    def blocks(self) -> np.ndarray:
        """Blocks of `pairs`, (PAIRS springs, 9) float64 [N/m]."""
        weights = np.column_stack([np.ones(len(self.values)), -self.values[:, :AT_POINT]])
        each = self.values[:, AT_STIFFNESS, None, None] * weights[:, :, None] * weights[:, None, :]
        return each.reshape(-1, 1) * np.eye(3).reshape(1, 9)


def springs(body_set: TetrahedraSet, solver: str) -> Springs:
    """Return the springs for a solver of HARD. Raises SceneError."""
    corners, values, bodies = [np.zeros((0, CORNERS), np.int64)], [np.zeros((0, COUNT))], [np.zeros(0, bool)]
    stiffness = holding(body_set)
    for one in attachment_sets(body_set):
        many, compliance = len(one.corners), one.values[:, -1]
        rows = np.zeros((many, COUNT))
        to_body = one.model == "bodies"
        if to_body:
            rows[:, :AT_POINT] = one.values[:, :4]
        else:
            rows[:, AT_POINT : AT_POINT + 3] = one.values[:, :3]
        ends = stiffness[one.corners[:, 0]]
        if to_body:
            ends = np.minimum(ends, (stiffness[one.corners[:, 1:]] * np.abs(one.values[:, :4])).sum(axis=1))
        gives = compliance > 0
        rows[:, AT_STIFFNESS] = np.where(gives, 1 / np.where(gives, compliance, 1.0), HARD[solver] * ends)
        corners.append(one.corners if to_body else np.repeat(one.corners, CORNERS, axis=1))
        values.append(rows)
        bodies.append(np.full(many, to_body))
    all_corners, carried = np.concatenate(corners).astype(np.int32), np.concatenate(bodies)
    return Springs(all_corners, np.concatenate(values), *_entries(body_set, all_corners, carried), carried)


def _entries(body_set: TetrahedraSet, corners: np.ndarray, bodies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (offsets, entries)."""
    free = np.ones(body_set.particle_count, bool)
    free[body_set.pinned_vertices] = False
    place = np.arange(CORNERS)
    there = bodies[:, None] | (place == 0)
    first = np.argmax(free[corners] & there, axis=1)
    entry = 16 * np.arange(len(corners))[:, None] + 2 * place + (place == first[:, None])
    lists = grouped(corners[there].astype(np.int64), entry[there], body_set.particle_count)
    return lists.offsets, lists.indices


def rounding_of(one: Springs, extent: float, real: Real) -> float:
    """Return the residual [J] of springs by rounding of positions, as model/tetrahedra/newton.py for tetrahedra."""
    return float((0.1 * np.finfo(real).eps * extent) ** 2 * total(one.values[:, AT_STIFFNESS]))


def supported_particles(body_set: TetrahedraSet) -> np.ndarray:
    """Return the particles of bodies that are pinned anywhere, or attached to the world, or to a body that is,
    (particles,) bool."""
    bodies = bodies_of_particles(body_set.first_particle, body_set.particle_count)
    supported = np.zeros(len(body_set.parts), bool)
    supported[bodies[body_set.pinned_vertices]] = True
    joined = np.zeros((0, 2), np.int64)
    for one in attachment_sets(body_set):
        if one.model == "bodies":
            joined = np.concatenate([joined, np.unique(bodies[one.corners[:, :2]], axis=0)])
        else:
            supported[bodies[one.corners[:, 0]]] = True
    for _ in range(len(body_set.parts) if len(joined) else 0):
        either = supported[joined].any(axis=1)
        supported[joined[either]] = True
    supported_particle: np.ndarray = supported[bodies]
    return supported_particle
