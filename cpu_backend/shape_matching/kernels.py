"""Clusters of particles on CPU threads: whole blocks of LANES particles, and of LANES clusters, one vector operation
each.

Positions and velocities are three planes each, one per axis. A body's particles begin at a multiple of LANES, and its
last block is padded with *ghosts*, which have no weight and belong to no cluster; so are the entries of a cluster. A
body of one cluster, whose particles are in order (`lone`), is summed up and moved without indices; others gather. The
result does not depend on the thread of a part, nor on the number of parts.
"""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.shape_matching.motions import (
    FRAME,
    displacement_to_goals,
    frame_of,
    matrix_of_rotation,
    near_rotation,
    store_matrix,
)
from softlab.cpu_backend.shape_matching.shapes import AXES, ENTRIES, finish, prepare
from softlab.model.base.variant import FEATURE, filled, inlined_routine, open_constant, routine, row_routine
from softlab.model.formulas.rotation import rotation_3d_far
from softlab.model.formulas.shape_matching.cluster import (
    LANES,
    MOMENTS,
    added,
    arrived,
    centre,
    corrected,
    displacement_added,
    goal,
    total,
    weighted,
)
from softlab.model.formulas.shape_matching.rigid import settled

QUATERNION = 4
# rows of a band's scratch, LANES numbers each: the lanes of a cluster's moments, the moments of LANES clusters, their
# rest offsets, their old rotations, the new ones and whether those converged, their linear maps
AT_SUMS, AT_REST_OFFSET = MOMENTS, 2 * MOMENTS
AT_OLD = AT_REST_OFFSET + AXES
AT_NEW = AT_OLD + QUATERNION
AT_MAPS = AT_NEW + QUATERNION + 1
SCRATCH = AT_MAPS + ENTRIES

GATHERS = open_constant("GATHERS: the particles of a cluster are not in order")


@routine
def lane_sum(lanes, n):
    """Return the sum of row `n`, of LANES numbers."""
    k = n * LANES
    return total((
        lanes[k], lanes[k + 1], lanes[k + 2], lanes[k + 3], lanes[k + 4], lanes[k + 5], lanes[k + 6], lanes[k + 7],
        lanes[k + 8], lanes[k + 9], lanes[k + 10], lanes[k + 11], lanes[k + 12], lanes[k + 13], lanes[k + 14],
        lanes[k + 15],
    ))  # fmt: skip


@row_routine
def moment_rows(blocks, first_x, first_y, first_z, slots, x, y, z, rest_x, rest_y, rest_z, mass, lanes):
    for row in range(MOMENTS * LANES):
        lanes[row] = 0.0
    for block in range(blocks):
        for lane in range(LANES):
            e = block * LANES + lane
            k = slots[e] if GATHERS else e
            wx, wy = weighted(mass[e], x[k], first_x), weighted(mass[e], y[k], first_y)
            wz = weighted(mass[e], z[k], first_z)
            lanes[lane] = lanes[lane] + wx
            lanes[LANES + lane] = lanes[LANES + lane] + wy
            lanes[2 * LANES + lane] = lanes[2 * LANES + lane] + wz
            lanes[3 * LANES + lane] = added(lanes[3 * LANES + lane], wx, rest_x[e])
            lanes[4 * LANES + lane] = added(lanes[4 * LANES + lane], wx, rest_y[e])
            lanes[5 * LANES + lane] = added(lanes[5 * LANES + lane], wx, rest_z[e])
            lanes[6 * LANES + lane] = added(lanes[6 * LANES + lane], wy, rest_x[e])
            lanes[7 * LANES + lane] = added(lanes[7 * LANES + lane], wy, rest_y[e])
            lanes[8 * LANES + lane] = added(lanes[8 * LANES + lane], wy, rest_z[e])
            lanes[9 * LANES + lane] = added(lanes[9 * LANES + lane], wz, rest_x[e])
            lanes[10 * LANES + lane] = added(lanes[10 * LANES + lane], wz, rest_y[e])
            lanes[11 * LANES + lane] = added(lanes[11 * LANES + lane], wz, rest_z[e])


