"""Clusters with more than a rotation: the linear map nearest to their particles, and creep. Matrices are 9 numbers by
rows.

M. Mueller et al., "Meshless Deformations Based on Shape Matching", SIGGRAPH 2005, 4.3 and 4.5. With A = sum m (x - c)
rest' and G = (sum m rest rest')^-1, the map is F = A G. Plastically deformed offsets Sp rest have the moments A Sp' and
the map F Sp^-1. Goals are T Sp rest, T from `blended`, relative to the centre; model/assets/clusters.py,
`deformations`, explains why momentum is conserved.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from softlab.model.base.variant import OfPrecision, formula
from softlab.model.formulas.lengths import dot

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

FULLER = 1 / MIN_VOLUME
LEAST = OfPrecision(lambda real: 64 * np.finfo(real).eps)  # smallest volume that is not rounding


@formula
def product(a, b):
    """A B."""
    axx, axy, axz, ayx, ayy, ayz, azx, azy, azz = a
    bxx, bxy, bxz, byx, byy, byz, bzx, bzy, bzz = b
    return (
        dot(axx, axy, axz, bxx, byx, bzx), dot(axx, axy, axz, bxy, byy, bzy), dot(axx, axy, axz, bxz, byz, bzz),
        dot(ayx, ayy, ayz, bxx, byx, bzx), dot(ayx, ayy, ayz, bxy, byy, bzy), dot(ayx, ayy, ayz, bxz, byz, bzz),
        dot(azx, azy, azz, bxx, byx, bzx), dot(azx, azy, azz, bxy, byy, bzy), dot(azx, azy, azz, bxz, byz, bzz),
    )  # fmt: skip


@formula
def symmetric(g):
    """The matrix with the entries (xx, xy, xz, yy, yz, zz)."""
    xx, xy, xz, yy, yz, zz = g
    return xx, xy, xz, xy, yy, yz, xz, yz, zz


@formula
def bent(a, p):
    """Moments with the plastic rest shape Sp rest instead of rest: A Sp'."""
    pxx, pxy, pxz, pyx, pyy, pyz, pzx, pzy, pzz = p
    return product(a, (pxx, pyx, pzx, pxy, pyy, pzy, pxz, pyz, pzz))


@formula
def gradient(a, g):
    """F = A G."""
    return product(a, symmetric(g))


@formula
def minor(a, b, c, d):
    return a * d - b * c


@formula
def determinant(a):
    xx, xy, xz, yx, yy, yz, zx, zy, zz = a
    return (xx * minor(yy, yz, zy, zz) - xy * minor(yx, yz, zx, zz)) + xz * minor(yx, yy, zx, zy)


@formula
def cube_root(volume):
    """Cube root of a number from SMALLEST to LARGEST.

    y = (v y)^(1/4) three times reduces the error of ln y from 9.3 to 0.15; E. Halley's steps, which cube it, reach
    rounding. Roots and quotients alone give the same bits everywhere.
    """
    y = 1.0
    for _ in range(3):
        y = 1.0 * sqrt(1.0 * sqrt(volume * y))  # plain Python's root is a double, which 1 converts back to `real`
    for _ in range(3):
        cube = (y * y) * y
        y = y * ((cube + 2.0 * volume) / (2.0 * cube + volume))
    return y


@formula
def undone(f, p):
    """F Sp^-1, by cofactors; Sp has the volume 1 to rounding."""
    pxx, pxy, pxz, pyx, pyy, pyz, pzx, pzy, pzz = p
    s = 1.0 / determinant(p)
    inverse = (
        s * minor(pyy, pyz, pzy, pzz), s * minor(pxz, pxy, pzz, pzy), s * minor(pxy, pxz, pyy, pyz),
        s * minor(pyz, pyx, pzz, pzx), s * minor(pxx, pxz, pzx, pzz), s * minor(pxz, pxx, pyz, pyx),
        s * minor(pyx, pyy, pzx, pzy), s * minor(pxy, pxx, pzy, pzx), s * minor(pxx, pxy, pyx, pyy),
    )  # fmt: skip
    return product(f, inverse)


@formula
def mixed(a, f, b, r):
    return a * f + b * r


