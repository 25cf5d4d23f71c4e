"""Rigid motions and frames of clusters in their flat arrays, on CPU threads."""

from __future__ import annotations

import numpy as np

from softlab.model.base.variant import filled, inlined_routine, inlined_throughout, routine
from softlab.model.formulas.rotation import matrix_of, rotation_3d_near
from softlab.model.formulas.shape_matching.couple import SPIN
from softlab.model.formulas.shape_matching.pace import MOTION
from softlab.model.shape_matching import motions as shared
from softlab.model.shape_matching.motions import Frame, Motion

FRAME = 12  # numbers of a cluster's frame
near_rotation, matrix_of_rotation = inlined_throughout(rotation_3d_near), inlined_throughout(matrix_of)


@routine
def motion_of(motions, c):
    """Return the Motion of cluster `c`."""
    n = np.int64(MOTION) * c
    return Motion(
        motions[n], motions[n + 1], motions[n + 2], motions[n + 3], motions[n + 4], motions[n + 5], motions[n + 6],
        motions[n + 7], motions[n + 8],
    )  # fmt: skip


@routine
def frame_of(frames, c):
    """Return the Frame of cluster `c`."""
    n = np.int64(FRAME) * c
    return Frame(
        frames[n], frames[n + 1], frames[n + 2], frames[n + 3], frames[n + 4], frames[n + 5], frames[n + 6],
        frames[n + 7], frames[n + 8], frames[n + 9], frames[n + 10], frames[n + 11],
    )  # fmt: skip


@inlined_routine
def member_of(members, n):
    rests, factors = members
    return rests[3 * n], rests[3 * n + 1], rests[3 * n + 2], factors[n]


@inlined_routine
def spin_of(spins, c):
    n = np.int64(SPIN) * c
    return spins[n], spins[n + 1], spins[n + 2], spins[n + 3], spins[n + 4], spins[n + 5]


displacement_to_goals = filled(shared.displacement_to_goals, {"frame_of": frame_of, "member_of": member_of})
slowed_velocity = filled(shared.slowed_velocity, {"motion_of": motion_of})
rotated = filled(shared.rotated, {"spin_of": spin_of})


@routine
def store_row(frame, axis, x, y, z):
    frame[3 * axis], frame[3 * axis + 1], frame[3 * axis + 2] = x, y, z


@routine
def store_matrix(frame, xx, xy, xz, yx, yy, yz, zx, zy, zz):
    """Write the matrix of the frame that begins there."""
    store_row(frame, 0, xx, xy, xz)
    store_row(frame, 1, yx, yy, yz)
    store_row(frame, 2, zx, zy, zz)
