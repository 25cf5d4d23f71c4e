"""Memory layout of a state: padded rows, so that a loop along a row consists of whole vectors.

A state is four planes (x, y, vx, vy), one flat array. A row is followed by at least one padding column, a *ghost*,
which stores the position of the row's last mass. Coincident masses do not pull, so the loop needs no case for the edge.
Loops run over whole BLOCKS of columns and so compute some ghosts; these are reset afterwards, and masses only ever read
the first of them. Rows and planes are a little longer than a power of two, since streams at a multiple of 4 KiB from
each other map to the same few sets of the first-level cache.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from softlab.cpu_backend.core.plain import in_python
from softlab.model.base.types import Compile, Real
from softlab.model.base.variant import CountOfPrecision

LINE = 64  # bytes of a cache line, and of the widest vectors
PAGE = 4096  # bytes after which addresses map to the same sets of the first-level cache
SHIFT = 320  # bytes by which neighbouring planes are shifted in it
PLANES = 4  # of a grid; a cloth has six

# indices in the array of integers for kernels
L_ROWS, L_COLUMNS, L_STRIDE, L_PLANE = range(4)


_built_in: Compile = intrinsic  # typed by numba when it is compiled


def block_of(real: Real) -> int:
    """Return the number of columns per iteration of loops along a row: a cache line."""
    return LINE // np.dtype(real).itemsize


BLOCK = CountOfPrecision(block_of)


def aligned_zeros(count: int, real: Real) -> np.ndarray:
    """Return `count` zeros, aligned to a cache line."""
    item = np.dtype(real).itemsize
    memory: np.ndarray = np.zeros(count + LINE // item, real)
    first = -memory.ctypes.data % LINE // item
    return memory[first : first + count]


@dataclass(frozen=True)
class Layout:
    """Layout of `rows` x `columns` masses. `stride`: scalars from row to row; `plane`: from plane to plane."""

    rows: int
    columns: int
    stride: int
    plane: int
    planes: int = PLANES

    @property
    def size(self) -> int:
        """Number of scalars of a state."""
        return self.planes * self.plane

    def integers(self) -> np.ndarray:
        """Return the integers for kernels, indexed by L_ROWS and so on."""
        return np.array([self.rows, self.columns, self.stride, self.plane], np.int64)

    def view(self, state: np.ndarray, columns: int | None = None) -> np.ndarray:
        """Return (planes, rows, columns) of a flat state, without its ghosts (or with those up to `columns`)."""
        planes = state.reshape(self.planes, self.plane)[:, : self.rows * self.stride]
        return planes.reshape(self.planes, self.rows, self.stride)[:, :, : columns or self.columns]

    def rows_of(self, state: np.ndarray, span: slice) -> np.ndarray:
        """Return (planes, rows, columns) of the rows `span` of a flat state, columns in their order."""
        return self.view(state)[:, span]

    def put_rows(self, state: np.ndarray, span: slice, rows: np.ndarray) -> None:
        """Write `rows` into the rows `span` of a flat state."""
        self.view(state)[:, span] = rows


def plain(rows: int, columns: int, planes: int = PLANES) -> Layout:
    """Return a layout without padding, planes as in NumPy, for kernels that take arrays of (rows, columns)."""
    return Layout(rows, columns, columns, rows * columns, planes)


def padded(rows: int, columns: int, real: Real, planes: int = PLANES) -> Layout:
    """Return the layout for loops over whole blocks."""
    block, item = block_of(real), np.dtype(real).itemsize
    stride = (columns // block + 1) * block
    if stride * item % PAGE == 0:
        stride += block
    plane = rows * stride
    return Layout(rows, columns, stride, plane + block + (SHIFT - (plane + block) * item) % PAGE // item, planes)


@_built_in
def row_at(typing_context, array, offset):
    """Return the part of a flat array from `offset` on, as an array of unchecked length.

    A slice would cost bounds checks and reference counts for a dozen rows at a time, more than a short row itself.
    """
    if not (isinstance(array, types.Array) and array.ndim == 1 and array.layout == "C"):
        return None
    view = types.Array(array.dtype, 1, "C")

    def build(context, builder, signature, arguments):
        whole = context.make_array(array)(context, builder, arguments[0])
        part = context.make_array(view)(context, builder)
        item = context.get_abi_sizeof(context.get_data_type(array.dtype))
        context.populate_array(
            part,
            data=builder.gep(whole.data, [arguments[1]], inbounds=True),
            shape=cgutils.unpack_tuple(builder, whole.shape),
            strides=[context.get_constant(types.intp, item)],
            itemsize=context.get_constant(types.intp, item),
            meminfo=None,
        )
        return part._getvalue()

    return view(array, types.int64), build


@in_python(row_at)
def _row_at(array: np.ndarray, offset: int) -> np.ndarray:
    return array[offset:]
