"""The row of a collider, and the indices of its numbers, unsigned: for a signed index numba checks whether it is
negative, which takes more instructions than the distance from a plane."""

from __future__ import annotations

from typing import SupportsInt

import numpy as np

from softlab.gpu_backend.core.device import simulated
from softlab.model.base.variant import instruction
from softlab.model.contact import cloth_parameters as signed

FIRST_ROW, ROW = np.uint64(0), np.uint64(signed.COLLIDER_FIELDS)
B_X, B_Y, B_Z = np.uint64(signed.B_X), np.uint64(signed.B_Y), np.uint64(signed.B_Z)
B_U, B_V, B_W = np.uint64(signed.B_U), np.uint64(signed.B_V), np.uint64(signed.B_W)
B_VX, B_VY, B_VZ = np.uint64(signed.B_VX), np.uint64(signed.B_VY), np.uint64(signed.B_VZ)
B_RADIUS, B_THICKNESS = np.uint64(signed.B_RADIUS), np.uint64(signed.B_THICKNESS)
B_STATIC, B_DYNAMIC, B_RESTITUTION = (
    np.uint64(signed.B_STATIC),
    np.uint64(signed.B_DYNAMIC),
    np.uint64(signed.B_RESTITUTION),
)
B_SPIN, B_TURNS, B_TREE = np.uint64(signed.B_SPIN), np.uint64(signed.B_TURNS), np.uint64(signed.B_TREE)

if simulated():

    @instruction
    def row_at(array: np.ndarray, offset: SupportsInt) -> np.ndarray:
        """Return the part of a flat array from `offset` on."""
        return array[int(offset) :]

else:
    from numba.cuda.extending import intrinsic

    def _part(context, builder, signature, arguments):
        part = context.make_array(signature.return_type)(context, builder, arguments[0])
        part.data = builder.gep(part.data, [arguments[1]], inbounds=True)
        return part._getvalue()

    @intrinsic
    def row_at(typing_context, array, offset):
        """Return the part of a flat array from `offset` on, as an array of unchecked length."""
        return array(array, offset), _part