sum_moments = filled(moment_rows, {"GATHERS": False})
gather_moments = filled(moment_rows, {"GATHERS": True})


@row_routine
def add_lanes(lanes, sums):
    for n in range(MOMENTS):
        k = n * LANES
        sums[k] = total((
            lanes[k], lanes[k + 1], lanes[k + 2], lanes[k + 3], lanes[k + 4], lanes[k + 5], lanes[k + 6],
            lanes[k + 7], lanes[k + 8], lanes[k + 9], lanes[k + 10], lanes[k + 11], lanes[k + 12], lanes[k + 13],
            lanes[k + 14], lanes[k + 15],
        ))  # fmt: skip


@routine
def sum_up(c, place, position, count, arrays, scratch):
    """Write the moments of cluster `c` into column `place` of the scratch."""
    starts, firsts, straight, slots, members = (
        arrays.starts, arrays.firsts, arrays.straight, arrays.slots, arrays.members
    )  # fmt: skip
    start, blocks, entries = starts[c], (starts[c + 1] - starts[c]) // LANES, members.size // 4
    first = np.int64(firsts[c])
    x, y, z = position[first], position[count + first], position[2 * count + first]
    rest_x, rest_y = row_at(members, start), row_at(members, entries + start)
    rest_z, mass = row_at(members, 2 * entries + start), row_at(members, 3 * entries + start)
    if straight[c]:
        sum_moments(
            blocks, x, y, z, row_at(slots, start), row_at(position, first), row_at(position, count + first),
            row_at(position, 2 * count + first), rest_x, rest_y, rest_z, mass, scratch,
        )  # fmt: skip
    else:
        gather_moments(
            blocks, x, y, z, row_at(slots, start), position, row_at(position, count), row_at(position, 2 * count), rest_x,
            rest_y, rest_z, mass, scratch,
        )  # fmt: skip
    add_lanes(scratch, row_at(scratch, np.int64(AT_SUMS * LANES + place)))


@row_routine
def raise_rows(rest_offset, sums):
    for axis in range(AXES):
        for other in range(AXES):
            k = (AXES + AXES * axis + other) * LANES
            for lane in range(LANES):
                sums[k + lane] = corrected(sums[k + lane], sums[axis * LANES + lane], rest_offset[other * LANES + lane])


@inlined_routine
def matrix_at(sums, lane):
    return (
        sums[3 * LANES + lane], sums[4 * LANES + lane], sums[5 * LANES + lane], sums[6 * LANES + lane],
        sums[7 * LANES + lane], sums[8 * LANES + lane], sums[9 * LANES + lane], sums[10 * LANES + lane],
        sums[11 * LANES + lane],
    )  # fmt: skip


@row_routine
def near_rows(sums, old, new):
    for lane in range(LANES):
        q = old[lane], old[LANES + lane], old[2 * LANES + lane], old[3 * LANES + lane]
        w, x, y, z, reached = near_rotation(matrix_at(sums, lane), q)
        new[lane] = w
        new[LANES + lane] = x
        new[2 * LANES + lane] = y
        new[3 * LANES + lane] = z
        new[4 * LANES + lane] = 1.0 if reached else 0.0


