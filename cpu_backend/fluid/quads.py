"""Positions of a fluid's particles as quads (x, y, z, change of the multiplier), behind their planes, for CPU threads.

LANES neighbours are then LANES loads of four numbers, which two rows of shuffles turn into planes. Reading the planes
takes three or four times as many loads of one number, by an instruction (`vgatherqps`) that is no faster than the
loads.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from softlab.cpu_backend.core.plain import in_python

LANES = 16  # particles of a slice
QUAD = 4
QUADS = 3  # number of planes before the quads
GROUP = LANES // QUAD

_built_in: Any = intrinsic  # typed by numba when it is compiled


def _joined(builder: ir.IRBuilder, parts: list[Any]) -> Any:
    """Concatenate several vectors."""
    while len(parts) > 1:
        size = parts[0].type.count
        places = ir.Constant(ir.VectorType(ir.IntType(32), 2 * size), list(range(2 * size)))
        parts = [builder.shuffle_vector(a, b, places) for a, b in zip(parts[::2], parts[1::2], strict=True)]
    return parts[0]


def _interleaved(builder: ir.IRBuilder, a: Any, b: Any, first: int, run: int) -> Any:
    """Take half of each QUAD of two vectors: a run of numbers of `a` from `first` on, a run of `b`, and so on."""
    places = []
    for quad in range(0, LANES, QUAD):
        for start in range(quad + first, quad + first + QUAD // 2, run):
            places += [*range(start, start + run), *range(LANES + start, LANES + start + run)]
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(ir.IntType(32), LANES), places))


def _planes(builder: ir.IRBuilder, quads: list[Any]) -> list[Any]:
    """Return x, y, z, w of LANES quads. Each QUAD of a vector is a quad: shuffles stay within 128 bits of float32."""
    rows = [_joined(builder, [quads[m + QUAD * n] for n in range(GROUP)]) for m in range(QUAD)]
    xy = [_interleaved(builder, rows[n], rows[n + 1], 0, 1) for n in (0, 2)]  # x, x, y, y of two quads
    zw = [_interleaved(builder, rows[n], rows[n + 1], 2, 1) for n in (0, 2)]
    return [_interleaved(builder, pair[0], pair[1], first, 2) for pair in (xy, zw) for first in (0, 2)]


@_built_in
def read_quads(typing_context, quads, entries, offset, x, y, z, w):
    """Read the quads of LANES particles, `entries` from `offset` on, into x, y, z, w (LANES,). All arrays are flat."""
    kinds = [each.dtype for each in (quads, x, y, z, w)]
    if entries.dtype != types.int32 or any(kind != kinds[0] for kind in kinds):
        return None

    def build(context, builder, signature, arguments):
        def data(place):
            return context.make_array(signature.args[place])(context, builder, arguments[place]).data

        scalar, wide = context.get_data_type(quads.dtype), ir.IntType(64)
        vector, size = ir.VectorType(scalar, QUAD), quads.dtype.bitwidth // 8
        first, loaded = builder.gep(data(1), [arguments[2]]), []
        base = builder.bitcast(data(0), vector.as_pointer())
        for lane in range(LANES):
            number = builder.zext(builder.load(builder.gep(first, [ir.Constant(wide, lane)])), wide)
            loaded.append(builder.load(builder.gep(base, [number]), align=QUAD * size))
        for place, plane in zip((3, 4, 5, 6), _planes(builder, loaded), strict=True):
            builder.store(plane, builder.bitcast(data(place), plane.type.as_pointer()), align=size)
        return context.get_dummy_value()

    return types.void(quads, entries, types.int64, x, y, z, w), build


@in_python(read_quads)
def _read_quads(quads: Any, entries: Any, offset: int, x: Any, y: Any, z: Any, w: Any) -> None:
    numbers = np.asarray(quads).reshape(-1, QUAD)[np.asarray(entries[offset : offset + LANES])]
    for plane, values in zip((x, y, z, w), numbers.T, strict=True):
        plane[:LANES] = values
