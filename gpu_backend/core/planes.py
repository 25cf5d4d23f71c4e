"""Access to a scalar of shared memory at a fixed distance from an index: one instruction, with the distance as part of
its address.

If an index is summed in the kernel's integers, the compiler cannot exclude that the sum wraps around, and computes
every neighbour's address again. These intrinsics offset the address itself. Under the simulator they are plain
indexing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softlab.gpu_backend.core.device import simulated
from softlab.model.base.types import Index, Number
from softlab.model.base.variant import instruction

if simulated():

    @instruction
    def near(array: np.ndarray, place: Index, distance: Index) -> float:
        """Return array[place + distance] of a contiguous array of scalars."""
        return array[int(place) + int(distance)]

    @instruction
    def put_near(array: np.ndarray, place: Index, distance: Index, value: Number) -> None:
        """Set array[place + distance] = value."""
        array[int(place) + int(distance)] = value

else:
    from llvmlite import ir
    from numba.cuda import types
    from numba.cuda.extending import intrinsic
    from numba.cuda.target import CUDATargetContext
    from numba.cuda.typing import Signature

    def _pointer(
        context: CUDATargetContext, builder: ir.IRBuilder, signature: Signature, arguments: Sequence[ir.Value]
    ) -> ir.Value:
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        place = context.cast(builder, arguments[1], signature.args[1], types.int64)
        distance = context.cast(builder, arguments[2], signature.args[2], types.int64)
        return builder.gep(builder.gep(data, [place]), [distance])

    @intrinsic
    def near(typing_context, array, place, distance):
        """Return array[place + distance] of a contiguous array of scalars."""

        def generate(context, builder, signature, arguments):
            return builder.load(_pointer(context, builder, signature, arguments))

        return array.dtype(array, place, distance), generate

    @intrinsic
    def put_near(typing_context, array, place, distance, value):
        """Set array[place + distance] = value."""

        def generate(context, builder, signature, arguments):
            number = context.cast(builder, arguments[3], signature.args[3], signature.args[0].dtype)
            builder.store(number, _pointer(context, builder, signature, arguments))
            return context.get_dummy_value()

        return types.void(array, place, distance, value), generate
