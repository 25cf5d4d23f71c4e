"""Groups of arguments of the mass-spring kernels on CPU threads, by name."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

Empty = tuple[()]


class Passes(NamedTuple):
    """Number of passes, kinds of the first and of the last, number of the step that the first one begins."""

    number: int
    first: int
    last: int
    step: int


class Sheet(NamedTuple):
    """Arguments of a pass besides the states: integers of the layout (L_ of core/layout.py), constants, integers of random
    forces, first pin of each row and columns of pins, colliders and their kinds."""

    layout: np.ndarray
    parameters: np.record
    integers: np.ndarray
    pin_start: np.ndarray
    pin_column: np.ndarray
    bodies: np.ndarray | Empty = ()
    kinds: np.ndarray | Empty = ()


class ImplicitArrays(NamedTuple):
    """Arrays of implicit Euler: WORK_PLANES planes, a row of scratch and LANES sums of each band, sums of segments, the
    tree that adds them, counters of a simulation, values that passes leave for the next."""

    work: np.ndarray
    scratches: np.ndarray
    lanes: np.ndarray
    sums: np.ndarray
    tree: np.ndarray
    done: np.ndarray
    control: np.ndarray
