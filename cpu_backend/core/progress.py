"""Synchronisation of the threads of one parallel region: progress flags in memory, waiting for them, and teams.

A flag is an int64 with two cache lines to itself, in an array (flags, FLAG_SPACING). It is stored with release and
loaded with acquire order: a thread that sees the flag sees everything that its thread had written before.

A waiting thread spins for microseconds, then yields the processor, then sleeps, longer each time: the thread that it
waits for may be on the same core, or behind another program. A team does more: work that its member has not begun is
taken over by a thread that would wait for it, so that a descheduled thread does not stall the others.
"""

from __future__ import annotations

import ctypes
import platform
import sys
from collections.abc import Iterator
from typing import Any

import llvmlite.binding
import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core.base import BaseContext
from numba.extending import intrinsic

from softlab.cpu_backend.core.plain import in_python, still_time
from softlab.model.base.types import Compile

FLAG_SPACING = 16  # int64: two lines, since processors fetch lines in pairs
SPINS = 300  # checks with a pause between them: a few microseconds
YIELDS = 200  # checks with a yield between them: 0.1 ms if no other thread wants the processor
SHORTEST_SLEEP, LONGER = 20, 4  # us, and how often it doubles: 0.3 ms, a tenth of a time slice

_YIELD, _SLEEP = "softlab_yield_processor", "softlab_sleep"
_X86 = platform.machine().lower() in ("x86_64", "amd64", "i686", "x86")


def _register_calls() -> None:
    """Register the system's calls under our own names, which are then the same in cached machine code."""
    if sys.platform == "win32":
        offer, sleep = ctypes.windll.kernel32.SwitchToThread, ctypes.windll.kernel32.Sleep
    else:
        offer, sleep = ctypes.CDLL(None).sched_yield, ctypes.CDLL(None).usleep
    for name, function in ((_YIELD, offer), (_SLEEP, sleep)):
        llvmlite.binding.add_symbol(name, ctypes.cast(function, ctypes.c_void_p).value)


_register_calls()
_SLEEP_UNIT = 1000 if sys.platform == "win32" else 1  # us


_built_in: Compile = intrinsic  # typed by numba when they are compiled


def _pointer(
    context: BaseContext, builder: ir.IRBuilder, array_type: types.Array, array: ir.Value, flag: ir.Value
) -> ir.Value:
    view = context.make_array(array_type)(context, builder, array)
    place = builder.mul(flag, ir.Constant(flag.type, FLAG_SPACING))
    return builder.gep(view.data, [place], inbounds=True)


@_built_in
def load_acquire(typing_context, flags, flag):
    """Return the flag's value."""

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
def exchange(typing_context, flags, flag, seen, value):
    """Set the flag if its value still is `seen`. Returns True if it was."""

    def build(context, builder, signature, arguments):
        pointer = _pointer(context, builder, signature.args[0], *arguments[:2])
        pair = builder.cmpxchg(pointer, arguments[2], arguments[3], ordering="seq_cst", failordering="seq_cst")
        return builder.extract_value(pair, 1)

    return types.boolean(flags, types.int64, types.int64, types.int64), build


@_built_in
def pause(typing_context):
    """Mark a waiting loop for the core, if it has an instruction for that."""

    def build(context, builder, signature, arguments):
        if _X86:
            function = builder.module.declare_intrinsic("llvm.x86.sse2.pause", (), ir.FunctionType(ir.VoidType(), []))
            builder.call(function, [])
        return context.get_dummy_value()

    return types.void(), build


@_built_in
def yield_processor(typing_context):
    """Yield the processor to another thread that is ready to run."""

    def build(context, builder, signature, arguments):
        kind = ir.FunctionType(ir.IntType(32), [])
        function = builder.module.globals.get(_YIELD) or ir.Function(builder.module, kind, name=_YIELD)
        builder.call(function, [])
        return context.get_dummy_value()

    return types.void(), build


