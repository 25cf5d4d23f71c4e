"""Bit masks: which of WORD numbers are below a limit, and the positions of the set bits."""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from softlab.cpu_backend.core.plain import in_python

WORD = 64  # distances compared at once, one bit each

_built_in: Any = intrinsic  # typed by numba when it is compiled


@_built_in
def bits_below(typing_context, array, offset, limit):
    """Return a uint64 whose bit k is set if array[offset + k] < limit, for WORD numbers of a flat array."""
    if not (isinstance(array, types.Array) and array.ndim == 1 and array.layout == "C" and array.dtype == limit):
        return None

    def build(context, builder, signature, arguments):
        whole = context.make_array(array)(context, builder, arguments[0])
        element = context.get_data_type(array.dtype)
        vector = ir.VectorType(element, WORD)
        here = builder.bitcast(builder.gep(whole.data, [arguments[1]]), vector.as_pointer())
        numbers = builder.load(here, align=array.dtype.bitwidth // 8)
        limits = builder.insert_element(ir.Constant(vector, ir.Undefined), arguments[2], ir.Constant(ir.IntType(32), 0))
        limits = builder.shuffle_vector(limits, limits, ir.Constant(ir.VectorType(ir.IntType(32), WORD), [0] * WORD))
        return builder.bitcast(builder.fcmp_ordered("<", numbers, limits), ir.IntType(WORD))

    return types.uint64(array, types.int64, array.dtype), build


@in_python(bits_below)
def _bits_below(array: np.ndarray, offset: int, limit: Any) -> int:
    return sum(1 << k for k in range(WORD) if array[offset + k] < limit)


@_built_in
def lowest_bit(typing_context, word):
    """Return the position of the lowest set bit of a uint64; WORD for 0."""

    def build(context, builder, signature, arguments):
        return builder.cttz(arguments[0], context.get_constant(types.boolean, False))

    return types.int64(types.uint64), build


@in_python(lowest_bit)
def _lowest_bit(word: Any) -> int:
    return (int(word) & -int(word)).bit_length() - 1 if word else WORD


@_built_in
def bits_of(typing_context, word):
    """Return the number of set bits of a uint64."""

    def build(context, builder, signature, arguments):
        return builder.ctpop(arguments[0])

    return types.int64(types.uint64), build


@in_python(bits_of)
def _bits_of(word: Any) -> int:
    return int(word).bit_count()


@_built_in
def without(typing_context, word, bit):
    """Return a uint64 with bit number `bit` cleared; unchanged if `bit` is outside 0 to WORD - 1."""

    def build(context, builder, signature, arguments):
        one, last = ir.Constant(ir.IntType(WORD), 1), ir.Constant(ir.IntType(WORD), WORD - 1)
        there = builder.icmp_unsigned("<=", arguments[1], last)
        mask = builder.not_(builder.shl(one, builder.and_(arguments[1], last)))
        return builder.select(there, builder.and_(arguments[0], mask), arguments[0])

    return types.uint64(types.uint64, types.int64), build


@in_python(without)
def _without(word: Any, bit: Any) -> int:
    return int(word) & ~(1 << int(bit)) if 0 <= bit < WORD else int(word)


@_built_in
def without_lowest(typing_context, word):
    """Return a uint64 with its lowest set bit cleared."""

    def build(context, builder, signature, arguments):
        return builder.and_(arguments[0], builder.sub(arguments[0], ir.Constant(ir.IntType(WORD), 1)))

    return types.uint64(types.uint64), build


@in_python(without_lowest)
def _without_lowest(word: Any) -> int:
    return int(word) & (int(word) - 1)
