"""Masses against a mesh of triangles: its tree of boxes, the first triangle on a path, the nearest point, the response.

Everything happens in the mesh's own frame (model/formulas/frame.py). Triangles have two sides and no inside. A triangle
faces a point by the sign of n.(p - a), from one formula, and 0 counts as its front: a mass that ends a step on a side
begins the next one there. For a path across an edge, both triangles use the same product of the edge with opposite
signs (R. Segura and F. Feito, "Algorithms to test ray-triangle intersection", WSCG 2001). So in `exact` math no path
slips between two triangles; where products are fused, paths that miss by that rounding count as crossing, too.

The tree is one array of numbers: nodes of NODE numbers in depth-first order (the bounds of a box, how many nodes to
skip to where the box is not hit, and a triangle or -1), then triangles, 9 numbers each. A traversal needs no stack: it
goes to the next node, or skips (B. Smits, "Efficiency issues for ray tracing", Journal of Graphics Tools 3, 1998).
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from softlab.model.base.variant import FEATURE, OfPrecision, filled, formula
from softlab.model.formulas import frame
from softlab.model.formulas.cloth import between, pushed
from softlab.model.formulas.colliders import rebound, respond, slid
from softlab.model.formulas.lengths import cross, dot

NODE, CORNERS = 8, 9  # numbers per node and per triangle
SKIP, TRIANGLE = 6, 7  # of a node: the next one if it is skipped, for the root the number of nodes; its triangle or -1
ROUNDS = 4  # largest number of corrections before the final check: two folds, each tested twice
SETTLED = 1 - 2.0**-6  # of the thickness: a corrected mass that is no nearer than that stays
NEAR = (
    2.0**-10
)  # of the thickness: below it the direction to the nearest point is mostly rounding, and its triangle's normal is used
SLACK = 8  # eps: rounding error of the product of an edge that a path hits

WIDENED = OfPrecision(lambda real: SLACK * float(np.finfo(real).eps))


@formula
def largest(x, y, z):
    return max(max(abs(x), abs(y)), abs(z))


@formula
def crossing(p, q, a, b, c):
    """Fraction of the segment from p to q at which it crosses the triangle a, b, c; 2 where it does not.

    A line crosses the triangle where its products with all three edges have one sign.
    """
    px, py, pz = p
    qx, qy, qz = q
    ax, ay, az = a
    bx, by, bz = b
    cx, cy, cz = c
    dx, dy, dz = qx - px, qy - py, qz - pz
    nx, ny, nz = cross(bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az)
    before = dot(nx, ny, nz, px - ax, py - ay, pz - az)
    after = dot(nx, ny, nz, qx - ax, qy - ay, qz - az)
    if (before >= 0.0) == (after >= 0.0):
        return 2.0
    ax, ay, az = ax - px, ay - py, az - pz
    bx, by, bz = bx - px, by - py, bz - pz
    cx, cy, cz = cx - px, cy - py, cz - pz
    ux, uy, uz = cross(ax, ay, az, bx, by, bz)
    vx, vy, vz = cross(bx, by, bz, cx, cy, cz)
    wx, wy, wz = cross(cx, cy, cz, ax, ay, az)
    one_edge, other, third = dot(dx, dy, dz, ux, uy, uz), dot(dx, dy, dz, vx, vy, vz), dot(dx, dy, dz, wx, wy, wz)
    size = max(max(largest(ax, ay, az), largest(bx, by, bz)), largest(cx, cy, cz))
    miss = WIDENED * (largest(dx, dy, dz) * (size * size))
    low, high = min(min(one_edge, other), third), max(max(one_edge, other), third)
    if low < -miss and high > miss:
        return 2.0
    return before / (before - after)


@formula
def from_edge(x, y, z, ex, ey, ez):
    """Return (squared length, vector) from the nearest point of an edge e to a point at (x, y, z) from the edge's
    start."""
    squared, part = dot(ex, ey, ez, ex, ey, ez), 0.0
    if squared > 0.0:
        part = min(max(dot(x, y, z, ex, ey, ez) / squared, 0.0), 1.0)
    wx, wy, wz = x - part * ex, y - part * ey, z - part * ez
    return dot(wx, wy, wz, wx, wy, wz), wx, wy, wz


@formula
def from_triangle(q, a, b, c):
    """Return (squared length [m^2], vector [m]) from the nearest point of the triangle a, b, c to q.

    Where q lies above the triangle, along its normal; otherwise from the nearest edge.
    """
    qx, qy, qz = q
    ax, ay, az = a
    bx, by, bz = b
    cx, cy, cz = c
    abx, aby, abz = bx - ax, by - ay, bz - az
    bcx, bcy, bcz = cx - bx, cy - by, cz - bz
    cax, cay, caz = ax - cx, ay - cy, az - cz
    ax, ay, az = qx - ax, qy - ay, qz - az
    bx, by, bz = qx - bx, qy - by, qz - bz
    cx, cy, cz = qx - cx, qy - cy, qz - cz
    nx, ny, nz = cross(abx, aby, abz, bcx, bcy, bcz)
    squared = dot(nx, ny, nz, nx, ny, nz)
    ux, uy, uz = cross(abx, aby, abz, ax, ay, az)
    vx, vy, vz = cross(bcx, bcy, bcz, bx, by, bz)
    wx, wy, wz = cross(cax, cay, caz, cx, cy, cz)
    least = min(min(dot(nx, ny, nz, ux, uy, uz), dot(nx, ny, nz, vx, vy, vz)), dot(nx, ny, nz, wx, wy, wz))
    if least >= 0.0 and squared > 0.0:
        height = dot(nx, ny, nz, ax, ay, az) / squared
        nx, ny, nz = height * nx, height * ny, height * nz
        return dot(nx, ny, nz, nx, ny, nz), nx, ny, nz
    best, wx, wy, wz = from_edge(ax, ay, az, abx, aby, abz)
    other, ux, uy, uz = from_edge(bx, by, bz, bcx, bcy, bcz)
    if other < best:
        best, wx, wy, wz = other, ux, uy, uz
    other, ux, uy, uz = from_edge(cx, cy, cz, cax, cay, caz)
    if other < best:
        best, wx, wy, wz = other, ux, uy, uz
    return best, wx, wy, wz


@formula
def corners_at(numbers, t):
    """Corners of the triangle at index t."""
    return (
        (numbers[t], numbers[t + 1], numbers[t + 2]),
        (numbers[t + 3], numbers[t + 4], numbers[t + 5]),
        (numbers[t + 6], numbers[t + 7], numbers[t + 8]),
    )


@formula
def first_crossing(numbers, tree, px, py, pz, qx, qy, qz):
    """Return (fraction of the segment from p to q, index of the triangle that it crosses first or -1). `tree`: index of
    the root.

    It visits the nodes whose boxes overlap the segment's own box. Of two triangles crossed at once, the first in
    the tree counts.
    """
    low_x, low_y, low_z = min(px, qx), min(py, qy), min(pz, qz)
    high_x, high_y, high_z = max(px, qx), max(py, qy), max(pz, qz)
    count, node = np.int32(numbers[tree + SKIP]), np.int32(0)
    best, place = 2.0, np.int32(-1)
    while node < count:
        at = np.int32(tree + (node << 3))
        if (
            numbers[at] <= high_x
            and numbers[at + 3] >= low_x
            and numbers[at + 1] <= high_y
            and numbers[at + 4] >= low_y
            and numbers[at + 2] <= high_z
            and numbers[at + 5] >= low_z
        ):
            triangle = np.int32(numbers[at + TRIANGLE])
            if triangle >= 0:
                t = np.int32(tree + (count << 3) + (triangle << 3) + triangle)
                a, b, c = corners_at(numbers, t)
                part = crossing((px, py, pz), (qx, qy, qz), a, b, c)
                if part < best:
                    best, place = part, t
            node = np.int32(node + 1)
        else:
            node = np.int32(numbers[at + SKIP])
    return best, place


@formula
def outside(low, x, high):
    """Distance of x outside an interval."""
    return max(max(low - x, x - high), 0.0)


@formula
def nearest(numbers, tree, x, y, z, squared_radius):
    """Return (squared distance, vector from the nearest point, index of its triangle or -1 where none is within the
    squared radius)."""
    count, node = np.int32(numbers[tree + SKIP]), np.int32(0)
    best, place, wx, wy, wz = squared_radius, np.int32(-1), 0.0, 0.0, 0.0
    while node < count:
        at = np.int32(tree + (node << 3))
        dx = outside(numbers[at], x, numbers[at + 3])
        dy = outside(numbers[at + 1], y, numbers[at + 4])
        dz = outside(numbers[at + 2], z, numbers[at + 5])
        if dot(dx, dy, dz, dx, dy, dz) < best:
            triangle = np.int32(numbers[at + TRIANGLE])
            if triangle >= 0:
                t = np.int32(tree + (count << 3) + (triangle << 3) + triangle)
                a, b, c = corners_at(numbers, t)
                squared, ux, uy, uz = from_triangle((x, y, z), a, b, c)
                if squared < best:
                    best, place, wx, wy, wz = squared, t, ux, uy, uz
            node = np.int32(node + 1)
        else:
            node = np.int32(numbers[at + SKIP])
    return best, wx, wy, wz, place


@formula
def facing(numbers, t, x, y, z):
    """Unit normal of the triangle at index t, to the side on which a point lies."""
    ax, ay, az = numbers[t], numbers[t + 1], numbers[t + 2]
    nx, ny, nz = cross(
        numbers[t + 3] - ax, numbers[t + 4] - ay, numbers[t + 5] - az, numbers[t + 6] - ax, numbers[t + 7] - ay,
        numbers[t + 8] - az,
    )  # fmt: skip
    length = sqrt(dot(nx, ny, nz, nx, ny, nz))
    if dot(nx, ny, nz, x - ax, y - ay, z - az) < 0.0:
        length = -length
    return nx / length, ny / length, nz / length


@formula
def speed_of(pair):
    """Speed in `settling`."""
    return pair[0] if FEATURE.friction_in_place else pair


@formula
def settle(numbers, tree, surface, spin, velocity, a, p, v):
    """Return (True if the mesh was touched, p, v) of a mass on its path from a to p, in the mesh's frame.

    `spin`: the mesh's angular velocity [rad/s]; `velocity`: its own. A triangle on the path puts the mass at `thickness`
    on the side that it comes from, where it would have crossed; the nearest point of the mesh pushes it out to
    `thickness`. A moved mass is tested again, ROUNDS times. If even then a triangle lies between its old and its
    new position, it stays at the old one, so that no mass changes sides from step to step.
    """
    thickness, static, dynamic, restitution, settling = surface
    (sx, sy, sz), (ux, uy, uz) = spin, velocity
    (ax, ay, az), (x, y, z), (vx, vy, vz) = a, p, v
    touched, limit = False, thickness
    for attempt in range(ROUNDS + 1):
        part, place = first_crossing(numbers, tree, ax, ay, az, x, y, z)
        crossing = place
        nx, ny, nz = 0.0, 0.0, 0.0
        if place >= 0 and attempt == ROUNDS:
            cx, cy, cz = cross(sx, sy, sz, ax, ay, az)
            return True, (ax, ay, az), (ux + cx, uy + cy, uz + cz)
        if place >= 0:
            nx, ny, nz = facing(numbers, place, ax, ay, az)
            x = pushed(between(ax, x, part), thickness, nx)
            y = pushed(between(ay, y, part), thickness, ny)
            z = pushed(between(az, z, part), thickness, nz)
        else:
            squared, nx, ny, nz, place = nearest(numbers, tree, x, y, z, limit * limit)
            if place < 0 or attempt == ROUNDS:
                break
            distance = sqrt(squared)
            if distance > NEAR * thickness:
                nx, ny, nz = nx / distance, ny / distance, nz / distance
            else:
                nx, ny, nz = facing(numbers, place, x, y, z)
            depth = thickness - distance
            x, y, z = pushed(x, depth, nx), pushed(y, depth, ny), pushed(z, depth, nz)
        cx, cy, cz = cross(sx, sy, sz, x, y, z)
        c, n, before = (ux + cx, uy + cy, uz + cz), (nx, ny, nz), (vx, vy, vz)
        if FEATURE.restitution:
            slow = speed_of(settling)
            vx, vy, vz = rebound(before, c, n, static, dynamic, restitution, slow)
        else:
            vx, vy, vz = respond(before, c, n, static, dynamic)
        if FEATURE.friction_in_place:
            if crossing < 0:  # a path that was cut off has already lost what friction would remove
                dx, dy, dz = slid(settling[1], (vx, vy, vz), before, n)
                x, y, z = x + dx, y + dy, z + dz
        touched, limit = True, SETTLED * thickness
    return touched, (x, y, z), (vx, vy, vz)


touch = filled(frame.touch, {"settle": settle})
