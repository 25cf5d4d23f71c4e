"""Memory layout of a position-based solver: combed rows, so that a colour of constraints is a loop over vectors.

Gauss-Seidel projects every second constraint along a row, for example those between columns 2 k and 2 k + 1. In a row
of `classes` = 2 all even columns come first, and then all odd ones: then these constraints lead from one run of numbers
to another. Springs two columns long need classes = 4; Jacobi, which has no colours, 1. Between classes there is a gap
of a block, since the constraints that lead to the class's next column end one further than the loop.

All numbers of a simulation are in one array, its parts at PLACES, so a kernel's functions need few arguments.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softlab.cpu_backend.core.layout import PAGE, SHIFT, Layout, block_of
from softlab.model.base.types import Real

CLASSES = {"structural": 2, "shear": 1, "bending": 4}  # of a row, by its constraints in Gauss-Seidel

# Arguments of kernels: the first four as in core/layout.py, then the classes, and the offsets of the parts of memory.
PLACES = (
    "rows",
    "columns",
    "stride",
    "plane",
    "class_stride",  # from class to class
    "blocks",  # of a class
    "before",  # planes: positions at the start of the substep
    "acceleration",  # planes
    "other",  # planes: the other positions of Jacobi, and with colliders the other velocities
    "multipliers",  # planes: one per family, and the other ones of Jacobi
    "weights",  # rows
    "reciprocals",  # rows
    "valences",  # rows
    "reach",  # planes: of attachments
    "pins",  # rows: positions of the pinned masses, one per axis
    "pin_count",
    "anchors",  # number per mass
    "natural",  # planes of a sheet that is not combed, for wind
    "scratch",  # rows per band
    "scratch_size",  # per band
    "scratch_width",  # per row
    "wind_scratch",  # rows per band, as large
)
(
    P_ROWS,
    P_COLUMNS,
    P_STRIDE,
    P_PLANE,
    P_CLASS,
    P_BLOCKS,
    P_BEFORE,
    P_ACCELERATION,
    P_OTHER,
    P_MULTIPLIERS,
    P_WEIGHTS,
    P_RECIPROCALS,
    P_VALENCES,
    P_MAX_DISTANCE,
    P_PINS,
    P_PIN_COUNT,
    P_ANCHORS,
    P_NATURAL,
    P_SCRATCH,
    P_SCRATCH_SIZE,
    P_SCRATCH_WIDTH,
    P_WIND_SCRATCH,
) = range(len(PLACES))


@dataclass(frozen=True)
class Combed(Layout):
    """A sheet with rows of `classes`, each `class_stride` numbers long, including the gap."""

    classes: int = 1
    class_stride: int = 0
    blocks: int = 0  # of a class, without the gap

    def __post_init__(self) -> None:
        assert self.stride >= self.classes * self.class_stride

    def by_class(self, state: np.ndarray) -> list[np.ndarray]:
        """Return (planes, rows, columns of the class) of each class, a view of a flat state."""
        planes = state.reshape(self.planes, self.plane)[:, : self.rows * self.stride]
        rows = planes.reshape(self.planes, self.rows, self.stride)
        return [
            rows[:, :, k * self.class_stride : k * self.class_stride + -((k - self.columns) // self.classes)]
            for k in range(self.classes)
        ]

    def view(self, state: np.ndarray, columns: int | None = None) -> np.ndarray:
        """Return (planes, rows, columns), columns in their order: a copy if they are combed."""
        assert columns is None, "a combed row has no ghosts"
        if self.classes == 1:
            return self.by_class(state)[0]
        whole = np.empty((self.planes, self.rows, self.columns), state.dtype)
        for k, part in enumerate(self.by_class(state)):
            whole[:, :, k :: self.classes] = part
        return whole

    def rows_of(self, state: np.ndarray, span: slice) -> np.ndarray:
        """Return (planes, rows, columns) of the rows `span`, as Layout.rows_of; a copy."""
        combined = np.empty((self.planes, len(range(self.rows)[span]), self.columns), state.dtype)
        for k, part in enumerate(self.by_class(state)):
            combined[:, :, k :: self.classes] = part[:, span]
        return combined

    def put_rows(self, state: np.ndarray, span: slice, rows: np.ndarray) -> None:
        """Write `rows` into the rows `span`, as Layout.put_rows."""
        for k, part in enumerate(self.by_class(state)):
            part[:, span] = rows[:, :, k :: self.classes]

    def put(self, state: np.ndarray, first: int, values: np.ndarray) -> None:
        """Write `values` (planes, rows, columns) into the planes from number `first` on of a flat state."""
        for k, part in enumerate(self.by_class(state)):
            part[first : first + len(values)] = values[:, :, k :: self.classes]

    def combed_rows(self, rows: np.ndarray, spare: float = 0.0) -> np.ndarray:
        """Return rows (n, columns) in the order of this layout, (n, stride), with `spare` where there is no column."""
        out = np.full((len(rows), self.stride), spare, rows.dtype)
        for k in range(self.classes):
            part = rows[:, k :: self.classes]
            out[:, k * self.class_stride : k * self.class_stride + part.shape[1]] = part
        return out


def combed(rows: int, columns: int, classes: int, real: Real, planes: int) -> Combed:
    """Return the layout of a sheet's state."""
    block, item = block_of(real), np.dtype(real).itemsize
    longest = -(-columns // classes)
    blocks = -(-longest // block)
    class_stride = (blocks + 1) * block
    stride = classes * class_stride
    if stride * item % PAGE == 0:
        stride += block
    plane = rows * stride
    plane += (SHIFT - plane * item) % PAGE // item
    return Combed(rows, columns, stride, plane, planes, classes, class_stride, blocks)


def classes_of(parts: frozenset[str]) -> int:
    """Return the number of classes of a row that the scene's constraints along rows need."""
    if "gauss-seidel" not in parts:
        return 1
    return max([classes for kind, classes in CLASSES.items() if kind in parts], default=1)
