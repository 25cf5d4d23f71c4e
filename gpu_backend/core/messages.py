"""Messages between blocks of the same launch: a vector in one word together with its sequence number.

A flag beside the data (core/blocks.py) makes its writer wait until the data is visible to all, and costs its reader a
second memory access. Here each word of 16 bytes has its own tag: a thread that reads the expected tag has the data with
it, since an access to a .b128 is a single one (PTX ISA, "Memory consistency model": scalar data types). It is the idea
of the low-latency protocol of NCCL, whose words have 8 bytes. float32: one word, (x, y, z, tag); float64: three, (x,
tag), (y, tag), (z, tag). Words bypass the first-level cache, which other blocks' writes do not reach.

Under the simulator the tag is a number beside the others, written last and read first.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence

import numpy as np

from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.device import simulated
from softlab.model.base.types import Index, Number, Real
from softlab.model.base.variant import FEATURE, inlined_routine, instruction


def message_size(real: Real) -> int:
    """Return the number of scalars of a message."""
    return 4 if real is np.float32 else 6


if simulated():

    def let_others_run() -> None:
        """Let the senders run while a receiver waits, if the simulator's threads alternate."""
        getattr(threading.current_thread(), "give_way", _no_turns)()

    def _no_turns() -> None:
        time.sleep(0)

    @instruction
    def _send_32(array: np.ndarray, index: Index, x: Number, y: Number, z: Number, tag: Index) -> None:
        k = 4 * int(index)
        array[k], array[k + 1], array[k + 2] = x, y, z
        array[k + 3] = tag

    @instruction
    def _receive_32(array: np.ndarray, index: Index) -> tuple[float, float, float, int]:
        k = 4 * int(index)
        tag = array[k + 3]
        return array[k], array[k + 1], array[k + 2], tag

    @instruction
    def _send_64(array: np.ndarray, index: Index, x: Number, tag: Index) -> None:
        k = 2 * int(index)
        array[k] = x
        array[k + 1] = tag

    @instruction
    def _receive_64(array: np.ndarray, index: Index) -> tuple[float, int]:
        k = 2 * int(index)
        tag = array[k + 1]
        return array[k], tag

    @instruction
    def _checked(arrived: bool) -> bool:
        if not arrived:
            let_others_run()
        return arrived

    @instruction
    def pause(cycles: Index) -> None:
        """Wait for that many cycles of the multiprocessor."""

