"""The stiffness of tetrahedra as 3 x 3 blocks in compressed rows: positions of the blocks, and the terms of each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

BLOCKS = 10  # stored ones of a tetrahedron: of the pairs of corners p <= q
_PLACE = np.array([[0, 1, 2, 3], [1, 4, 5, 6], [2, 5, 7, 8], [3, 6, 8, 9]])  # index of a pair's block among them


class BlockRows(NamedTuple):
    """Row k, of particle k, has the blocks `starts[k]` to before `starts[k + 1]`, `columns` (blocks,) ascending.

    Its diagonal block is at `diagonal[k]`. Block n is the sum of the tetrahedra's blocks `items[sources[n]]` ... before
    `items[sources[n + 1]]`, in the order of the tetrahedra: an item is twice (BLOCKS tetrahedron + block), plus one if
    it is transposed. Particle k is the corner of `corners[corner_starts[k]]` ... before `corners[corner_starts[k + 1]]`:
    4 tetrahedron + corner. All int32.
    """

    starts: np.ndarray
    columns: np.ndarray
    diagonal: np.ndarray
    sources: np.ndarray
    items: np.ndarray
    corner_starts: np.ndarray
    corners: np.ndarray


Pairs = tuple[np.ndarray, np.ndarray, np.ndarray]
NO_PAIRS: Pairs = (np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0, np.int64))


def block_rows(tetrahedra: np.ndarray, particles: int, others: Pairs = NO_PAIRS) -> BlockRows:
    """Return the rows of `tetrahedra` (tetrahedra, 4) on `particles` particles; a particle without tetrahedra has an
    empty block.

    `others`: (row, column, block) (n,) of symmetric blocks after all of the tetrahedra's.
    """
    count = len(tetrahedra)
    wide = tetrahedra.astype(np.int64)
    row, column = np.repeat(wide, 4, axis=1).ravel(), np.tile(wide, (1, 4)).ravel()
    first, second = np.divmod(np.tile(np.arange(16), count), 4)
    item = 2 * (BLOCKS * np.repeat(np.arange(count, dtype=np.int64), 16) + _PLACE[first, second]) + (first > second)
    row, column = np.concatenate([row, others[0]]), np.concatenate([column, others[1]])
    item = np.concatenate([item, 2 * (BLOCKS * count + others[2])])
    here = np.arange(particles, dtype=np.int64)
    key = np.concatenate([row * particles + column, here * particles + here])  # with a diagonal in every row
    keys, place = np.unique(key, return_inverse=True)
    of_tetrahedra, diagonal = place[: len(row)], place[len(row) :]
    order = np.argsort(of_tetrahedra, kind="stable")
    corner = np.argsort(wide.ravel(), kind="stable")
    return BlockRows(*(
        np.ascontiguousarray(one, np.int32)
        for one in (
            np.searchsorted(keys, np.arange(particles + 1, dtype=np.int64) * particles), keys % particles, diagonal,
            np.searchsorted(of_tetrahedra[order], np.arange(len(keys) + 1)), item[order],
            np.searchsorted(wide.ravel()[corner], np.arange(particles + 1)), corner,
        )
    ))  # fmt: skip
