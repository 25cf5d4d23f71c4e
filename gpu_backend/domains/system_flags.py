"""Flags between GPUs: like those of gpu_backend/core/blocks.py between blocks, but visible to all devices of the
system; and the time, so that every wait has a timeout (PTX ISA, "Memory consistency model": scope .sys; "Special
registers": %globaltimer)."""

from __future__ import annotations

import time

from softlab.gpu_backend.core.blocks import make_flags
from softlab.gpu_backend.core.device import simulated
from softlab.model.base.variant import instruction

raise_system_flag, read_system_flag = make_flags("sys")

if simulated():

    @instruction
    def nanoseconds() -> int:
        """Return a clock of the device."""
        return time.perf_counter_ns()

else:
    from llvmlite import ir
    from numba.cuda import types
    from numba.cuda.extending import intrinsic

    from softlab.gpu_backend.core.blocks import _assembly

    @intrinsic
    def nanoseconds(typing_context):
        def generate(context, builder, signature, arguments):
            return _assembly(builder, ir.IntType(64), [], "mov.u64 $0, %globaltimer;", "=l")

        return types.int64(), generate
