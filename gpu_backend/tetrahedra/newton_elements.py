"""Terms of a tetrahedron in Newton's method, on CUDA: energy, forces at its corners, blocks of its tangent.

As cpu_backend/tetrahedra/newton_elements.py, for one tetrahedron. Its values are stored column by column; its forces
are quads, in the order of corners; its blocks nine numbers each, one after the other.
"""

from __future__ import annotations

import numpy as np

from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.gpu_backend.tetrahedra.springs import xyz
from softlab.model.base.variant import FEATURE, inlined_routine, unrolled
from softlab.model.formulas.constraints.tetrahedron import HOOKEAN
from softlab.model.formulas.elastic.damper import beyond, increment, positive, resisted, squared, stressed
from softlab.model.formulas.elastic.damper import block as damped_block
from softlab.model.formulas.elastic.damper import scaled as damper_moduli
from softlab.model.formulas.elastic.deformation import corners as at_corners
from softlab.model.formulas.elastic.deformation import gradient, rotation
from softlab.model.formulas.elastic.descent import added
from softlab.model.formulas.elastic.newton import doubt
from softlab.model.formulas.elastic.solving import scaled, times, weighted
from softlab.model.formulas.elastic.tangent import block, frame, moduli, seen_in, stress
from softlab.model.tetrahedra.block_rows import BLOCKS
from softlab.model.tetrahedra.newton import AT_ALPHA, AT_DAMPING, AT_LAME, AT_MU, AT_VOLUME


@inlined_routine
def load_block(array, place):
    """Return a block of an array: nine numbers, by rows."""
    k = np.int32(9 * place)
    return tuple(array[k + n] for n in unrolled(9))


@inlined_routine
def store_block(array, place, m):
    k = np.int32(9 * place)
    for n in unrolled(9):
        array[k + n] = m[n]


@inlined_routine
def load_six(array, first, step):
    """Return six numbers that are `step` apart."""
    return tuple(array[n * step + first] for n in unrolled(6))


@inlined_routine
def transposed(m):
    return m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]


@inlined_routine
def rest_of(values, count, n):
    """Return B of tetrahedron n of `count`."""
    return tuple(values[np.uint32(np.int32(m * count) + n)] for m in unrolled(9))


@inlined_routine
def deformed(n, position, corners, rest):
    """Return F of tetrahedron n."""
    first = np.int32(4 * n)
    return gradient(
        xyz(load_quad(position, corners[first])), xyz(load_quad(position, corners[first + 1])),
        xyz(load_quad(position, corners[first + 2])), xyz(load_quad(position, corners[first + 3])), rest,
    )  # fmt: skip


@inlined_routine
def difference(position, other, k):
    p, q = load_quad(position, k), load_quad(other, k)
    return p[0] - q[0], p[1] - q[1], p[2] - q[2]


@inlined_routine
def changed(n, position, other, corners, rest):
    """Return F minus that of the `other` positions, from differences."""
    first = np.int32(4 * n)
    return gradient(
        difference(position, other, corners[first]), difference(position, other, corners[first + 1]),
        difference(position, other, corners[first + 2]), difference(position, other, corners[first + 3]), rest,
    )  # fmt: skip


@inlined_routine
def viscous(n, v, f, rest, number, corners, mu, lame):
    """Return (D, N) of tetrahedron n, as on the CPU."""
    if FEATURE.two_stages and number % 2 == 1:
        e = increment(f, changed(n, v.position, v.first_end, corners, rest))
        f = deformed(n, v.first_end, corners, rest)
        e = beyond(e, increment(f, changed(n, v.first_end, v.first_start, corners, rest)))
    else:
        e = increment(f, changed(n, v.position, v.before, corners, rest))
    return resisted(e, mu, lame)


