"""Terms of a tetrahedron in Newton's method, on CPU threads: energy, forces at its corners, blocks of its tangent."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

from softlab.cpu_backend.core.compile import Compiler
from softlab.model.base.types import Real
from softlab.model.formulas.constraints.tetrahedron import HOOKEAN
from softlab.model.formulas.elastic import damper, deformation, newton, tangent
from softlab.model.tetrahedra.block_rows import BLOCKS
from softlab.model.tetrahedra.newton import AT_ALPHA, AT_DAMPING, AT_LAME, AT_MU, AT_VOLUME, DAMPED, STAGED, SUMMED


def make_elements(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make `energies` and `blocks`, both with the terms of dampers.

    `energies(first, last, points, since, elements, forces, sums)`: energies, and forces on the four corners, of the
    tetrahedra of the groups `first` to before `last` of SUMMED. `blocks(first, last, points, since, elements, safe,
    blocks_out)`: their tangents, in rows of BLOCKS blocks. `since`: Since of newton_arrays.py.
    """
    compiled = compiler.compiled
    elastic, shape = compiler.formulas(deformation, real), compiler.formulas(tangent, real)
    gradient, at_corners, rotation = elastic.gradient, elastic.corners, compiler.formulas(deformation, real).rotation
    stress, frame, moduli, block, seen_in = shape.stress, shape.frame, shape.moduli, shape.block, shape.seen_in
    doubt, zero = compiler.formulas(newton, real).doubt, real(0)
    viscous, damped, of_damper = make_damper(compiler, real, parts), DAMPED in parts, compiler.formulas(damper, real)
    stressed, scaled, positive, squared, added = (
        of_damper.stressed, of_damper.scaled, of_damper.positive, of_damper.squared, of_damper.block,
    )  # fmt: skip
    row = make_row(compiler)

    @compiled
    def rest_of(values, n):
        return (
            values[n, 0], values[n, 1], values[n, 2], values[n, 3], values[n, 4], values[n, 5], values[n, 6], values[n, 7],
            values[n, 8],
        )  # fmt: skip

    @compiled
    def deformed(points, corners, rest, n):
        a, b, c, d = corners[n, 0], corners[n, 1], corners[n, 2], corners[n, 3]
        return gradient(row(points, a), row(points, b), row(points, c), row(points, d), rest)

    @compiled
    def put(forces, n, corner, volume, g):
        forces[n, 3 * corner] = volume * g[0]
        forces[n, 3 * corner + 1] = volume * g[1]
        forces[n, 3 * corner + 2] = volume * g[2]

    @compiled
    def energies(first, last, points, since, elements, forces, sums):
        corners, materials, values = elements
        for group in range(first, last):
            total, unsure = zero, zero
            for n in range(group * SUMMED, min((group + 1) * SUMMED, len(corners))):
                material, rest, volume = materials[n], rest_of(values, n), values[n, AT_VOLUME]
                f = deformed(points, corners, rest, n)
                r = f if material == HOOKEAN else rotation(f)
                energy_density, p = stress(material, f, r, values[n, AT_MU], values[n, AT_LAME], values[n, AT_ALPHA])
                energy = volume * energy_density
                off = doubt(energy_density, volume, values[n, AT_MU], values[n, AT_LAME], material == HOOKEAN)
                if damped:
                    mu, lame = scaled(values[n, AT_DAMPING], since.rate, values[n, AT_MU], values[n, AT_LAME])
                    lost, pull = viscous(n, points, f, rest, since, corners, mu, lame)
                    p = stressed(p, f, pull)
                    energy, off = energy + volume * lost, off + doubt(lost, volume, mu, lame, False)
                a, b, c, d = at_corners(p, rest)
                put(forces, n, 0, volume, a)
                put(forces, n, 1, volume, b)
                put(forces, n, 2, volume, c)
                put(forces, n, 3, volume, d)
                total, unsure = total + energy, unsure + off
            sums[0, group], sums[1, group] = total, unsure

    @compiled
    def complete(first, blocks_out):
        """Compute the blocks of the first corner: with the others of a row they sum to zero."""
        for i in range(3):
            for j in range(3):
                m, t = 3 * i + j, 3 * j + i
                b = -((blocks_out[first + 4, m] + blocks_out[first + 5, t]) + blocks_out[first + 6, t])
                c = -((blocks_out[first + 5, m] + blocks_out[first + 7, m]) + blocks_out[first + 8, t])
                d = -((blocks_out[first + 6, m] + blocks_out[first + 8, m]) + blocks_out[first + 9, m])
                blocks_out[first, m], blocks_out[first + 1, m] = -((b + c) + d), b
                blocks_out[first + 2, m], blocks_out[first + 3, m] = c, d

    @compiled
    def blocks(first, last, points, since, elements, safe, blocks_out):
        corners, materials, values = elements
        for n in range(first * SUMMED, min(last * SUMMED, len(corners))):
            rest = rest_of(values, n)
            f = deformed(points, corners, rest, n)
            s, u, v = frame(f, rotation(f))
            axial, sums, offs = moduli(materials[n], s, values[n, AT_MU], values[n, AT_LAME], values[n, AT_ALPHA], safe)
            weight = values[n, AT_VOLUME]
            xx, xy, xz, yx, yy, yz, zx, zy, zz = rest
            b, c, d = (xx, xy, xz), (yx, yy, yz), (zx, zy, zz)
            if damped:
                mu, lame = scaled(values[n, AT_DAMPING], since.rate, values[n, AT_MU], values[n, AT_LAME])
                _, pull = viscous(n, points, f, rest, since, corners, mu, lame)
                if safe:
                    pull = positive(pull)
                ff, rows = squared(f), (b, c, d)
            seen = seen_in(v, xx, xy, xz), seen_in(v, yx, yy, yz), seen_in(v, zx, zy, zz)
            place = n * BLOCKS + 4
            for p in range(3):  # a loop, so that a block is compiled once
                for q in range(p, 3):
                    h = block(u, axial, sums, offs, seen[p], seen[q])
                    if damped:
                        h = added(h, f, ff, pull, mu, lame, rows[p], rows[q])
                    for m in range(9):
                        blocks_out[place, m] = weight * h[m]
                    place += 1
            complete(n * BLOCKS, blocks_out)

    return SimpleNamespace(energies=energies, blocks=blocks)


