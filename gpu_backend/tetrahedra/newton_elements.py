"""Terms of a tetrahedron in Newton's method, on CUDA: energy, forces at its corners, blocks of its tangent.

As cpu_backend/tetrahedra/newton_elements.py, for one tetrahedron. Its values are stored column by column; its forces
are quads, in the order of corners; its blocks nine numbers each, one after the other.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np

from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.model.base.tuples import tuple_of
from softlab.model.base.types import Real
from softlab.model.formulas.constraints.tetrahedron import HOOKEAN
from softlab.model.formulas.elastic import damper, deformation, newton, solving, tangent
from softlab.model.tetrahedra.block_rows import BLOCKS
from softlab.model.tetrahedra.newton import AT_ALPHA, AT_DAMPING, AT_LAME, AT_MU, AT_VOLUME, DAMPED, STAGED


@cache
def make_block_access(math: str) -> SimpleNamespace:
    """Make `load_block(array, place)`, `store_block(array, place, m)`: nine numbers, by rows; `load_six(array,
    first, step)`; `transposed(m)`; `added(a, b)`."""
    inline = inlined(math)
    nine = np.int32(9)

    @inline
    def load_block(array, place):
        k = np.int32(nine * place)
        return (
            array[k], array[k + 1], array[k + 2], array[k + 3], array[k + 4], array[k + 5], array[k + 6], array[k + 7],
            array[k + 8],
        )  # fmt: skip

    @inline
    def store_block(array, place, m):
        k = np.int32(nine * place)
        array[k], array[k + 1], array[k + 2], array[k + 3], array[k + 4] = m[0], m[1], m[2], m[3], m[4]
        array[k + 5], array[k + 6], array[k + 7], array[k + 8] = m[5], m[6], m[7], m[8]

    @inline
    def load_six(array, first, step):
        """Return six numbers that are `step` apart."""
        return (
            array[first], array[step + first], array[2 * step + first], array[3 * step + first], array[4 * step + first],
            array[5 * step + first],
        )  # fmt: skip

    @inline
    def transposed(m):
        return m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]

    @inline
    def added(a, b):
        return (
            a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5], a[6] + b[6], a[7] + b[7],
            a[8] + b[8],
        )  # fmt: skip

    return SimpleNamespace(
        load_block=load_block, store_block=store_block, load_six=load_six, transposed=transposed, added=added
    )


@cache
def make_reading(real: Real, math: str) -> SimpleNamespace:
    """Make `rest_of(values, n, count, n)`, B of tetrahedron n of `count`, `deformed(n, position, corners, rest)`, F,
    and `changed(n, position, other, corners, rest)`, F minus that of the `other` positions, from differences."""
    inline, four = inlined(math), np.int32(4)
    gradient = device_formulas(deformation, real, math).gradient

    def value_at(n: int) -> Callable:
        return inline(lambda values, unused, count, t: values[np.uint32(np.int32(n * count) + t)])

    rest_of = tuple_of(9, value_at, inline)

    @inline
    def xyz(quad):
        return quad[0], quad[1], quad[2]

    @inline
    def deformed(n, position, corners, rest):
        first = np.int32(four * n)
        return gradient(
            xyz(load_quad(position, corners[first])), xyz(load_quad(position, corners[first + 1])),
            xyz(load_quad(position, corners[first + 2])), xyz(load_quad(position, corners[first + 3])), rest,
        )  # fmt: skip

    @inline
    def difference(position, other, k):
        p, q = load_quad(position, k), load_quad(other, k)
        return p[0] - q[0], p[1] - q[1], p[2] - q[2]

    @inline
    def changed(n, position, other, corners, rest):
        first = np.int32(four * n)
        return gradient(
            difference(position, other, corners[first]), difference(position, other, corners[first + 1]),
            difference(position, other, corners[first + 2]), difference(position, other, corners[first + 3]), rest,
        )  # fmt: skip

    return SimpleNamespace(rest_of=rest_of, deformed=deformed, changed=changed)


@cache
def make_damper(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Make viscous(n, v, f, rest, number, corners, mu, lame): (D, N) of tetrahedron n, as on the CPU."""
    inline, reading, formulas = inlined(math), make_reading(real, math), device_formulas(damper, real, math)
    deformed, changed = reading.deformed, reading.changed
    increment, beyond, resisted = formulas.increment, formulas.beyond, formulas.resisted
    staged, two = STAGED in parts, np.int64(2)

    @inline
    def viscous(n, v, f, rest, number, corners, mu, lame):
        if staged:
            if number % two == 1:
                e = increment(f, changed(n, v.position, v.middle, corners, rest))
                f = deformed(n, v.middle, corners, rest)
                e = beyond(e, increment(f, changed(n, v.middle, v.origin, corners, rest)))
            else:
                e = increment(f, changed(n, v.position, v.before, corners, rest))
        else:
            e = increment(f, changed(n, v.position, v.before, corners, rest))
        return resisted(e, mu, lame)

    return viscous


