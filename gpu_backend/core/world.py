"""Data that a mass's step reads besides the masses, passed through device functions as one object."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from softlab.gpu_backend.core.device import DeviceArray


class World(NamedTuple):
    """`parameters`: the constants, by name, a record or its values in registers; `colliders`: rows of colliders, of
    motions and of pins, flat (model/contact/cloth_parameters.py); `integers`: of core/integers.py."""

    parameters: Any
    colliders: DeviceArray
    integers: DeviceArray | None


class Cell(NamedTuple):
    """Position of a mass in its sheet: row `i` of `rows` and column `j` of `columns`."""

    i: np.int32
    j: np.int32
    rows: np.int32
    columns: np.int32
