"""Flags between GPUs: as gpu_backend/core/blocks.py has them between blocks, but seen by all devices of the system, and the
time, so that no wait is endless (PTX ISA, "Memory consistency model": scope .sys; "Special registers": %globaltimer)."""

from __future__ import annotations

import time
from typing import Any

from gpu_backend.core.device import simulated

if simulated():

    def raise_system_flag(flags: Any, index: Any, value: Any) -> None:
        """flags[index] = value, after everything that this block wrote before its last barrier."""
        flags[index] = value

    def read_system_flag(flags: Any, index: Any) -> Any:
        """flags[index] as it is now; what its writer wrote before can be read after the block's next barrier."""
        return flags[index]

    def nanoseconds() -> int:
        """A clock of the device."""
        return time.perf_counter_ns()

else:
    from llvmlite import ir
    from numba.cuda import types
    from numba.cuda.extending import intrinsic

    from gpu_backend.core.blocks import _address, _assembly

    @intrinsic
    def raise_system_flag(typing_context, flags, index, value):
        def generate(context, builder, signature, arguments):
            address = _address(context, builder, signature.args[0], arguments[0], signature.args[1], arguments[1])
            number = context.cast(builder, arguments[2], signature.args[2], types.int32)
            text, constraints = "st.release.sys.global.s32 [$0], $1;", "l,r,~{memory}"
            _assembly(builder, ir.VoidType(), [address, number], text, constraints)
            return context.get_dummy_value()

        return types.void(flags, index, value), generate

    @intrinsic
    def read_system_flag(typing_context, flags, index):
        def generate(context, builder, signature, arguments):
            address = _address(context, builder, signature.args[0], arguments[0], signature.args[1], arguments[1])
            text, constraints = "ld.acquire.sys.global.s32 $0, [$1];", "=r,l,~{memory}"
            return _assembly(builder, ir.IntType(32), [address], text, constraints)

        return types.int32(flags, index), generate

    @intrinsic
    def nanoseconds(typing_context):
        def generate(context, builder, signature, arguments):
            return _assembly(builder, ir.IntType(64), [], "mov.u64 $0, %globaltimer;", "=l")

        return types.int64(), generate
