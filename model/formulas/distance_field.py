"""Masses against a sampled signed-distance field: its value and gradient at a point, the entry of a path, the response.

The distance to a closed surface, negative inside, is sampled at the points of a regular grid of the spacing h and
interpolated trilinearly between them; the normal is the gradient of the interpolant. Where the distance is smooth in a
cell, its error is at most h^2/8 (|d_xx| + |d_yy| + |d_zz|), of second order (on a ball of radius R: h^2 / (4 R)), and
the normal's direction is of first order. Where it is not smooth (beside edges and corners, and inside at points equally
far from two sides), the error of a distance, whose slope is at most 1, is at most sqrt(3)/2 h, and the normal is a
mixture of both.

Everything happens in the collider's own frame (model/formulas/frame.py). Outside the sampled box there is no contact:
the box exceeds the body by more than the thickness. The inside is solid: a mass in it is pushed out from any depth. A
path through the body is cut off where it enters, by steps as long as the distance to the body (J. C. Hart, "Sphere
tracing", The Visual Computer 12, 1996).

A field is an array of numbers: HEADER of them (cells along x, y and z; the grid's smallest x, y, z; cells per metre;
the smallest distance of the body from the sides of the box), then the samples, z fastest.
"""

from __future__ import annotations

import numpy as np

from softlab.model.base.variant import FEATURE, filled, formula, real
from softlab.model.formulas import frame
from softlab.model.formulas.cloth import between, pushed
from softlab.model.formulas.colliders import rebound, respond, slid
from softlab.model.formulas.lengths import cross
from softlab.model.formulas.lengths import length as norm

HEADER = 8
ROUNDS = 4  # largest number of corrections of a mass: two folds, each tested twice
SETTLED = 1 - 2.0**-6  # of the thickness: a corrected mass that is no nearer than that stays
STEPS = 64  # along a path, of at least half a cell: more are needed only along a surface, and nearer to it
NULL = 2.0**-10  # of a distance's slope, which is 1: a smaller gradient has no usable direction


@formula
def beyond(u, cells):
    """Distance of u outside the grid [cells]."""
    return max(max(-u, u - cells), 0.0)


@formula
def cell_of(u, cells):
    """Index of the cell that contains u; the last one at the grid's end."""
    return min(real(np.int32(u)), cells - 1.0)


@formula
def sample(numbers, field, x, y, z):
    """Return (distance [m], gx, gy, gz [m per cell]) at a point. Outside the box: a lower bound of the distance, and no
    gradient.

    `field`: the index at which its numbers begin.
    """
    across, up, deep = numbers[field], numbers[field + 1], numbers[field + 2]
    per_metre = numbers[field + 6]
    u = (x - numbers[field + 3]) * per_metre
    v = (y - numbers[field + 4]) * per_metre
    w = (z - numbers[field + 5]) * per_metre
    if not (u >= 0.0 and u <= across and v >= 0.0 and v <= up and w >= 0.0 and w <= deep):  # also true for NaN
        away = max(max(beyond(u, across), beyond(v, up)), beyond(w, deep))
        return numbers[field + 7] + away / per_metre, 0.0, 0.0, 0.0
    i, j, k = cell_of(u, across), cell_of(v, up), cell_of(w, deep)
    u, v, w = u - i, v - j, w - k
    line, plane = deep + 1.0, (up + 1.0) * (deep + 1.0)
    a = np.int32(field + HEADER + np.int32(i * plane + (j * line + k)))  # integers, exact in float32 up to 2^24
    b, c = np.int32(a + np.int32(line)), np.int32(a + np.int32(plane))
    d = np.int32(c + np.int32(line))
    v000, v001, v010, v011 = numbers[a], numbers[a + 1], numbers[b], numbers[b + 1]
    v100, v101, v110, v111 = numbers[c], numbers[c + 1], numbers[d], numbers[d + 1]
    v00, v01 = between(v000, v100, u), between(v001, v101, u)
    v10, v11 = between(v010, v110, u), between(v011, v111, u)
    gx = between(between(v100 - v000, v110 - v010, v), between(v101 - v001, v111 - v011, v), w)
    gy = between(v10 - v00, v11 - v01, w)
    v0, v1 = between(v00, v10, v), between(v01, v11, v)
    return between(v0, v1, w), gx, gy, v1 - v0


@formula
def entry(numbers, field, ax, ay, az, bx, by, bz, length):
    """Fraction of the segment from a to b, `length` [m], after which it enters the body; 1 where it does not, or
    began inside.

    Each step is as long as the distance to the body, or half a cell. Where a step ends inside, the segment is cut
    off between the step's ends by linear interpolation of the distance.
    """
    part, last, before = 0.0, 0.0, 0.0
    for step in range(STEPS):
        x, y, z = between(ax, bx, part), between(ay, by, part), between(az, bz, part)
        distance, _, _, _ = sample(numbers, field, x, y, z)
        if distance <= 0.0:
            if step == 0:
                return 1.0
            return between(last, part, before / (before - distance))
        if distance >= (1.0 - part) * length:
            return 1.0
        last, before = part, distance
        part = min(part + max(distance, 0.5 / numbers[field + 6]) / length, 1.0)
    return 1.0


@formula
def speed_of(pair):
    """Speed in `settling`."""
    return pair[0] if FEATURE.friction_in_place else pair


@formula
def settle(numbers, field, surface, spin, velocity, a, p, v):
    """Return (True if the body was touched, p, v) of a mass on its path from a to p, in the body's frame.

    `spin`: the body's angular velocity [rad/s]; `velocity`: its own. The path is cut off where it enters the body. Then
    the mass is pushed along the gradient until its distance is `thickness`, at most ROUNDS times. Where there is no
    gradient, it is pushed back along its path, and up where it has not moved.
    """
    thickness, static, dynamic, restitution, settling = surface
    (sx, sy, sz), (ux, uy, uz) = spin, velocity
    (ax, ay, az), (x, y, z), (vx, vy, vz) = a, p, v
    touched, limit = False, thickness
    wx, wy, wz = ax - x, ay - y, az - z
    length = norm(wx, wy, wz)
    part = entry(numbers, field, ax, ay, az, x, y, z, length)
    if part < 1.0:
        x, y, z = between(ax, x, part), between(ay, y, part), between(az, z, part)
    for _ in range(ROUNDS):
        distance, nx, ny, nz = sample(numbers, field, x, y, z)
        if not distance < limit:
            break
        size = norm(nx, ny, nz)
        if not size * numbers[field + 6] > NULL:
            nx, ny, nz, size = wx, wy, wz, length
        if not size > 0.0:
            nx, ny, nz, size = 0.0, 1.0, 0.0, 1.0
        nx, ny, nz = nx / size, ny / size, nz / size
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
            if part == 1.0:  # a path that was cut off has already lost what friction would remove
                dx, dy, dz = slid(settling[1], (vx, vy, vz), before, n)
                x, y, z = x + dx, y + dy, z + dz
        touched, limit = True, SETTLED * thickness
    return touched, (x, y, z), (vx, vy, vz)


touch = filled(frame.touch, {"settle": settle})
