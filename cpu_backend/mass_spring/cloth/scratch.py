"""The rows of scratch that a walk down a cloth's rows keeps: which there are, and where."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from cpu_backend.core.compile import Compiler
from cpu_backend.core.layout import block_of

AXES = 3
REACH = 2  # columns that a spring spans at most


def cloth_variant(kernel: str, real: Any, math: str, parts: frozenset[str]) -> str:
    """A name that tells every variant of a kernel apart. A cloth has many parts and a file's name an end, so that of a part
    only the first two letters of each word are told: `st_stda` for structural springs with dampers."""
    codes = ["".join(word[:2] for word in part.split("-")) for part in sorted(parts)]
    return "_".join([kernel.replace("-", "_"), np.dtype(real).name, math, *codes])


def triples_of(parts: frozenset[str]) -> dict[str, int]:
    """Which rows of scratch a band needs: name -> number of its first triple (a row for each axis), and `count`.

    Of what a later row still reads there are two or, two rows apart, three triples, which take turns. `close` and `open`
    are sums of accelerations: of the step, and where random forces make it differ (velocity Verlet) of the one before.
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


def scratch_width(columns: int, real: Any) -> int:
    """Numbers of a row of scratch: whole blocks, and one more block on either side for the springs' reach."""
    block = block_of(real)
    return -(-columns // block) * block + 2 * block


def make_scratch(compiler: Compiler, real: Any) -> SimpleNamespace:
    """Places in a band's flat scratch: `place(triple, axis, width)`, where a row's column 0 is; `edge`, its column -REACH.
    `forget(scratch, triple, column, width)` puts zeros into a column, `clear(scratch, triple, width)` everywhere."""
    block, zero = block_of(real), real(0)

    @compiler.compiled
    def place(triple, axis, width):
        return np.int64((AXES * triple + axis) * width + block)

    @compiler.compiled
    def edge(triple, axis, width):
        return np.int64((AXES * triple + axis) * width + block - REACH)

    @compiler.compiled
    def forget(scratch, triple, column, width):
        for axis in range(AXES):
            scratch[(AXES * triple + axis) * width + block + column] = zero

    @compiler.compiled
    def clear(scratch, triple, width):
        for k in range(AXES * triple * width, AXES * (triple + 1) * width):
            scratch[k] = zero

    return SimpleNamespace(place=place, edge=edge, forget=forget, clear=clear)
