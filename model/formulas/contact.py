"""Self-contact of a cloth: a mass against a triangle of the sheet.

Nearest point of a triangle: C. Ericson, "Real-Time Collision Detection", 2005, section 5.1.5. Constraint n . (p - sum
of b_k q_k) >= distance, with n and the b_k fixed for a substep: C. Lewin, "Cloth Self Collision with Predictive
Contacts", GDC 2018. Friction by a change of position: M. Macklin et al., "Unified Particle Physics for Real-Time
Applications", SIGGRAPH 2014, eq. 24. All contacts are projected at once from one state, each for a mass that is split
among its contacts, so that momentum is conserved: R. Tonge et al., "Mass Splitting for Jitter-Free Parallel Rigid Body
Simulation", SIGGRAPH 2012. Here the split follows the contacts' gradients, which is Gershgorin's bound of their system
(see `stiffness`). Hashing: M. Teschner et al., "Optimized Spatial Hashing for Collision Detection of Deformable
Objects", VMV 2003.

A sheet's triangles are numbered by twice the cell, plus 1 for the second one. Cell (i, j) with the masses A = (i, j), B
= (i, j + 1), C = (i + 1, j), D = (i + 1, j + 1) has (A, C, D) and (A, D, B).
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from softlab.model.base.variant import formula, integer_formula
from softlab.model.formulas.lengths import dot, length

FACE, FIRST, SECOND, THIRD, FIRST_SECOND, FIRST_THIRD, SECOND_THIRD = range(7)  # where a triangle's nearest point lies
SHEET = 7  # bits of the features that a triangle owns: it belongs to a cloth, whose two sides are both outside

OPERATIONS_NEAREST = 75  # nearest point of one triangle
OPERATIONS_CONTACT = 90  # one contact of one iteration: its gap, its stiffness, friction, four displacements

PRIMES = np.int64(73856093), np.int64(19349663), np.int64(83492791)  # Teschner et al. 2003, section 4.1
KEY_BITS, KEY_BITS_TWICE = np.int64(21), np.int64(42)
KEY_MASK = np.int64(2**21 - 1)
ONE, TWO = np.int64(1), np.int64(2)


@integer_formula
def corners(triangle, columns):
    """The three masses of a triangle of a sheet with `columns` columns of masses."""
    cell = triangle // TWO
    i = cell // (columns - ONE)
    a = i * columns + (cell - i * (columns - ONE))
    if triangle - cell * TWO == 0:
        return a, a + columns, a + columns + ONE
    return a, a + columns + ONE, a + ONE


@integer_formula
def owns(second, feature, i, j):
    """True if a triangle of cell (i, j) owns a corner or an edge that it shares, i.e. is the first to have it.

    `second`: True for the cell's second triangle. Testing only owners does not lose the nearest triangle: the owner
    of the feature on which the nearest point lies is equally near.
    """
    if feature in (FACE, SECOND_THIRD):
        return True
    if second:
        return feature in (FIRST_THIRD, THIRD) and i == 0
    if feature in (FIRST_THIRD, THIRD):
        return True
    return j == 0 and (feature != FIRST or i == 0)


@integer_formula
def key(x, y, z):
    """Number of a cell of space. Cells 2^21 apart have equal numbers; distances separate them."""
    return ((x & KEY_MASK) << KEY_BITS_TWICE) | ((y & KEY_MASK) << KEY_BITS) | (z & KEY_MASK)


@integer_formula
def bucket(x, y, z, mask):
    """Index of the cell in a hash table of mask + 1 entries, a power of two."""
    prime_x, prime_y, prime_z = PRIMES
    return ((x * prime_x) ^ (y * prime_y) ^ (z * prime_z)) & mask


@formula
def part(a, b):
    """a / b of non-negative numbers; 0 where b is 0."""
    return a / b if b > 0.0 else 0.0


@formula
def product_difference(a, b, c, d):
    return a * b - c * d


@formula
def middle(a, b, c, d):
    """Mean of a cell's four corners, one axis."""
    return ((a + b) + (c + d)) * 0.25


@formula
def scaled(x, factor):
    """x times `factor`: a coordinate in cells of space, or a distance in spacings."""
    return x * factor