@cache
def make_energies(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Make energies(n, count, solver, rate, number) -> (energy, its rounding error) [J].

    It also writes the forces at the four corners of tetrahedron n of `count`; all three include dampers. `rate`: 1 / h,
    of the solve `number`.
    """
    inline, four, zero = inlined(math), np.int32(4), real(0)
    at_corners = device_formulas(deformation, real, math).corners
    rotation, products = (
        device_formulas(deformation, real, math).rotation,
        device_formulas(solving, real, math),
    )
    stress, doubt = device_formulas(tangent, real, math).stress, device_formulas(newton, real, math).doubt
    times, scaled, reading = products.times, products.scaled, make_reading(real, math)
    rest_of, deformed = reading.rest_of, reading.deformed
    viscous, damped, of_damper = (
        make_damper(real, math, parts), DAMPED in parts, device_formulas(damper, real, math),
    )  # fmt: skip
    stressed, moduli = of_damper.stressed, of_damper.scaled

    @inline
    def put(forces, place, volume, g):
        x, y, z = scaled(volume, g[0], g[1], g[2])
        store_quad(forces, place, x, y, z, zero)

    @inline
    def energies(n, count, solver, rate, number):
        v, forces, (corners, materials, values) = solver.vectors, solver.matrix.forces, solver.elements
        material, rest, volume = materials[n], rest_of(values, n, count, n), values[AT_VOLUME * count + n]
        mu, lame = values[AT_MU * count + n], values[AT_LAME * count + n]
        f = deformed(n, v.position, corners, rest)
        r = f
        if material != HOOKEAN:
            r = rotation(f)
        energy_density, p = stress(material, f, r, mu, lame, values[AT_ALPHA * count + n])
        energy, unsure = times(volume, energy_density), doubt(energy_density, volume, mu, lame, material == HOOKEAN)
        if damped:
            mu, lame = moduli(values[AT_DAMPING * count + n], rate, mu, lame)
            lost, pull = viscous(n, v, f, rest, number, corners, mu, lame)
            p = stressed(p, f, pull)
            energy, unsure = energy + times(volume, lost), unsure + doubt(lost, volume, mu, lame, False)
        a, b, c, d = at_corners(p, rest)
        first = np.int32(four * n)
        put(forces, first, volume, a)
        put(forces, np.int32(first + 1), volume, b)
        put(forces, np.int32(first + 2), volume, c)
        put(forces, np.int32(first + 3), volume, d)
        return energy, unsure

    return energies


@cache
def make_blocks(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Make blocks(n, count, solver, rate, number, safe): the tangent of tetrahedron n of
    `count`, BLOCKS blocks, including dampers."""
    inline, every = inlined(math), np.int32(BLOCKS)
    rotation, shape = device_formulas(deformation, real, math).rotation, device_formulas(tangent, real, math)
    frame, moduli, block, seen_in = shape.frame, shape.moduli, shape.block, shape.seen_in
    products, access, reading = (
        device_formulas(solving, real, math),
        make_block_access(math),
        make_reading(real, math),
    )
    weighted, rest_of, deformed = products.weighted, reading.rest_of, reading.deformed
    store_block, transposed, added = access.store_block, access.transposed, access.added
    viscous, damped, of_damper = (
        make_damper(real, math, parts), DAMPED in parts, device_formulas(damper, real, math),
    )  # fmt: skip
    scaled, positive, squared, resisting = of_damper.scaled, of_damper.positive, of_damper.squared, of_damper.block

    @inline
    def negative(a):
        return -a[0], -a[1], -a[2], -a[3], -a[4], -a[5], -a[6], -a[7], -a[8]

    @inline
    def left(a, b, c):
        """Return the block that makes the sum of the four zero."""
        return negative(added(added(a, b), c))

    @inline
    def blocks(n, count, solver, rate, number, safe):
        v, block_array, (corners, materials, values) = solver.vectors, solver.matrix.element_blocks, solver.elements
        rest, weight = rest_of(values, n, count, n), values[AT_VOLUME * count + n]
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
        if damped:
            mu, lame = scaled(values[AT_DAMPING * count + n], rate, mu, lame)
            _, pull = viscous(n, v, f, rest, number, corners, mu, lame)
            if safe:
                pull = positive(pull)
            ff = squared(f)
            bb, bc = resisting(bb, f, ff, pull, mu, lame, b, b), resisting(bc, f, ff, pull, mu, lame, b, c)
            bd, cc = resisting(bd, f, ff, pull, mu, lame, b, d), resisting(cc, f, ff, pull, mu, lame, c, c)
            cd, dd = resisting(cd, f, ff, pull, mu, lame, c, d), resisting(dd, f, ff, pull, mu, lame, d, d)
        bb, bc, bd = weighted(weight, bb), weighted(weight, bc), weighted(weight, bd)
        cc, cd, dd = weighted(weight, cc), weighted(weight, cd), weighted(weight, dd)
        first = np.int32(every * n)
        store_block(block_array, np.int32(first + 4), bb)
        store_block(block_array, np.int32(first + 5), bc)
        store_block(block_array, np.int32(first + 6), bd)
        store_block(block_array, np.int32(first + 7), cc)
        store_block(block_array, np.int32(first + 8), cd)
        store_block(block_array, np.int32(first + 9), dd)
        ab, ac, ad = (
            left(bb, transposed(bc), transposed(bd)), left(bc, cc, transposed(cd)), left(bd, cd, dd)
        )  # fmt: skip
        store_block(block_array, first, left(ab, ac, ad))
        store_block(block_array, np.int32(first + 1), ab)
        store_block(block_array, np.int32(first + 2), ac)
        store_block(block_array, np.int32(first + 3), ad)

    return blocks