@inlined_routine
def energies(n, count, solver, rate, number):
    """Return (energy, its rounding error) [J] of tetrahedron n of `count`, and write the forces at its corners; all three
    include dampers. `rate`: 1 / h, of the solve `number`."""
    v, forces, (corners, materials, values) = solver.vectors, solver.matrix.forces, solver.elements
    material, rest, volume = materials[n], rest_of(values, count, n), values[AT_VOLUME * count + n]
    mu, lame = values[AT_MU * count + n], values[AT_LAME * count + n]
    f = deformed(n, v.position, corners, rest)
    r = f
    if material != HOOKEAN:
        r = rotation(f)
    energy_density, p = stress(material, f, r, mu, lame, values[AT_ALPHA * count + n])
    energy, unsure = times(volume, energy_density), doubt(energy_density, volume, mu, lame, material == HOOKEAN)
    if FEATURE.damped:
        mu, lame = damper_moduli(values[AT_DAMPING * count + n], rate, mu, lame)
        lost, pull = viscous(n, v, f, rest, number, corners, mu, lame)
        p = stressed(p, f, pull)
        energy, unsure = energy + times(volume, lost), unsure + doubt(lost, volume, mu, lame, False)
    g = at_corners(p, rest)
    for corner in unrolled(4):
        x, y, z = scaled(volume, g[corner][0], g[corner][1], g[corner][2])
        store_quad(forces, np.int32(4 * n + corner), x, y, z, 0.0)
    return energy, unsure


@inlined_routine
def negative(a):
    return -a[0], -a[1], -a[2], -a[3], -a[4], -a[5], -a[6], -a[7], -a[8]


@inlined_routine
def left(a, b, c):
    """Return the block that makes the sum of the four zero."""
    return negative(added(added(a, b), c))


@inlined_routine
def blocks(n, count, solver, rate, number, safe):
    """Write the tangent of tetrahedron n of `count`, BLOCKS blocks, including dampers."""
    v, block_array, (corners, materials, values) = solver.vectors, solver.matrix.element_blocks, solver.elements
    rest, weight = rest_of(values, count, n), values[AT_VOLUME * count + n]
    mu, lame = values[AT_MU * count + n], values[AT_LAME * count + n]
    f = deformed(n, v.position, corners, rest)
    s, u, w = frame(f, rotation(f))
    axial, sums, offs = moduli(materials[n], s, mu, lame, values[AT_ALPHA * count + n], safe)
    xx, xy, xz, yx, yy, yz, zx, zy, zz = rest
    b, c, d = (xx, xy, xz), (yx, yy, yz), (zx, zy, zz)
    p, q, r = seen_in(w, xx, xy, xz), seen_in(w, yx, yy, yz), seen_in(w, zx, zy, zz)
    bb, bc = block(u, axial, sums, offs, p, p), block(u, axial, sums, offs, p, q)
    bd, cc = block(u, axial, sums, offs, p, r), block(u, axial, sums, offs, q, q)
    cd, dd = block(u, axial, sums, offs, q, r), block(u, axial, sums, offs, r, r)
    if FEATURE.damped:
        mu, lame = damper_moduli(values[AT_DAMPING * count + n], rate, mu, lame)
        _, pull = viscous(n, v, f, rest, number, corners, mu, lame)
        if safe:
            pull = positive(pull)
        ff = squared(f)
        bb, bc = damped_block(bb, f, ff, pull, mu, lame, b, b), damped_block(bc, f, ff, pull, mu, lame, b, c)
        bd, cc = damped_block(bd, f, ff, pull, mu, lame, b, d), damped_block(cc, f, ff, pull, mu, lame, c, c)
        cd, dd = damped_block(cd, f, ff, pull, mu, lame, c, d), damped_block(dd, f, ff, pull, mu, lame, d, d)
    bb, bc, bd = weighted(weight, bb), weighted(weight, bc), weighted(weight, bd)
    cc, cd, dd = weighted(weight, cc), weighted(weight, cd), weighted(weight, dd)
    first = np.int32(BLOCKS * n)
    store_block(block_array, np.int32(first + 4), bb)
    store_block(block_array, np.int32(first + 5), bc)
    store_block(block_array, np.int32(first + 6), bd)
    store_block(block_array, np.int32(first + 7), cc)
    store_block(block_array, np.int32(first + 8), cd)
    store_block(block_array, np.int32(first + 9), dd)
    ab, ac, ad = left(bb, transposed(bc), transposed(bd)), left(bc, cc, transposed(cd)), left(bd, cd, dd)
    store_block(block_array, first, left(ab, ac, ad))
    store_block(block_array, np.int32(first + 1), ab)
    store_block(block_array, np.int32(first + 2), ac)
    store_block(block_array, np.int32(first + 3), ad)