else:
    from llvmlite import ir
    from numba.cuda import types
    from numba.cuda.extending import intrinsic
    from numba.cuda.target import CUDATargetContext
    from numba.cuda.typing import Signature

    FLOAT, DOUBLE, WORD, LONG = ir.FloatType(), ir.DoubleType(), ir.IntType(32), ir.IntType(64)

    def _address(
        context: CUDATargetContext, builder: ir.IRBuilder, kind: types.Array, array: ir.Value,
        index_type: types.Integer, index: ir.Value, size: int,
    ) -> ir.Value:  # fmt: skip
        data = context.make_array(kind)(context, builder, array).data
        wide = context.cast(builder, index, index_type, types.int64)
        first = builder.mul(wide, ir.Constant(wide.type, size))
        return builder.ptrtoint(builder.gep(data, [first]), LONG)

    def _assembly(
        builder: ir.IRBuilder, result: ir.Type, arguments: list[ir.Value], text: str, constraints: str
    ) -> ir.Value:
        kind = ir.FunctionType(result, [argument.type for argument in arguments])
        return builder.call(ir.InlineAsm(kind, text, constraints, side_effect=True), arguments)

    # Each text is a separate block, so that its register names can be used again.
    SEND_32 = (
        "{ .reg .b64 a, b; .reg .b128 w; mov.b64 a, {$1, $2}; mov.b64 b, {$3, $4}; mov.b128 w, {a, b}; "
        "st.relaxed.gpu.global.b128 [$0], w; }"
    )
    RECEIVE_32 = (
        "{ .reg .b64 a, b; .reg .b128 w; ld.relaxed.gpu.global.b128 w, [$4]; mov.b128 {a, b}, w; "
        "mov.b64 {$0, $1}, a; mov.b64 {$2, $3}, b; }"
    )
    SEND_64 = "{ .reg .b128 w; mov.b128 w, {$1, $2}; st.relaxed.gpu.global.b128 [$0], w; }"
    RECEIVE_64 = "{ .reg .b128 w; ld.relaxed.gpu.global.b128 w, [$2]; mov.b128 {$0, $1}, w; }"

    @intrinsic
    def _clock(typing_context):
        def generate(context, builder, signature, arguments):
            return _assembly(builder, WORD, [], "mov.u32 $0, %clock;", "=r")

        return types.int32(), generate

    @inlined("exact")
    def _checked(arrived):
        return arrived

    @inlined("exact")
    def pause(cycles):
        """Wait for that many cycles of the multiprocessor."""
        begin = _clock()
        while np.int32(_clock() - begin) < cycles:
            pass

    @intrinsic
    def _send_32(typing_context, array, index, x, y, z, tag):
        def generate(context, builder, signature, arguments):
            address = _address(context, builder, *_typed(signature, arguments), 4)
            scalars = [context.cast(builder, arguments[n], signature.args[n], types.float32) for n in (2, 3, 4)]
            number = context.cast(builder, arguments[5], signature.args[5], types.int32)
            _assembly(builder, ir.VoidType(), [address, *scalars, number], SEND_32, "l,f,f,f,r,~{memory}")
            return context.get_dummy_value()

        return types.void(array, index, x, y, z, tag), generate

    @intrinsic
    def _receive_32(typing_context, array, index):
        def generate(context, builder, signature, arguments):
            address = _address(context, builder, *_typed(signature, arguments), 4)
            kind = ir.LiteralStructType([FLOAT, FLOAT, FLOAT, WORD])
            word = _assembly(builder, kind, [address], RECEIVE_32, "=f,=f,=f,=r,l,~{memory}")
            values = [builder.extract_value(word, n) for n in range(4)]
            return context.make_tuple(builder, signature.return_type, values)

        kinds = types.Tuple((types.float32, types.float32, types.float32, types.int32))
        return kinds(array, index), generate

    @intrinsic
    def _send_64(typing_context, array, index, x, tag):
        def generate(context, builder, signature, arguments):
            address = _address(context, builder, *_typed(signature, arguments), 2)
            scalar = context.cast(builder, arguments[2], signature.args[2], types.float64)
            number = context.cast(builder, arguments[3], signature.args[3], types.int64)
            _assembly(builder, ir.VoidType(), [address, scalar, number], SEND_64, "l,d,l,~{memory}")
            return context.get_dummy_value()

        return types.void(array, index, x, tag), generate

    @intrinsic
    def _receive_64(typing_context, array, index):
        def generate(context, builder, signature, arguments):
            address = _address(context, builder, *_typed(signature, arguments), 2)
            kind = ir.LiteralStructType([DOUBLE, LONG])
            word = _assembly(builder, kind, [address], RECEIVE_64, "=d,=l,l,~{memory}")
            values = [builder.extract_value(word, n) for n in range(2)]
            return context.make_tuple(builder, signature.return_type, values)

        return types.Tuple((types.float64, types.int64))(array, index), generate

    def _typed(
        signature: Signature, arguments: Sequence[ir.Value]
    ) -> tuple[types.Array, ir.Value, types.Integer, ir.Value]:
        return signature.args[0], arguments[0], signature.args[1], arguments[1]


@inlined_routine
def send(array, index, x, y, z, tag):
    """Send a vector in message `index` of an array."""
    if FEATURE.single:
        _send_32(array, index, x, y, z, tag)
    else:
        first = np.int32(np.int32(3) * index)
        _send_64(array, first, x, tag)
        _send_64(array, first + np.int32(1), y, tag)
        _send_64(array, first + np.int32(2), z, tag)


@inlined_routine
def receive(array, index, tag):
    """Return (x, y, z, true if the message with this tag has arrived)."""
    if FEATURE.single:
        x, y, z, received = _receive_32(array, index)
        return x, y, z, _checked(received == tag)
    first = np.int32(np.int32(3) * index)
    x, of_x = _receive_64(array, first)
    y, of_y = _receive_64(array, first + np.int32(1))
    z, of_z = _receive_64(array, first + np.int32(2))
    return x, y, z, _checked(of_x == tag and of_y == tag and of_z == tag)
