"""Flushing subnormal numbers to zero, per thread: bits of the floating-point control register.

A resting float32 scene has subnormal velocities, on which processors are ten times slower or more. `fast` math sets the
bits at the entry of every member of a kernel and restores the register at its exit; `exact` math keeps IEEE 754. Kernels
with a `prange` of their own, whose speed does not matter (`stages`), are left as they are.

x86: FTZ (results) and DAZ (operands) of MXCSR; Intel 64 and IA-32 manual, volume 1, section 10.2.3.
ARM: FZ of FPCR, which holds both; Arm Architecture Reference Manual, FPCR.
"""

from __future__ import annotations

import platform

import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from softlab.model.base.types import Compile

_INT32, _INT64 = ir.IntType(32), ir.IntType(64)
_BITS = {"x86_64": 0x8040, "amd64": 0x8040, "aarch64": 1 << 24, "arm64": 1 << 24}
MACHINE = platform.machine().lower()
FLUSH = _BITS.get(MACHINE, 0)  # bits of the register; 0: this architecture is not supported and nothing is flushed


def _mxcsr(builder: ir.IRBuilder, name: str, place: ir.Value) -> None:
    kind = ir.FunctionType(ir.VoidType(), [ir.IntType(8).as_pointer()])
    function = builder.module.declare_intrinsic(f"llvm.x86.sse.{name}", (), kind)
    builder.call(function, [builder.bitcast(place, ir.IntType(8).as_pointer())])


def read_register(builder: ir.IRBuilder) -> ir.Value:
    """Build code that reads the thread's control register, int64."""
    if MACHINE in ("aarch64", "arm64"):
        return builder.asm(ir.FunctionType(_INT64, []), "mrs $0, fpcr", "=r", [], True)
    place = cgutils.alloca_once(builder, _INT32)
    _mxcsr(builder, "stmxcsr", place)
    return builder.zext(builder.load(place), _INT64)


def write_register(builder: ir.IRBuilder, value: ir.Value) -> None:
    """Build code that sets the thread's control register to the int64 `value`."""
    if MACHINE in ("aarch64", "arm64"):
        builder.asm(ir.FunctionType(ir.VoidType(), [_INT64]), "msr fpcr, $0", "r,~{memory}", [value], True)
        return
    place = cgutils.alloca_once(builder, _INT32)
    builder.store(builder.trunc(value, _INT32), place)
    _mxcsr(builder, "ldmxcsr", place)


def flush_subnormals(builder: ir.IRBuilder) -> ir.Value:
    """Build code that flushes subnormals from here on; return the register's value before, for `write_register`."""
    before = read_register(builder)
    write_register(builder, builder.or_(before, ir.Constant(_INT64, FLUSH)))
    return before


_built_in: Compile = intrinsic  # typed by numba when they are compiled


@_built_in
def control_register(typing_context):
    """Return the control register of the thread that calls it; 0 on an architecture without support."""

    def build(context, builder, signature, arguments):
        return read_register(builder) if FLUSH else ir.Constant(_INT64, 0)

    return types.int64(), build


@numba.njit
def flushes():
    """Return True if the calling thread flushes subnormals now."""
    return FLUSH != 0 and (control_register() & FLUSH) == FLUSH


def description() -> str:
    """Return a description of how `fast` math treats subnormals on this machine."""
    if FLUSH:
        return "fast math flushes subnormals"
    return f"fast math does not flush subnormals on {MACHINE}, so float32 scenes at rest run slower"
