"""Clusters with more than a rotation: the linear map nearest to their particles, and creep. Matrices are 9 numbers by
rows.

M. Mueller et al., "Meshless Deformations Based on Shape Matching", SIGGRAPH 2005, 4.3 and 4.5. With A = sum m (x - c)
rest' and G = (sum m rest rest')^-1, the map is F = A G. Plastically deformed offsets Sp rest have the moments A Sp' and
the map F Sp^-1. Goals are T Sp rest, T from `blended`, relative to the centre; model/assets/clusters.py,
`deformations`, explains why momentum is conserved.
"""

from __future__ import annotations

from math import sqrt
from types import SimpleNamespace

import numpy as np

from softlab.model.formulas import joined, plain
from softlab.model.formulas.lengths import make as make_lengths

# Fraction of the volume at rest below which the linear map's weight falls to 0 with the volume. 1 / cbrt(det F)
# stretches what is already long: a crushed body that cannot regain its volume would spread sideways, ever faster.
MIN_VOLUME = 0.5
# A cluster's constants: see model/shape_matching/cluster_tables.py, `shape_table`.
SHAPE = 12  # numbers: three quads
S_INVERSE, S_LINEAR, S_THRESHOLD, S_CREEP, S_LIMIT = 0, 6, 7, 8, 9

# Counted as in rotation.py.
OPERATIONS_GRADIENT = 45
OPERATIONS_LINEAR = 94  # of a cluster, in addition
OPERATIONS_PLASTIC = 92 + 45 + 45 + 215  # `undone`, moments, goals, creep

SMALLEST, LARGEST = 1e-12, 1e12  # volumes between which the cube root is accurate to rounding


def make(real, compiled=plain):
    """Make the functions of deformation and creep in the arithmetic `real`."""
    zero, one, two, fuller = real(0), real(1), real(2), real(1 / MIN_VOLUME)
    smallest, largest, dot = real(SMALLEST), real(LARGEST), make_lengths(real, compiled).dot

    @compiled
    def product(a, b):
        """A B."""
        axx, axy, axz, ayx, ayy, ayz, azx, azy, azz = a
        bxx, bxy, bxz, byx, byy, byz, bzx, bzy, bzz = b
        return (
            dot(axx, axy, axz, bxx, byx, bzx), dot(axx, axy, axz, bxy, byy, bzy), dot(axx, axy, axz, bxz, byz, bzz),
            dot(ayx, ayy, ayz, bxx, byx, bzx), dot(ayx, ayy, ayz, bxy, byy, bzy), dot(ayx, ayy, ayz, bxz, byz, bzz),
            dot(azx, azy, azz, bxx, byx, bzx), dot(azx, azy, azz, bxy, byy, bzy), dot(azx, azy, azz, bxz, byz, bzz),
        )  # fmt: skip

    @compiled
    def symmetric(g):
        """The matrix with the entries (xx, xy, xz, yy, yz, zz)."""
        xx, xy, xz, yy, yz, zz = g
        return xx, xy, xz, xy, yy, yz, xz, yz, zz

    @compiled
    def bent(a, p):
        """Moments with Sp rest in place of rest: A Sp'."""
        pxx, pxy, pxz, pyx, pyy, pyz, pzx, pzy, pzz = p
        return product(a, (pxx, pyx, pzx, pxy, pyy, pzy, pxz, pyz, pzz))

    @compiled
    def gradient(a, g):
        """F = A G."""
        return product(a, symmetric(g))

    @compiled
    def minor(a, b, c, d):
        return a * d - b * c

    @compiled
    def determinant(a):
        xx, xy, xz, yx, yy, yz, zx, zy, zz = a
        return (xx * minor(yy, yz, zy, zz) - xy * minor(yx, yz, zx, zz)) + xz * minor(yx, yy, zx, zy)

    @compiled
    def cube_root(volume):
        """Cube root of a number from SMALLEST to LARGEST.

        y = (v y)^(1/4) three times reduces the error of ln y from 9.3 to 0.15; E. Halley's steps, which cube it, reach
        rounding. Roots and quotients alone give the same bits everywhere.
        """
        y = one
        for _ in range(3):
            y = one * sqrt(one * sqrt(volume * y))  # plain Python's root is a double, which 1 converts back to `real`
        for _ in range(3):
            cube = (y * y) * y
            y = y * ((cube + two * volume) / (two * cube + volume))
        return y

    @compiled
    def undone(f, p):
        """F Sp^-1, by cofactors; Sp has the volume 1 to rounding."""
        pxx, pxy, pxz, pyx, pyy, pyz, pzx, pzy, pzz = p
        s = one / determinant(p)
        inverse = (
            s * minor(pyy, pyz, pzy, pzz), s * minor(pxz, pxy, pzz, pzy), s * minor(pxy, pxz, pyy, pyz),
            s * minor(pyz, pyx, pzz, pzx), s * minor(pxx, pxz, pzx, pzz), s * minor(pxz, pxx, pyz, pyx),
            s * minor(pyx, pyy, pzx, pzy), s * minor(pxy, pxx, pzy, pzx), s * minor(pxx, pxy, pyx, pyy),
        )  # fmt: skip
        return product(f, inverse)

    @compiled
    def mixed(a, f, b, r):
        return a * f + b * r

    @compiled
    def blended(f, r, linear):
        """T = b F / cbrt(det F) + (1 - b) R, b = `linear`, which falls to 0 with a volume below MIN_VOLUME. R itself
        where F is flat or mirrored."""
        fxx, fxy, fxz, fyx, fyy, fyz, fzx, fzy, fzz = f
        rxx, rxy, rxz, ryx, ryy, ryz, rzx, rzy, rzz = r
        volume = determinant(f)
        part = linear * min(one, fuller * volume) if volume > zero else zero
        a, b = part / cube_root(min(max(volume, smallest), largest)), one - part
        return (
            mixed(a, fxx, b, rxx), mixed(a, fxy, b, rxy), mixed(a, fxz, b, rxz),
            mixed(a, fyx, b, ryx), mixed(a, fyy, b, ryy), mixed(a, fyz, b, ryz),
            mixed(a, fzx, b, rzx), mixed(a, fzy, b, rzy), mixed(a, fzz, b, rzz),
        )  # fmt: skip

    maps = SimpleNamespace(
        product=product, bent=bent, gradient=gradient, determinant=determinant, cube_root=cube_root, undone=undone,
        blended=blended, symmetric=symmetric,
    )  # fmt: skip
    return joined(maps, make_creep(real, compiled, maps, dot))


