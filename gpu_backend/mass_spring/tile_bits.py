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