def make_row(compiler: Compiler) -> Callable:
    """Make row(points, k): a point, three numbers."""

    @compiler.compiled
    def row(points, k):
        return points[k, 0], points[k, 1], points[k, 2]

    return row


def make_damper(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Make viscous(n, points, f, rest, since, corners, mu, lame): (D, N) of tetrahedron n
    (model/formulas/elastic/damper.py).

    `since`: Since of newton_arrays.py.
    """
    compiled, formulas = compiler.compiled, compiler.formulas(damper, real)
    gradient, row = compiler.formulas(deformation, real).gradient, make_row(compiler)
    increment, beyond, resisted, staged = formulas.increment, formulas.beyond, formulas.resisted, STAGED in parts

    @compiled
    def difference(points, other, k):
        p, q = row(points, k), row(other, k)
        return p[0] - q[0], p[1] - q[1], p[2] - q[2]

    @compiled
    def change(n, points, other, corners, rest):
        """Return F of `points` minus that of `other` points, from differences: in float32 the motion of the whole body
        would otherwise cause spurious strains."""
        a, b, c, d = corners[n, 0], corners[n, 1], corners[n, 2], corners[n, 3]
        return gradient(
            difference(points, other, a),
            difference(points, other, b),
            difference(points, other, c),
            difference(points, other, d),
            rest,
        )

    @compiled
    def viscous(n, points, f, rest, since, corners, mu, lame):
        middle = since.middle
        if staged and since.second:
            e = increment(f, change(n, points, middle, corners, rest))
            a, b, c, d = corners[n, 0], corners[n, 1], corners[n, 2], corners[n, 3]
            f = gradient(row(middle, a), row(middle, b), row(middle, c), row(middle, d), rest)
            e = beyond(e, increment(f, change(n, middle, since.origin, corners, rest)))
        else:
            e = increment(f, change(n, points, since.before, corners, rest))
        return resisted(e, mu, lame)

    return viscous
