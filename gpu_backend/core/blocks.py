"""Communication between blocks of one launch: data through device memory, then a flag that marks it as complete.

A block writes its data, its threads synchronise at the block's barrier, and one thread sets the block's flag with a
`release` store. A thread that sees the flag with an `acquire` load, and passes its own block's barrier, sees the data
(PTX ISA, "Memory consistency model": release and acquire patterns, causality through the barrier). Data is read with
loads that bypass the first-level cache, which other blocks' writes do not reach. Under the simulator, which runs one
block after another, these are plain accesses, valid for one block only.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from softlab.gpu_backend.core.device import simulated
from softlab.model.base.types import Index
from softlab.model.base.variant import instruction

PATIENCE = 1 << 22  # checks of a flag, some seconds, before a block gives up

if simulated():

    def make_flags(scope: str) -> tuple[Callable, Callable]:
        """Return (raise_flag, read_flag), see below."""

        @instruction
        def raise_flag(flags: np.ndarray, index: Index, value: Index) -> None:
            """Set flags[index] = value, after everything this thread's block wrote before its last barrier."""
            flags[index] = value

        @instruction
        def read_flag(flags: np.ndarray, index: Index) -> int:
            """Return the current flags[index]; everything written before by the writer can be read after the block's
            next barrier."""
            return flags[index]

        return raise_flag, read_flag

    @instruction
    def load_fresh_pair(array: np.ndarray, index: Index) -> complex:
        """Return array[index] of a contiguous complex array that other blocks write to."""
        return array[index]

else:
    from llvmlite import ir
    from numba.cuda import types
    from numba.cuda.extending import intrinsic
    from numba.cuda.target import CUDATargetContext

    def _address(
        context: CUDATargetContext, builder: ir.IRBuilder, kind: types.Array, array: ir.Value,
        index_type: types.Integer, index: ir.Value, times: int = 1,
    ) -> ir.Value:  # fmt: skip
        """Return the address of element `index` as an integer."""
        data = context.make_array(kind)(context, builder, array).data
        wide = context.cast(builder, index, index_type, types.int64)
        return builder.ptrtoint(builder.gep(data, [wide]), ir.IntType(64))

    def _assembly(
        builder: ir.IRBuilder, result: ir.Type, arguments: list[ir.Value], text: str, constraints: str
    ) -> ir.Value:
        kind = ir.FunctionType(result, [argument.type for argument in arguments])
        return builder.call(ir.InlineAsm(kind, text, constraints, side_effect=True), arguments)

    def make_flags(scope: str) -> tuple[Callable, Callable]:
        """Make (raise_flag, read_flag) for all threads of the `scope`: "gpu", or "sys", which is every device."""

        @intrinsic
        def raise_flag(typing_context, flags, index, value):
            def generate(context, builder, signature, arguments):
                address = _address(context, builder, signature.args[0], arguments[0], signature.args[1], arguments[1])
                number = context.cast(builder, arguments[2], signature.args[2], types.int32)
                text, constraints = f"st.release.{scope}.global.s32 [$0], $1;", "l,r,~{memory}"
                _assembly(builder, ir.VoidType(), [address, number], text, constraints)
                return context.get_dummy_value()

            return types.void(flags, index, value), generate

        @intrinsic
        def read_flag(typing_context, flags, index):
            def generate(context, builder, signature, arguments):
                address = _address(context, builder, signature.args[0], arguments[0], signature.args[1], arguments[1])
                text, constraints = f"ld.acquire.{scope}.global.s32 $0, [$1];", "=r,l,~{memory}"
                return _assembly(builder, ir.IntType(32), [address], text, constraints)

            return types.int32(flags, index), generate

        return raise_flag, read_flag

    @intrinsic
    def load_fresh_pair(typing_context, array, index):
        def generate(context, builder, signature, arguments):
            address = _address(context, builder, signature.args[0], arguments[0], signature.args[1], arguments[1])
            single = signature.args[0].dtype.underlying_float.bitwidth == 32
            word, letter = ("f32", "f") if single else ("f64", "d")
            scalar = ir.FloatType() if single else ir.DoubleType()
            kind = ir.LiteralStructType([scalar, scalar])
            text = f"ld.relaxed.gpu.global.v2.{word} {{$0, $1}}, [$2];"
            both = _assembly(builder, kind, [address], text, f"={letter},={letter},l,~{{memory}}")
            result = context.make_complex(builder, signature.return_type)
            result.real, result.imag = builder.extract_value(both, 0), builder.extract_value(both, 1)
            return result._getvalue()

        return array.dtype(array, index), generate


raise_flag, read_flag = make_flags("gpu")