def make_creep(real, compiled, maps, dot):
    """Make `strain` and `crept` in the arithmetic `real`."""
    zero, half, one, two, largest = real(0), real(0.5), real(1), real(2), real(LARGEST)
    least = real(64 * np.finfo(real).eps)  # smallest volume that is not rounding
    product, determinant, cube_root, symmetric = maps.product, maps.determinant, maps.cube_root, maps.symmetric

    @compiled
    def away(more, factor, other):
        """Entry of I + k (Sp - I) or of Sp + k E Sp."""
        return more + factor * other

    @compiled
    def with_unit_volume(xx, xy, xz, yx, yy, yz, zx, zy, zz, limit):
        """(I + D over the cube root of its volume, 9 numbers; True if that exists), with D shortened to the length
        `limit`."""
        length = sqrt(
            (dot(xx, yy, zz, xx, yy, zz) + dot(xy, xz, yz, xy, xz, yz)) + dot(yx, zx, zy, yx, zx, zy)
        )  # fmt: skip
        k = limit / length if length > limit else one
        xx, xy, xz = away(one, k, xx), k * xy, k * xz
        yx, yy, yz = k * yx, away(one, k, yy), k * yz
        zx, zy, zz = k * zx, k * zy, away(one, k, zz)
        volume = determinant((xx, xy, xz, yx, yy, yz, zx, zy, zz))
        exists = (volume > least) & (volume < largest)
        s = one / cube_root(volume if exists else one)
        return s * xx, s * xy, s * xz, s * yx, s * yy, s * yz, s * zx, s * zy, s * zz, exists

    @compiled
    def strain(f, r):
        """S - I (xx, xy, xz, yy, yz, zz), S the symmetric part of R' F."""
        fxx, fxy, fxz, fyx, fyy, fyz, fzx, fzy, fzz = f
        rxx, rxy, rxz, ryx, ryy, ryz, rzx, rzy, rzz = r
        return (
            dot(rxx, ryx, rzx, fxx, fyx, fzx) - one,
            half * (dot(rxx, ryx, rzx, fxy, fyy, fzy) + dot(rxy, ryy, rzy, fxx, fyx, fzx)),
            half * (dot(rxx, ryx, rzx, fxz, fyz, fzz) + dot(rxz, ryz, rzz, fxx, fyx, fzx)),
            dot(rxy, ryy, rzy, fxy, fyy, fzy) - one,
            half * (dot(rxy, ryy, rzy, fxz, fyz, fzz) + dot(rxz, ryz, rzz, fxy, fyy, fzy)),
            dot(rxz, ryz, rzz, fxz, fyz, fzz) - one,
        )  # fmt: skip

    @compiled
    def crept(e, p, threshold, rate, limit):
        """Sp after an iteration: (I + `rate` E) Sp where the strain E exceeds `threshold`, limited to `limit`, with
        its volume unchanged. Below the threshold it is Sp itself, to the bit. Lengths are Frobenius norms."""
        exx, exy, exz, eyy, eyz, ezz = e
        pxx, pxy, pxz, pyx, pyy, pyz, pzx, pzy, pzz = p
        length = sqrt(dot(exx, eyy, ezz, exx, eyy, ezz) + two * dot(exy, exz, eyz, exy, exz, eyz))
        mxx, mxy, mxz, myx, myy, myz, mzx, mzy, mzz = product(symmetric(e), p)
        xx, xy, xz, yx, yy, yz, zx, zy, zz, exists = with_unit_volume(
            away(pxx, rate, mxx) - one, away(pxy, rate, mxy), away(pxz, rate, mxz), away(pyx, rate, myx),
            away(pyy, rate, myy) - one, away(pyz, rate, myz), away(pzx, rate, mzx), away(pzy, rate, mzy),
            away(pzz, rate, mzz) - one, limit,
        )  # fmt: skip
        go = exists & (length > threshold) & (rate > zero)
        return (
            xx if go else pxx, xy if go else pxy, xz if go else pxz,
            yx if go else pyx, yy if go else pyy, yz if go else pyz,
            zx if go else pzx, zy if go else pzy, zz if go else pzz,
        )  # fmt: skip

    return SimpleNamespace(strain=strain, crept=crept)
