"""How threads of one parallel region tell each other how far they are: flags in memory, and waiting for them.

A flag is an int64 with a pair of cache lines to itself, in an array (flags, FLAG_SPACING). It is stored with release and
loaded with acquire order: who sees the flag sees what its thread had written before.
"""

from __future__ import annotations

import ctypes
import platform
import sys
from typing import Any

import llvmlite.binding
import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from cpu_backend.plain import in_python

FLAG_SPACING = 16  # int64: two lines, since processors fetch lines in pairs
GATE_FLAGS = 2  # who has arrived, and what was decided
UNDECIDED, GO, GIVE_UP = 0, 1, 2
PATIENCE = 1_000_000  # looks for the others, each with the processor offered to them first: half a second at least

_YIELD = "softlab_yield_processor"
_X86 = platform.machine().lower() in ("x86_64", "amd64", "i686", "x86")


def _register_yield() -> None:
    """Give compiled code the system's call by a name of ours, which then is the same in cached machine code."""
    if sys.platform == "win32":
        function = ctypes.windll.kernel32.SwitchToThread
    else:
        function = ctypes.CDLL(None).sched_yield
    llvmlite.binding.add_symbol(_YIELD, ctypes.cast(function, ctypes.c_void_p).value)


_register_yield()


_built_in: Any = intrinsic  # typed by numba when they are compiled


def _pointer(context: Any, builder: Any, array_type: Any, array: Any, flag: Any) -> Any:
    view = context.make_array(array_type)(context, builder, array)
    place = builder.mul(flag, ir.Constant(flag.type, FLAG_SPACING))
    return builder.gep(view.data, [place], inbounds=True)


@_built_in
def load_acquire(typing_context, flags, flag):
    """The flag's value."""

    def build(context, builder, signature, arguments):
        pointer = _pointer(context, builder, signature.args[0], *arguments)
        return builder.load_atomic(pointer, ordering="acquire", align=8)

    return types.int64(flags, types.int64), build


@_built_in
def store_release(typing_context, flags, flag, value):
    """Set the flag."""

    def build(context, builder, signature, arguments):
        pointer = _pointer(context, builder, signature.args[0], *arguments[:2])
        builder.store_atomic(arguments[2], pointer, ordering="release", align=8)
        return context.get_dummy_value()

    return types.void(flags, types.int64, types.int64), build


@_built_in
def add_one(typing_context, flags, flag):
    """Count the flag up by one, at once for all threads; returns what it was before."""

    def build(context, builder, signature, arguments):
        pointer = _pointer(context, builder, signature.args[0], *arguments)
        return builder.atomic_rmw("add", pointer, ir.Constant(ir.IntType(64), 1), "seq_cst")

    return types.int64(flags, types.int64), build


@_built_in
def decide(typing_context, flags, flag, value):
    """Set the flag if it is still 0."""

    def build(context, builder, signature, arguments):
        pointer = _pointer(context, builder, signature.args[0], *arguments[:2])
        zero = ir.Constant(ir.IntType(64), 0)
        builder.cmpxchg(pointer, zero, arguments[2], ordering="seq_cst", failordering="seq_cst")
        return context.get_dummy_value()

    return types.void(flags, types.int64, types.int64), build


@_built_in
def pause(typing_context):
    """Tell the core that this is a waiting loop, where it has an instruction for that."""

    def build(context, builder, signature, arguments):
        if _X86:
            function = builder.module.declare_intrinsic("llvm.x86.sse2.pause", (), ir.FunctionType(ir.VoidType(), []))
            builder.call(function, [])
        return context.get_dummy_value()

    return types.void(), build


@_built_in
def yield_processor(typing_context):
    """Offer the processor to another thread that is ready to run."""

    def build(context, builder, signature, arguments):
        kind = ir.FunctionType(ir.IntType(32), [])
        function = builder.module.globals.get(_YIELD) or ir.Function(builder.module, kind, name=_YIELD)
        builder.call(function, [])
        return context.get_dummy_value()

    return types.void(), build


def new_flags(count: int) -> np.ndarray:
    """`count` flags, all 0."""
    return np.zeros((count + 1, FLAG_SPACING), np.int64)


@numba.njit(nogil=True)
def wait_for(flags, flag, value, spins):
    """Return when the flag is at least `value`: look `spins` times, then offer the processor before each look."""
    looks = 0
    while load_acquire(flags, flag) < value:
        if looks < spins:
            looks += 1
            pause()
        else:
            yield_processor()


@numba.njit(nogil=True)
def all_arrived(gate, count, spins):
    """Whether `count` callers are here at the same time, each on a thread of its own; all get the same answer.

    False when some did not come within PATIENCE (a threading layer with fewer threads than asked for runs one caller
    after the other): then nobody may wait for anybody. `gate`: GATE_FLAGS flags, 0 before the first caller; `spins`: see
    wait_for.
    """
    if add_one(gate, 0) + 1 == count:
        decide(gate, 1, GO)
    looks = 0
    while load_acquire(gate, 1) == UNDECIDED:
        looks += 1
        if looks <= spins:
            pause()
        else:
            yield_processor()
        if looks > PATIENCE:
            decide(gate, 1, GIVE_UP)
    return load_acquire(gate, 1) == GO


@in_python(load_acquire)
def _load(flags: np.ndarray, flag: int) -> int:
    return flags[flag, 0]


@in_python(store_release)
def _store(flags: np.ndarray, flag: int, value: int) -> None:
    flags[flag, 0] = value


@in_python(wait_for)
def _do_not_wait(flags: np.ndarray, flag: int, value: int, spins: int) -> None:
    if flags[flag, 0] < value:
        raise RuntimeError("in plain Python one thread runs all bands: nobody may wait for another")


@in_python(all_arrived)
def _alone(gate: np.ndarray, count: int, spins: int) -> bool:
    gate[1, 0] = GO if count == 1 else GIVE_UP
    return count == 1
