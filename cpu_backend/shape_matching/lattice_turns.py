"""Rotations of lattices' clusters on CPU threads, one row of windows at a time.

`t`: the lattice's turn at the start, by rows; moments and matrices are by columns.
"""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.shape_matching.lattice_layout import QUATERNION
from softlab.cpu_backend.shape_matching.lattice_rows import copy
from softlab.cpu_backend.shape_matching.motions import FRAME, matrix_of_rotation, near_rotation, store_matrix
from softlab.model.base.variant import inlined_routine, routine, row_routine
from softlab.model.formulas.rotation import rotation_3d_far
from softlab.model.formulas.shape_matching.lattice import centre, entry


@inlined_routine
def times(a, b, c, d, e, f, g, h, i, columns):
    """Return the product with the matrix of these columns, of the matrix a b c / d e f / g h i; by rows."""
    o, p, q, r, s, t, u, v, w = columns
    return (
        entry(a, b, c, o, p, q), entry(a, b, c, r, s, t), entry(a, b, c, u, v, w),
        entry(d, e, f, o, p, q), entry(d, e, f, r, s, t), entry(d, e, f, u, v, w),
        entry(g, h, i, o, p, q), entry(g, h, i, r, s, t), entry(g, h, i, u, v, w),
    )  # fmt: skip


@row_routine
def near_row(n, t, xx, yx, zx, xy, yy, zy, xz, yz, zz, w, x, y, z, to_w, to_x, to_y, to_z, reached):
    """Write the rotations of a row of windows from their moments, and whether the iteration converged (`reached`)."""
    start = t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7], t[8]
    for k in range(n):
        moments = times(xx[k], xy[k], xz[k], yx[k], yy[k], yz[k], zx[k], zy[k], zz[k], start)
        to_w[k], to_x[k], to_y[k], to_z[k], there = near_rotation(moments, (w[k], x[k], y[k], z[k]))
        reached[k] = 1.0 if there else 0.0


@routine
def far_of(a, n, t, w, x, y, z):
    """Return the rotation of a window whose moments are `n` apart in memory."""
    start = t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7], t[8]
    moments = times(a[0], a[3 * n], a[6 * n], a[n], a[4 * n], a[7 * n], a[2 * n], a[5 * n], a[8 * n], start)
    return rotation_3d_far(moments, (w, x, y, z))


@row_routine
def matrix_row(n, t, w, x, y, z, xx, yx, zx, xy, yy, zy, xz, yz, zz):
    """Write a row of rotations as the matrices that rotate rest offsets, column by column."""
    back = t[0], t[3], t[6], t[1], t[4], t[7], t[2], t[5], t[8]
    for k in range(n):
        xx[k], xy[k], xz[k], yx[k], yy[k], yz[k], zx[k], zy[k], zz[k] = times(
            *matrix_of_rotation(w[k], x[k], y[k], z[k]), back
        )


@routine
def turn_row(n, t, window, rotation, new_rotation, clusters, reached):
    """Compute the rotations of a row of windows from their sums, which are replaced by the columns that rotate rest
    offsets."""
    a, old, new = row_at(window, 3 * n), row_at(reached, n), new_rotation
    copy(n, QUATERNION, rotation, clusters, old, n)  # `rotation` and `new_rotation` may be the same array
    near_row(
        n, t, a, row_at(a, n), row_at(a, 2 * n), row_at(a, 3 * n), row_at(a, 4 * n), row_at(a, 5 * n), row_at(a, 6 * n),
        row_at(a, 7 * n), row_at(a, 8 * n), old, row_at(old, n), row_at(old, 2 * n),
        row_at(old, 3 * n), new, row_at(new, clusters), row_at(new, 2 * clusters), row_at(new, 3 * clusters),
        reached,
    )  # fmt: skip
    for k in range(n):
        if reached[k] == 0.0:
            new[k], new[clusters + k], new[2 * clusters + k], new[3 * clusters + k] = far_of(
                row_at(a, k), n, t, new[k], new[clusters + k], new[2 * clusters + k], new[3 * clusters + k]
            )
    matrix_row(
        n, t, new, row_at(new, clusters), row_at(new, 2 * clusters), row_at(new, 3 * clusters), a, row_at(a, n),
        row_at(a, 2 * n), row_at(a, 3 * n), row_at(a, 4 * n), row_at(a, 5 * n), row_at(a, 6 * n), row_at(a, 7 * n),
        row_at(a, 8 * n),
    )  # fmt: skip


@row_routine
def centre_row(n, of_slice, inverse, total):
    """Replace the sums of a row of windows by their centres."""
    for k in range(n):
        total[k] = centre(total[k], of_slice[k], inverse)


@routine
def show_row(n, clusters, plane, position, window, new_rotation, frames):
    """Write the frames of a row of windows."""
    for k in range(n):
        frame = row_at(frames, np.int64(FRAME) * k)
        w, x, y, z = (
            new_rotation[k],
            new_rotation[clusters + k],
            new_rotation[2 * clusters + k],
            new_rotation[3 * clusters + k],
        )
        store_matrix(frame, *matrix_of_rotation(w, x, y, z))
        for axis in range(3):
            frame[9 + axis] = position[axis * plane + k] + window[axis * n + k]