@_built_in
def _system_sleep(typing_context, units):
    def build(context, builder, signature, arguments):
        kind = ir.FunctionType(ir.IntType(32), [ir.IntType(32)])
        function = builder.module.globals.get(_SLEEP) or ir.Function(builder.module, kind, name=_SLEEP)
        builder.call(function, [builder.trunc(arguments[0], ir.IntType(32))])
        return context.get_dummy_value()

    return types.void(types.int64), build


def new_flags(count: int) -> np.ndarray:
    """Return `count` flags, all 0."""
    return np.zeros((count + 1, FLAG_SPACING), np.int64)


@numba.njit(nogil=True)
def bide(checks, spins):
    """Wait before the next check of a flag, after `checks` checks: `spins` pauses, then YIELDS yields, then sleep."""
    if checks < spins:
        pause()
    elif checks < spins + YIELDS:
        yield_processor()
    else:
        _system_sleep(max(np.int64(1), (SHORTEST_SLEEP << min(checks - spins - YIELDS, LONGER)) // _SLEEP_UNIT))


# ---------------------------------------------------------------------- teams

_inner: dict[str, Any] = {"nogil": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, "_nrt": False}


@numba.njit(nogil=True)
def new_team(members):
    """Return the flags of a team of `members`.

    They store the phase in which each part was last taken and done, and for each member its phase and how long it waits
    for a part to be taken.
    """
    team = np.zeros((3 * members + 1, FLAG_SPACING), np.int64)
    team[2 * members :, 1] = SPINS
    return team


@numba.njit(**_inner)
def take(team, part, phase):
    """Take the part in this phase. Returns True if it was free and now is the caller's."""
    seen = load_acquire(team, part)
    return seen < phase and exchange(team, part, seen, phase)


@numba.njit(**_inner)
def assigned(team, member, count):
    """Iterate over the parts 0 to `count` - 1 of a phase that a member has to do; ends when all parts are done, by any
    member.

    All members pass through the same phases in the same order, with as many parts. A member begins with the part of its
    own number. It takes over a part that others have not begun while it waited, and waits less the next time; a member
    that comes late finds its phases done. So parts must not depend on the member that does them. Code between two
    phases may run late, twice and at any time: it must not read anything that phases write, nor write anything.
    """
    members = np.int64(team.shape[0]) // 3
    slot = 2 * members + member
    phase, patience, checks, stepped_in = team[slot, 0] + 1, team[slot, 1], 0, False
    team[slot, 0] = phase
    for n in range(count):
        part = (member + n) % count
        if n == 0 and take(team, part, phase):
            yield part
            store_release(team, members + part, phase)
        while load_acquire(team, members + part) < phase:
            if checks >= patience and take(team, part, phase):
                stepped_in = True
                yield part
                store_release(team, members + part, phase)
            else:
                bide(checks, SPINS)
                checks += 1
    team[slot, 1] = patience // 2 if stepped_in else SPINS


@in_python(load_acquire)
def _load(flags: np.ndarray, flag: int) -> int:
    return flags[flag, 0]


@in_python(store_release)
def _store(flags: np.ndarray, flag: int, value: int) -> None:
    flags[flag, 0] = value


@in_python(exchange)
def _exchange(flags: np.ndarray, flag: int, expected: int, value: int) -> bool:
    if flags[flag, 0] != expected:
        return False
    flags[flag, 0] = value
    return True


@in_python(bide)
def _no_time(checks: int, spins: int) -> None:
    pass


@in_python(new_team)
def _team(members: int) -> np.ndarray:
    return new_team.py_func(members)  # not translated: element types of arrays are no conversions


@in_python(assigned)
def _all_parts(team: np.ndarray, member: int, count: int) -> Iterator[int]:
    """Run members in sequence: the first does every part, the others find them done."""
    slot = 2 * (len(team) // 3) + member
    phase = team[slot, 0] = team[slot, 0] + 1
    for part in range(count):
        if team[part, 0] < phase:
            still_time()
            team[part, 0] = phase
            yield part
            team[len(team) // 3 + part, 0] = phase
