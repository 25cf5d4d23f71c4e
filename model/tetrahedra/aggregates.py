"""Groups of neighbouring particles that move as rigid bodies: the coarse level of Newton's method on tetrahedra."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softlab.model.particles.tetrahedra_set import TetrahedraSet
from softlab.model.tetrahedra.block_rows import BlockRows

FEWEST = 10  # particles of a group: enough for six rigid motions, and still a coarser mesh
MOST = 48  # groups of a body: 288 unknowns, whose factorisation takes less than a tenth of a solve
MODES = 6  # of a rigid body


class Aggregates(NamedTuple):
    """Group a has the particles `members[starts[a]]` ... before `members[starts[a + 1]]`.

    `group` (particles,): the group of each, -1 for pinned ones. `last_column` (6 groups,): for each row of the coarse
    matrix, whose rows are the groups' six motions one after the other, the last non-zero one, ascending. All int32.
    `width`: of its band.
    """

    starts: np.ndarray
    members: np.ndarray
    group: np.ndarray
    last_column: np.ndarray

    @property
    def number(self) -> int:
        """Number of groups."""
        return len(self.starts) - 1

    @property
    def width(self) -> int:
        """Largest number of entries in a row, from its diagonal on."""
        return int((self.last_column - np.arange(len(self.last_column)) + 1).max(initial=1))


def aggregates(body_set: TetrahedraSet, rows: BlockRows, free: np.ndarray) -> Aggregates:
    """Return the groups of each body's `free` particles, (particles,) bool, by repeated cuts across the longest
    side."""
    groups: list[np.ndarray] = []
    ends = [*body_set.first_particle[1:], body_set.particle_count]
    for first, last in zip(body_set.first_particle, ends, strict=True):
        free_particles = np.flatnonzero(free[first:last]) + first
        if len(free_particles):
            groups.extend(_cut(body_set.position, free_particles, max(1, min(MOST, len(free_particles) // FEWEST))))
    group = np.full(body_set.particle_count, -1)
    for number, members in enumerate(groups):
        group[members] = number
    of_row = np.repeat(group, np.diff(rows.starts))
    there = group[rows.columns]
    furthest = np.arange(len(groups))
    body = np.searchsorted(body_set.first_particle, np.arange(body_set.particle_count), side="right")
    same = (
        np.repeat(body, np.diff(rows.starts)) == body[rows.columns]
    )  # what attachments connect is left to the fine level
    both = (of_row >= 0) & (there >= 0) & same
    np.maximum.at(furthest, of_row[both], there[both])
    furthest = np.maximum.accumulate(furthest)
    return Aggregates(*(
        np.ascontiguousarray(one, np.int32)
        for one in (
            np.cumsum([0, *(len(members) for members in groups)]),
            np.concatenate([*groups, np.zeros(0, np.int64)]), group, np.repeat(MODES * furthest + MODES - 1, MODES),
        )
    ))  # fmt: skip


class Couplings(NamedTuple):
    """Sums that make the blocks of the coarse matrix on and above its diagonal.

    Pair n, of the groups `first[n]` and `second[n]` >= `first[n]`, is the sum of the blocks `blocks[starts[n]]` ...
    before `blocks[starts[n + 1]]`, in the order of rows; block b belongs to the row `row[b]`. Groups `bodies[n]` to
    before `bodies[n + 1]` are coupled to no others; `body_of` (groups,): that n; `places[n]`: where a dense matrix of
    their motions begins, one after the other. All int32.
    """

    starts: np.ndarray
    first: np.ndarray
    second: np.ndarray
    blocks: np.ndarray
    row: np.ndarray
    bodies: np.ndarray
    body_of: np.ndarray
    places: np.ndarray


def couplings(groups: Aggregates, rows: BlockRows) -> Couplings:
    """Return the couplings for kernels that sum all pairs at once."""
    row = np.repeat(np.arange(len(rows.starts) - 1), np.diff(rows.starts))
    first, second = groups.group[row].astype(np.int64), groups.group[rows.columns].astype(np.int64)
    chosen = np.flatnonzero((first >= 0) & (second >= first))
    chosen = chosen[MODES * second[chosen] <= groups.last_column[MODES * first[chosen]]]  # of one body
    key = first[chosen] * max(groups.number, 1) + second[chosen]
    order = np.argsort(key, kind="stable")
    keys, starts = np.unique(key[order], return_index=True)
    furthest = groups.last_column[MODES - 1 :: MODES] // MODES
    bodies = np.append(0, np.flatnonzero(furthest == np.arange(groups.number)) + 1)
    sizes = np.diff(bodies)
    return Couplings(*(
        np.ascontiguousarray(one, np.int32)
        for one in (
            np.append(starts, len(order)), keys // max(groups.number, 1), keys % max(groups.number, 1), chosen[order], row,
            bodies, np.repeat(np.arange(len(sizes)), sizes), np.cumsum([0, *(MODES * sizes.astype(np.int64)) ** 2]),
        )
    ))  # fmt: skip


def _cut(position: np.ndarray, members: np.ndarray, count: int) -> list[np.ndarray]:
    """Return the `members` in `count` groups, along the longest side of the box around them."""
    if count == 1:
        return [np.sort(members)]
    axis = int(np.ptp(position[members], axis=0).argmax())
    order = members[np.argsort(position[members, axis], kind="stable")]
    low = count // 2
    middle = len(order) * low // count
    return [*_cut(position, order[:middle], low), *_cut(position, order[middle:], count - low)]
