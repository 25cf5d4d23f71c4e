"""Both axes of a mass in one memory transaction: 8 bytes in float32, 16 in float64.

numba.cuda loads a complex number as two scalars, because it only knows the alignment of a scalar. Device memory is
aligned to 256 bytes and a pair is at a multiple of its size; these two intrinsics declare that alignment, so that the
compiler emits one vector instruction. Under the simulator they are plain indexing.
"""

from __future__ import annotations

import numpy as np

from softlab.gpu_backend.core.device import simulated
from softlab.model.base.types import Index, Number
from softlab.model.base.variant import instruction

if simulated():

    @instruction
    def load_pair(array: np.ndarray, index: Index) -> complex:
        """Return array[index] of a contiguous complex array."""
        return array[index]

    @instruction
    def store_pair(array: np.ndarray, index: Index, x: Number, y: Number) -> None:
        """Set array[index] = x + i y."""
        array[index] = complex(x, y)

else:
    from llvmlite import ir
    from numba.cuda import types
    from numba.cuda.extending import intrinsic
    from numba.cuda.target import CUDATargetContext

    def _pointer(
        context: CUDATargetContext, builder: ir.IRBuilder, array_type: types.Array, array: ir.Value,
        index_type: types.Integer, index: ir.Value,
    ) -> tuple[ir.Value, int]:  # fmt: skip
        """Return (pointer to element `index` as a vector of two scalars, bytes of the vector)."""
        scalar = context.get_value_type(array_type.dtype.underlying_float)
        vector = ir.VectorType(scalar, 2)
        data = context.make_array(array_type)(context, builder, array).data
        base = builder.bitcast(data, vector.as_pointer(data.type.addrspace))
        wide = context.cast(builder, index, index_type, types.int64)
        return builder.gep(base, [wide]), 2 * array_type.dtype.underlying_float.bitwidth // 8

    @intrinsic
    def load_pair(typing_context, array, index):
        """Return array[index] of a contiguous complex array, in one load."""

        def generate(context, builder, signature, arguments):
            pointer, size = _pointer(context, builder, signature.args[0], arguments[0], signature.args[1], arguments[1])
            vector = builder.load(pointer)
            vector.align = size
            result = context.make_complex(builder, signature.return_type)
            result.real = builder.extract_element(vector, ir.Constant(ir.IntType(32), 0))
            result.imag = builder.extract_element(vector, ir.Constant(ir.IntType(32), 1))
            return result._getvalue()

        return array.dtype(array, index), generate

    @intrinsic
    def store_pair(typing_context, array, index, x, y):
        """Set array[index] = x + i y, in one store."""

        def generate(context, builder, signature, arguments):
            pointer, size = _pointer(context, builder, signature.args[0], arguments[0], signature.args[1], arguments[1])
            vector = ir.Constant(pointer.type.pointee, ir.Undefined)
            for place in range(2):
                vector = builder.insert_element(vector, arguments[2 + place], ir.Constant(ir.IntType(32), place))
            builder.store(vector, pointer, align=size)
            return context.get_dummy_value()

        return types.void(array, index, x, y), generate
