"""Rigid motions and frames of clusters in their flat arrays, on CPU threads."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softlab.model.base.variant import inlined_routine, inlined_throughout, routine
from softlab.model.formulas.rotation import matrix_of, rotation_3d_near
from softlab.model.formulas.shape_matching.pace import MOTION
from softlab.model.formulas.shape_matching.rebound import rigid

FRAME = 12  # numbers of a cluster's frame
near_rotation, matrix_of_rotation = inlined_throughout(rotation_3d_near), inlined_throughout(matrix_of)


class Motion(NamedTuple):
    """A cluster's rigid motion: its centre, the velocity there, its spin."""

    x: float
    y: float
    z: float
    u: float
    v: float
    w: float
    spin_x: float
    spin_y: float
    spin_z: float


class Frame(NamedTuple):
    """A cluster's matrix, by rows, and its centre."""

    xx: float
    xy: float
    xz: float
    yx: float
    yy: float
    yz: float
    zx: float
    zy: float
    zz: float
    x: float
    y: float
    z: float


@routine
def motion_of(motions, c):
    """Return the Motion of cluster `c`."""
    n = np.int64(MOTION) * c
    return Motion(
        motions[n], motions[n + 1], motions[n + 2], motions[n + 3], motions[n + 4], motions[n + 5], motions[n + 6],
        motions[n + 7], motions[n + 8],
    )  # fmt: skip


@inlined_routine
def velocity_at(motion, x, y, z):
    """Return the velocity of a particle at (x, y, z) that moves with its cluster."""
    m, dx, dy, dz = motion, x - motion.x, y - motion.y, z - motion.z
    return (
        rigid(m.u, m.spin_y, dz, m.spin_z, dy), rigid(m.v, m.spin_z, dx, m.spin_x, dz),
        rigid(m.w, m.spin_x, dy, m.spin_y, dx),
    )  # fmt: skip


@routine
def frame_of(frames, c):
    """Return the Frame of cluster `c`."""
    n = np.int64(FRAME) * c
    return Frame(
        frames[n], frames[n + 1], frames[n + 2], frames[n + 3], frames[n + 4], frames[n + 5], frames[n + 6],
        frames[n + 7], frames[n + 8], frames[n + 9], frames[n + 10], frames[n + 11],
    )  # fmt: skip


@routine
def store_row(frame, axis, x, y, z):
    frame[3 * axis], frame[3 * axis + 1], frame[3 * axis + 2] = x, y, z


@routine
def store_matrix(frame, xx, xy, xz, yx, yy, yz, zx, zy, zz):
    """Write the matrix of the frame that begins there."""
    store_row(frame, 0, xx, xy, xz)
    store_row(frame, 1, yx, yy, yz)
    store_row(frame, 2, zx, zy, zz)