@formula
def nearest(ux, uy, uz, vx, vy, vz, px, py, pz):
    """Return (feature, b, c) of the triangle's point nearest to p. u, v, p: from the first corner to the others and to
    the mass."""
    d1, d2 = dot(ux, uy, uz, px, py, pz), dot(vx, vy, vz, px, py, pz)
    if d1 <= 0.0 and d2 <= 0.0:
        return FIRST, 0.0, 0.0
    qx, qy, qz = px - ux, py - uy, pz - uz
    d3, d4 = dot(ux, uy, uz, qx, qy, qz), dot(vx, vy, vz, qx, qy, qz)
    if d3 >= 0.0 and d4 <= d3:
        return SECOND, 1.0, 0.0
    third = product_difference(d1, d4, d3, d2)
    if third <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return FIRST_SECOND, part(d1, d1 - d3), 0.0
    qx, qy, qz = px - vx, py - vy, pz - vz
    d5, d6 = dot(ux, uy, uz, qx, qy, qz), dot(vx, vy, vz, qx, qy, qz)
    if d6 >= 0.0 and d5 <= d6:
        return THIRD, 0.0, 1.0
    second = product_difference(d5, d2, d1, d6)
    if second <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return FIRST_THIRD, 0.0, part(d2, d2 - d6)
    first = product_difference(d3, d6, d5, d4)
    if first <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        c = part(d4 - d3, (d4 - d3) + (d5 - d6))
        return SECOND_THIRD, 1.0 - c, c
    whole = (first + second) + third
    return FACE, part(second, whole), part(third, whole)


@formula
def rest_distance(row, row_u, row_v, column, column_u, column_v, b, c, spacing):
    """Distance [m] of the mass from that point of the triangle in the flat sheet. Rows and columns are as u, v,
    p."""
    i, j = row - (b * row_u + c * row_v), column - (b * column_u + c * column_v)
    return spacing * sqrt(i * i + j * j)


@formula
def normal(r, distance, u, v, flat, coincident, above):
    """Unit direction in which the contact pushes the mass away from the triangle; 0 where there is none.

    r: from the nearest point to the mass, of length `distance`; u, v: the triangle's edges. Below the distance
    `flat`, where r is rounding, it is the triangle's normal on the mass's side. Below `coincident`, where there is
    no side, it is the normal that points up (or else along +x, or +z) if `above`, else the opposite one: then of
    two layers in one place the same one ends above from every point of view.
    """
    rx, ry, rz = r
    if distance > flat:
        return rx / distance, ry / distance, rz / distance
    nx = product_difference(u[1], v[2], u[2], v[1])
    ny = product_difference(u[2], v[0], u[0], v[2])
    nz = product_difference(u[0], v[1], u[1], v[0])
    size = length(nx, ny, nz)
    if size <= 0.0:
        return 0.0, 0.0, 0.0
    nx, ny, nz = nx / size, ny / size, nz / size
    side = dot(nx, ny, nz, rx, ry, rz)
    outside = side > 0.0
    if abs(side) <= coincident:
        up = ny > 0.0 or (ny == 0.0 and (nx > 0.0 or (nx == 0.0 and nz > 0.0)))
        outside = up == above
    return (nx, ny, nz) if outside else (-nx, -ny, -nz)


@formula
def enforced_distance(thickness, rest, gap, push):
    """Distance [m] that the contact enforces: the thickness, but no more than the flat sheet has there (or
    neighbours would repel each other), and for a contact that began nearer no more than `push` beyond its gap."""
    return min(min(thickness, rest), gap + push)


@formula
def away(p, u, v, b, c):
    """Vector from the nearest point to the mass, one axis."""
    return p - (b * u + c * v)


@formula
def mixed(qa, qb, qc, b, c):
    """Point of the triangle with the weights b and c, one axis."""
    return (((1.0 - b) - c) * qa + b * qb) + c * qc


@formula
def first_weight(b, c):
    return (1.0 - b) - c


@formula
def stiffness(weight, load, wa, la, wb, lb, wc, lc, b, c):
    """Divisor of a contact's depth: the sum over its masses of |gradient| weight load.

    The load of a mass is the sum of the gradients of all its contacts. By Gershgorin's theorem the contacts' system
    is no stiffer, so that projecting all at once does not overshoot.
    """
    a = (1.0 - b) - c
    return weight * load + ((a * (wa * la) + b * (wb * lb)) + c * (wc * lc))


@formula
def inverse(stiffness):
    """1 / stiffness; 0 where every mass of the contact is pinned."""
    return 1.0 / stiffness if stiffness > 0.0 else 0.0


@formula
def slip(sliding, depth, static_friction, dynamic_friction):
    """Fraction of the sliding [m] that friction removes, from the depth [m] that the contact corrects."""
    if sliding <= static_friction * depth:
        return 1.0
    return dynamic_friction * depth / sliding


@formula
def along(d, n, normal_part):
    """Component of a displacement d in the contact's plane, one axis."""
    return d - n * normal_part


@formula
def correction(depth, n, inverse_stiffness):
    """Displacement of the mass by the contact for a weight of 1, one axis."""
    return depth * n * inverse_stiffness


@formula
def rubbed(depth, n, slipping, tangential, inverse_stiffness):
    """Displacement as by `correction`, with friction."""
    return (depth * n - slipping * tangential) * inverse_stiffness


@formula
def taken(total, weight, moved):
    """Sum of displacements minus the displacement `moved` of one contact times the corner's weight `weight`, one
    axis."""
    return total - weight * moved


@formula
def shifted(position, weight, total):
    """Position of a mass after all its contacts, one axis."""
    return position + weight * total