@formula
def blended(f, r, linear):
    """T = b F / cbrt(det F) + (1 - b) R, b = `linear`, which falls to 0 with a volume below MIN_VOLUME. R itself
    where F is flat or mirrored."""
    fxx, fxy, fxz, fyx, fyy, fyz, fzx, fzy, fzz = f
    rxx, rxy, rxz, ryx, ryy, ryz, rzx, rzy, rzz = r
    volume = determinant(f)
    part = linear * min(1.0, FULLER * volume) if volume > 0.0 else 0.0
    a, b = part / cube_root(min(max(volume, SMALLEST), LARGEST)), 1.0 - part
    return (
        mixed(a, fxx, b, rxx), mixed(a, fxy, b, rxy), mixed(a, fxz, b, rxz),
        mixed(a, fyx, b, ryx), mixed(a, fyy, b, ryy), mixed(a, fyz, b, ryz),
        mixed(a, fzx, b, rzx), mixed(a, fzy, b, rzy), mixed(a, fzz, b, rzz),
    )  # fmt: skip


@formula
def away(more, factor, other):
    """Entry of I + k (Sp - I) or of Sp + k E Sp."""
    return more + factor * other


@formula
def with_unit_volume(xx, xy, xz, yx, yy, yz, zx, zy, zz, limit):
    """Return (I + D over the cube root of its volume, 9 numbers; True if that exists), with D shortened to the length
    `limit`."""
    length = sqrt(
        (dot(xx, yy, zz, xx, yy, zz) + dot(xy, xz, yz, xy, xz, yz)) + dot(yx, zx, zy, yx, zx, zy)
    )  # fmt: skip
    k = limit / length if length > limit else 1.0
    xx, xy, xz = away(1.0, k, xx), k * xy, k * xz
    yx, yy, yz = k * yx, away(1.0, k, yy), k * yz
    zx, zy, zz = k * zx, k * zy, away(1.0, k, zz)
    volume = determinant((xx, xy, xz, yx, yy, yz, zx, zy, zz))
    exists = (volume > LEAST) & (volume < LARGEST)
    s = 1.0 / cube_root(volume if exists else 1.0)
    return s * xx, s * xy, s * xz, s * yx, s * yy, s * yz, s * zx, s * zy, s * zz, exists


@formula
def strain(f, r):
    """S - I (xx, xy, xz, yy, yz, zz), S the symmetric part of R' F."""
    fxx, fxy, fxz, fyx, fyy, fyz, fzx, fzy, fzz = f
    rxx, rxy, rxz, ryx, ryy, ryz, rzx, rzy, rzz = r
    return (
        dot(rxx, ryx, rzx, fxx, fyx, fzx) - 1.0,
        0.5 * (dot(rxx, ryx, rzx, fxy, fyy, fzy) + dot(rxy, ryy, rzy, fxx, fyx, fzx)),
        0.5 * (dot(rxx, ryx, rzx, fxz, fyz, fzz) + dot(rxz, ryz, rzz, fxx, fyx, fzx)),
        dot(rxy, ryy, rzy, fxy, fyy, fzy) - 1.0,
        0.5 * (dot(rxy, ryy, rzy, fxz, fyz, fzz) + dot(rxz, ryz, rzz, fxy, fyy, fzy)),
        dot(rxz, ryz, rzz, fxz, fyz, fzz) - 1.0,
    )  # fmt: skip


@formula
def crept(e, p, threshold, rate, limit):
    """Sp after an iteration: (I + `rate` E) Sp where the strain E exceeds `threshold`, limited to `limit`, with
    its volume unchanged. Below the threshold it is Sp itself, to the bit. Lengths are Frobenius norms."""
    exx, exy, exz, eyy, eyz, ezz = e
    pxx, pxy, pxz, pyx, pyy, pyz, pzx, pzy, pzz = p
    length = sqrt(dot(exx, eyy, ezz, exx, eyy, ezz) + 2.0 * dot(exy, exz, eyz, exy, exz, eyz))
    mxx, mxy, mxz, myx, myy, myz, mzx, mzy, mzz = product(symmetric(e), p)
    xx, xy, xz, yx, yy, yz, zx, zy, zz, exists = with_unit_volume(
        away(pxx, rate, mxx) - 1.0, away(pxy, rate, mxy), away(pxz, rate, mxz), away(pyx, rate, myx),
        away(pyy, rate, myy) - 1.0, away(pyz, rate, myz), away(pzx, rate, mzx), away(pzy, rate, mzy),
        away(pzz, rate, mzz) - 1.0, limit,
    )  # fmt: skip
    go = exists & (length > threshold) & (rate > 0.0)
    return (
        xx if go else pxx, xy if go else pxy, xz if go else pxz,
        yx if go else pyx, yy if go else pyy, yz if go else pyz,
        zx if go else pzx, zy if go else pzy, zz if go else pzz,
    )  # fmt: skip