@routine
def turn_clusters(first, last, position, count, arrays, rotation, new_rotation, frames, scratch):
    """Compute the rotations of at most LANES clusters from their moments in the scratch: from `rotation` into
    `new_rotation` and, with their centres, into `frames`."""
    firsts, centres = arrays.firsts, arrays.centres
    clusters = centres.size // 4
    rest_offset = row_at(scratch, np.int64(AT_REST_OFFSET * LANES))
    sums, old = row_at(scratch, np.int64(AT_SUMS * LANES)), row_at(scratch, np.int64(AT_OLD * LANES))
    new = row_at(scratch, np.int64(AT_NEW * LANES))
    for n in range(last - first):
        for part in range(QUATERNION):
            old[part * LANES + n] = rotation[part * clusters + first + n]
        for axis in range(AXES):
            rest_offset[axis * LANES + n] = centres[4 * (first + n) + axis]
    raise_rows(rest_offset, sums)
    maps = row_at(scratch, np.int64(AT_MAPS * LANES))
    for n in range(last - first):
        prepare(first + n, n, arrays, sums, maps)
    near_rows(sums, old, new)
    for n in range(last - first):
        c, k = first + n, np.int64(firsts[first + n])
        w, x, y, z = new[n], new[LANES + n], new[2 * LANES + n], new[3 * LANES + n]
        if new[4 * LANES + n] == 0.0:
            w, x, y, z = rotation_3d_far(matrix_at(sums, n), (w, x, y, z))
        new_rotation[c] = w
        new_rotation[clusters + c] = x
        new_rotation[2 * clusters + c] = y
        new_rotation[3 * clusters + c] = z
        frame = row_at(frames, np.int64(FRAME * c))
        store_matrix(frame, *finish(c, n, arrays, maps, matrix_of_rotation(w, x, y, z)))
        for axis in range(AXES):
            frame[9 + axis] = centre(
                position[axis * count + k], sums[axis * LANES + n], centres[4 * c + 3], frame[3 * axis],
                frame[3 * axis + 1], frame[3 * axis + 2], centres[4 * c], centres[4 * c + 1], centres[4 * c + 2],
            )  # fmt: skip


@routine
def match_clusters(first, last, position, count, arrays, rotation, new_rotation, frames, scratch):
    """Compute the rotations and frames of at most LANES clusters."""
    for c in range(first, last):
        sum_up(c, c - first, position, count, arrays, scratch)
    turn_clusters(first, last, position, count, arrays, rotation, new_rotation, frames, scratch)


@row_routine
def move_rows(blocks, frame, factor, least, rest_x, rest_y, rest_z, x, y, z):
    for block in range(blocks):
        for lane in range(LANES):
            k = block * LANES + lane
            a, b, c = rest_x[k], rest_y[k], rest_z[k]
            u = displacement_added(0.0, factor, goal(frame.x, frame.xx, frame.xy, frame.xz, a, b, c), x[k])
            v = displacement_added(0.0, factor, goal(frame.y, frame.yx, frame.yy, frame.yz, a, b, c), y[k])
            w = displacement_added(0.0, factor, goal(frame.z, frame.zx, frame.zy, frame.zz, a, b, c), z[k])
            if FEATURE.rigid_motion:
                u, v, w = settled(u, least, x[k]), settled(v, least, y[k]), settled(w, least, z[k])
            x[k], y[k], z[k] = arrived(x[k], u), arrived(y[k], v), arrived(z[k], w)


@routine
def move_lone(c, position, count, arrays, factors, frames, travel):
    """Move the particles of a lone cluster towards their goals. `travel`: as in particles.py; its slacks are read if bodies
    are rigid."""
    starts, firsts, members = arrays.starts, arrays.firsts, arrays.members
    start, entries, first = starts[c], members.size // 4, np.int64(firsts[c])
    slack = travel[AXES * count + first] if FEATURE.rigid_motion else 0.0
    move_rows(
        (starts[c + 1] - start) // LANES, frame_of(frames, c), factors[start], slack,
        row_at(members, start), row_at(members, entries + start), row_at(members, 2 * entries + start),
        row_at(position, first), row_at(position, count + first), row_at(position, 2 * count + first),
    )  # fmt: skip


@routine
def move_particles(first, last, position, count, particle_clusters, frames, travel):
    """Move the particles of any clusters, gathering their goals."""
    starts, clusters, rests, factors = particle_clusters
    for k in range(first, last):
        p = position[k], position[count + k], position[2 * count + k]
        x, y, z = displacement_to_goals(p, starts[k], starts[k + 1], clusters, (rests, factors), frames)
        if FEATURE.rigid_motion:
            slack = travel[AXES * count + k]
            x, y, z = settled(x, slack, p[0]), settled(y, slack, p[1]), settled(z, slack, p[2])
        position[k] = arrived(p[0], x)
        position[count + k] = arrived(p[1], y)
        position[2 * count + k] = arrived(p[2], z)
