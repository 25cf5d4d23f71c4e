"""Masses of a thread's strip as bits of an integer: bit r is mass r, r rows below the strip's first one."""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.gpu_backend.core.compile import inlined


def make_bits_between(math: str, strip: int) -> Any:
    """Make bits_between(first, end, i): bit r set if first <= i + r < end."""

    @inlined(math)
    def bits_between(first, end, i):
        bits = np.int32(0)
        for r in range(strip):
            row = i + np.int32(r)
            if row >= first and row < end:
                bits = bits | np.int32(1 << r)
        return bits

    return bits_between


def make_border_bits(math: str, strip: int, rings: Any) -> Any:
    """Make border_bits(owned_rows, i, j, owned, rows, columns): those of the bits `owned_rows` that other blocks need.

    `owned`: first and end of the rows that the block owns, and the same of its columns. Others need the outer `rings`
    of these masses, except at the edges of the sheet.
    """
    bits_between = make_bits_between(math, strip)

    @inlined(math)
    def border_bits(owned_rows, i, j, owned, rows, columns):
        row_first, row_end, column_first, column_end = owned
        inner_first, inner_end = row_first, row_end
        if row_first > 0:
            inner_first = np.int32(row_first + rings)
        if row_end < rows:
            inner_end = np.int32(row_end - rings)
        border = owned_rows & ~bits_between(inner_first, inner_end, i)
        if (column_first > 0 and j < column_first + rings) or (column_end < columns and j >= column_end - rings):
            border = owned_rows
        return np.int32(border)

    return border_bits
