"""Indices of the numbers of a collider in its row, unsigned: for a signed index numba checks whether it is negative,
which takes more instructions than the distance from a plane."""

from __future__ import annotations

import numpy as np

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
