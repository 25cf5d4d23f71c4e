"""The rows of scratch of a walk down a cloth's rows, and their layout."""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.core.layout import BLOCK, block_of
from softlab.model.base.types import Real
from softlab.model.base.variant import routine

AXES = 3
SPAN = 2  # columns that a spring spans at most


def cloth_variant(kernel: str, real: Real, math: str, parts: frozenset[str]) -> str:
    """Return a unique name of a kernel's variant. A cloth has many parts and file names are limited, so a part is
    shortened to the first two letters of each word: `st_stda` for structural springs with dampers."""
    codes = ["".join(word[:2] for word in part.split("-")) for part in sorted(parts)]
    return "_".join([kernel.replace("-", "_"), np.dtype(real).name, math, *codes])


def triples_of(parts: frozenset[str]) -> dict[str, int]:
    """Return the rows of scratch of a band: name -> number of its first triple (one row per axis), and `count`.

    Rows that a later row still reads have two, or for springs over two rows three, triples, used in turn. `close` and
    `open` are sums of accelerations: of the step, and, where random forces make it differ (velocity Verlet), of the one
    before.
    """
    wanted = {"close": 1, "open": 1}
    if "structural" in parts:
        wanted |= {"across": 1, "down": 2}
    if "shear" in parts:
        wanted |= {"right": 2, "left": 2}
    if "bending" in parts:
        wanted |= {"far_across": 1, "far_down": 3}
    if "wind" in parts:
        wanted |= {"first": 2, "second": 2}
    places, count = {}, 0
    for name, turns in wanted.items():
        places[name] = count
        count += turns
    return places | {"count": count}


def scratch_width(columns: int, real: Real) -> int:
    """Return the numbers in a row of scratch: whole blocks, and one more block on either side for the springs'
    reach."""
    block = block_of(real)
    return -(-columns // block) * block + 2 * block


@routine
def row_start(triple, axis, width):
    """Return the index of column 0 of a row of a band's flat scratch."""
    return np.int64((AXES * triple + axis) * width + BLOCK)


@routine
def row_edge(triple, axis, width):
    """Return the index of column -SPAN of a row of a band's flat scratch."""
    return np.int64((AXES * triple + axis) * width + BLOCK - SPAN)


@routine
def clear_column(scratch, triple, column, width):
    for axis in range(AXES):
        scratch[(AXES * triple + axis) * width + BLOCK + column] = 0.0


@routine
def clear_triple(scratch, triple, width):
    for k in range(AXES * triple * width, AXES * (triple + 1) * width):
        scratch[k] = 0.0
