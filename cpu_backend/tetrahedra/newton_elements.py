"""Terms of a tetrahedron in Newton's method, on CPU threads: energy, forces at its corners, blocks of its tangent."""

from __future__ import annotations

from softlab.cpu_backend.tetrahedra.springs import row
from softlab.model.base.variant import FEATURE, routine, unrolled
from softlab.model.formulas.constraints.tetrahedron import HOOKEAN
from softlab.model.formulas.elastic.damper import beyond, increment, positive, resisted, scaled, squared, stressed
from softlab.model.formulas.elastic.damper import block as damped_block
from softlab.model.formulas.elastic.deformation import corners as at_corners
from softlab.model.formulas.elastic.deformation import gradient, rotation
from softlab.model.formulas.elastic.newton import doubt
from softlab.model.formulas.elastic.tangent import block, frame, moduli, seen_in, stress
from softlab.model.tetrahedra.block_rows import BLOCKS
from softlab.model.tetrahedra.newton import AT_ALPHA, AT_DAMPING, AT_LAME, AT_MU, AT_VOLUME, SUMMED


@routine
def rest_of(values, n):
    return tuple(values[n, m] for m in unrolled(9))


@routine
def deformed(points, corners, rest, n):
    a, b, c, d = corners[n, 0], corners[n, 1], corners[n, 2], corners[n, 3]
    return gradient(row(points, a), row(points, b), row(points, c), row(points, d), rest)


@routine
def energies(first, last, points, since, elements, forces, sums):
    """Write energies, and forces on the four corners, of the tetrahedra of the groups `first` to before `last` of SUMMED.
    `since`: Since of newton_arrays.py, of dampers."""
    corners, materials, values = elements
    for group in range(first, last):
        total, unsure = 0.0, 0.0
        for n in range(group * SUMMED, min((group + 1) * SUMMED, len(corners))):
            material, rest, volume = materials[n], rest_of(values, n), values[n, AT_VOLUME]
            f = deformed(points, corners, rest, n)
            r = f if material == HOOKEAN else rotation(f)
            energy_density, p = stress(material, f, r, values[n, AT_MU], values[n, AT_LAME], values[n, AT_ALPHA])
            energy = volume * energy_density
            off = doubt(energy_density, volume, values[n, AT_MU], values[n, AT_LAME], material == HOOKEAN)
            if FEATURE.damped:
                mu, lame = scaled(values[n, AT_DAMPING], since.rate, values[n, AT_MU], values[n, AT_LAME])
                lost, pull = viscous(n, points, f, rest, since, corners, mu, lame)
                p = stressed(p, f, pull)
                energy, off = energy + volume * lost, off + doubt(lost, volume, mu, lame, False)
            g = at_corners(p, rest)
            for corner in unrolled(4):
                (x, y, z), place = g[corner], 3 * corner
                forces[n, place], forces[n, place + 1], forces[n, place + 2] = volume * x, volume * y, volume * z
            total, unsure = total + energy, unsure + off
        sums[0, group], sums[1, group] = total, unsure


@routine
def complete(first, blocks_out):
    """Compute the blocks of the first corner, as the negative sum of the others of the row."""
    for i in range(3):
        for j in range(3):
            m, t = 3 * i + j, 3 * j + i
            b = -((blocks_out[first + 4, m] + blocks_out[first + 5, t]) + blocks_out[first + 6, t])
            c = -((blocks_out[first + 5, m] + blocks_out[first + 7, m]) + blocks_out[first + 8, t])
            d = -((blocks_out[first + 6, m] + blocks_out[first + 8, m]) + blocks_out[first + 9, m])
            blocks_out[first, m], blocks_out[first + 1, m] = -((b + c) + d), b
            blocks_out[first + 2, m], blocks_out[first + 3, m] = c, d


@routine
def blocks(first, last, points, since, elements, safe, blocks_out):
    """Write the tangents of tetrahedra, including dampers, in rows of BLOCKS blocks."""
    corners, materials, values = elements
    for n in range(first * SUMMED, min(last * SUMMED, len(corners))):
        rest = rest_of(values, n)
        f = deformed(points, corners, rest, n)
        s, u, v = frame(f, rotation(f))
        axial, sums, offs = moduli(materials[n], s, values[n, AT_MU], values[n, AT_LAME], values[n, AT_ALPHA], safe)
        weight = values[n, AT_VOLUME]
        xx, xy, xz, yx, yy, yz, zx, zy, zz = rest
        b, c, d = (xx, xy, xz), (yx, yy, yz), (zx, zy, zz)
        if FEATURE.damped:
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
                if FEATURE.damped:
                    h = damped_block(h, f, ff, pull, mu, lame, rows[p], rows[q])
                for m in range(9):
                    blocks_out[place, m] = weight * h[m]
                place += 1
        complete(n * BLOCKS, blocks_out)


@routine
def difference(points, other, k):
    p, q = row(points, k), row(other, k)
    return p[0] - q[0], p[1] - q[1], p[2] - q[2]


@routine
def change(n, points, other, corners, rest):
    """Return F of `points` minus that of `other` points, from differences: in float32 the motion of the whole body
    would otherwise cause spurious strains."""
    a, b, c, d = corners[n, 0], corners[n, 1], corners[n, 2], corners[n, 3]
    return gradient(
        difference(points, other, a), difference(points, other, b), difference(points, other, c),
        difference(points, other, d), rest,
    )  # fmt: skip


@routine
def viscous(n, points, f, rest, since, corners, mu, lame):
    """Return (D, N) of tetrahedron n (model/formulas/elastic/damper.py)."""
    middle = since.middle
    if FEATURE.two_stages and since.second:
        e = increment(f, change(n, points, middle, corners, rest))
        a, b, c, d = corners[n, 0], corners[n, 1], corners[n, 2], corners[n, 3]
        f = gradient(row(middle, a), row(middle, b), row(middle, c), row(middle, d), rest)
        e = beyond(e, increment(f, change(n, middle, since.origin, corners, rest)))
    else:
        e = increment(f, change(n, points, since.before, corners, rest))
    return resisted(e, mu, lame)
