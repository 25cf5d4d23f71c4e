"""The three axes of a mass and a fourth number in one memory transaction: 16 bytes in float32, two of them in float64.

A quad is in a flat array of scalars, four per mass. Device memory is aligned to 256 bytes, and shared memory as
requested, so every quad begins at a multiple of 16 bytes; these intrinsics declare that alignment, so that the compiler
emits vector instructions (core/pairs.py). Under the simulator they are plain indexing.

Rows of any length are read by quads as well (`pack`, `row_of`). The remaining numbers have unsigned indices, since
for a signed one compiled code checks whether it is negative, which took half as long as a constraint.
"""

from __future__ import annotations

import numpy as np

from softlab.gpu_backend.core.device import simulated
from softlab.model.base.types import Index, Number
from softlab.model.base.variant import FEATURE, inlined_routine, instruction, unrolled

AXES = 3
ROWS = 3  # quads of a frame

SIZE = 4  # scalars

if simulated():

    @instruction
    def load_quad(array: np.ndarray, index: Index) -> tuple:
        """Return (x, y, z, fourth number) of mass `index` in a flat array of scalars."""
        k = SIZE * int(index)
        return array[k], array[k + 1], array[k + 2], array[k + 3]

    @instruction
    def store_quad(array: np.ndarray, index: Index, x: Number, y: Number, z: Number, spare: Number) -> None:
        """Set mass `index` = (x, y, z, fourth number)."""
        k = SIZE * int(index)
        array[k], array[k + 1], array[k + 2], array[k + 3] = x, y, z, spare

else:
    from llvmlite import ir
    from numba.cuda import types
    from numba.cuda.extending import intrinsic
    from numba.cuda.target import CUDATargetContext

    BYTES = 16  # of the widest access

    def _places(
        context: CUDATargetContext, builder: ir.IRBuilder, array_type: types.Array, array: ir.Value,
        index_type: types.Integer, index: ir.Value,
    ) -> tuple[list[ir.Value], int]:  # fmt: skip
        """Return (pointers to the vectors of quad `index`, scalars of each)."""
        scalar = context.get_value_type(array_type.dtype)
        width = BYTES * 8 // array_type.dtype.bitwidth
        data = context.make_array(array_type)(context, builder, array).data
        base = builder.bitcast(data, ir.VectorType(scalar, width).as_pointer(data.type.addrspace))
        count = SIZE // width
        wide = context.cast(builder, index, index_type, types.int64)
        first = builder.mul(wide, ir.Constant(wide.type, count))
        return [builder.gep(base, [builder.add(first, ir.Constant(wide.type, n))]) for n in range(count)], width

    @intrinsic
    def load_quad(typing_context, array, index):
        """Return (x, y, z, fourth number) of mass `index` in a flat array of scalars."""

        def generate(context, builder, signature, arguments):
            pointers, width = _places(
                context, builder, signature.args[0], arguments[0], signature.args[1], arguments[1]
            )
            values = []
            for pointer in pointers:
                vector = builder.load(pointer)
                vector.align = BYTES
                for place in range(width):
                    values.append(builder.extract_element(vector, ir.Constant(ir.IntType(32), place)))
            return context.make_tuple(builder, signature.return_type, values)

        return types.UniTuple(array.dtype, SIZE)(array, index), generate

    @intrinsic
    def store_quad(typing_context, array, index, x, y, z, spare):
        """Set mass `index` = (x, y, z, fourth number)."""

        def generate(context, builder, signature, arguments):
            kind = signature.args[0]
            pointers, width = _places(context, builder, kind, arguments[0], signature.args[1], arguments[1])
            for number, pointer in enumerate(pointers):
                vector = ir.Constant(pointer.type.pointee, ir.Undefined)
                for place in range(width):
                    at = 2 + number * width + place
                    value = context.cast(builder, arguments[at], signature.args[at], kind.dtype)
                    vector = builder.insert_element(vector, value, ir.Constant(ir.IntType(32), place))
                builder.store(vector, pointer, align=BYTES)
            return context.get_dummy_value()

        return types.void(array, index, x, y, z, spare), generate


def pack(rows: np.ndarray) -> np.ndarray:
    """Return rows (count, n) as `row_of` reads them, flat: the first quads of all rows, then the second ones, so that
    neighbouring threads read neighbouring quads; the remaining numbers of n at the end, column by column."""
    whole = rows.shape[1] // SIZE * SIZE
    quads = rows[:, :whole].reshape(len(rows), -1, SIZE).swapaxes(0, 1)
    return np.concatenate([quads.ravel(), rows[:, whole:].T.ravel()])


@inlined_routine
def row_of(packed, count, k):
    """Return the FEATURE.numbers numbers of row k of `count`."""
    quads = tuple(load_quad(packed, np.int32(m * count + k)) for m in unrolled(FEATURE.numbers // SIZE))
    return (
        *tuple(quads[n // SIZE][n % SIZE] for n in unrolled(FEATURE.numbers // SIZE * SIZE)),
        *tuple(
            packed[np.uint32(np.int32(n * count) + k)]
            for n in unrolled(FEATURE.numbers // SIZE * SIZE, FEATURE.numbers)
        ),
    )
