"""The steps that a call of a kernel does."""

from __future__ import annotations

from typing import NamedTuple


class Steps(NamedTuple):
    """Number of steps, number of the first one, substeps of a step, iterations of a substep."""

    steps: int
    step: int
    substeps: int
    iterations: int
