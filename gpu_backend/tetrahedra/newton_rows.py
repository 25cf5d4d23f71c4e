"""Operations of Newton's method on one particle, on CUDA: its row of the matrix, and its part of each pass over
particles.

As cpu_backend/tetrahedra/newton_rows.py. Vectors are quads; those of a pinned particle stay zero.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np

from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.gpu_backend.tetrahedra.newton_contact import make_contact
from softlab.gpu_backend.tetrahedra.newton_elements import make_block_access
from softlab.gpu_backend.tetrahedra.springs import make_pulled
from softlab.model.base.types import Real
from softlab.model.formulas.elastic import descent, newton, solving
from softlab.model.formulas.elastic.newton import AHEAD, CORRECT, DIRECTION, MOVE, PRODUCT, RETURN, SOLVE, UPDATE
from softlab.model.tetrahedra.springs import PARTS


@cache
def make_rows(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make `gather`, `apply` and `settle_row`.

    `gather(n, rows, element_blocks)`: block n of the rows, summed over its tetrahedra and springs; `apply(k, rows, blocks,
    vector)`: a row's product; `settle_row(k, particles, solver, world, number)`: the row's diagonal and its
    inverse: 1 if that is not positive, else 0.
    """
    inline, formulas = inlined(math), device_formulas(newton, real, math)
    inertia_of, inverse, outer = formulas.inertia_of, formulas.inverse, formulas.outer
    applied = device_formulas(descent, real, math).times
    access, contact = make_block_access(math), make_contact(real, math, parts)
    load_block, store_block, transposed, added = access.load_block, access.store_block, access.transposed, access.added
    has_bodies, nearly_within = contact.has_bodies, contact.nearly_within
    zero, one, next_one = real(0), real(1), np.int32(1)

    @inline
    def gather(n, rows, element_blocks):
        s = zero, zero, zero, zero, zero, zero, zero, zero, zero
        for place in range(rows.sources[n], rows.sources[n + next_one]):
            item = rows.items[place]
            m = load_block(element_blocks, np.int32(item >> 1))
            if item & 1:
                m = transposed(m)
            s = added(s, m)
        return s

    @inline
    def apply(k, rows, blocks, vector):
        x, y, z = zero, zero, zero
        for n in range(rows.starts[k], rows.starts[k + next_one]):
            d = load_quad(vector, rows.columns[n])
            p, q, r = applied(load_block(blocks, n), d[0], d[1], d[2])
            x, y, z = x + p, y + q, z + r
        return x, y, z

    @inline
    def settle_row(k, particles, solver, world, number):
        v, matrix = solver.vectors, solver.matrix
        b, n = load_quad(v.before, k), solver.rows.diagonal[k]
        bad = zero
        if b[3] != zero:
            inertia, m = inertia_of(world.parameters.newton_inertia, b[3]), load_block(matrix.blocks, n)
            xx, xy, xz = m[0] + inertia, m[1], m[2]
            yx, yy, yz = m[3], m[4] + inertia, m[5]
            zx, zy, zz = m[6], m[7], m[8] + inertia
            if has_bodies:
                x, y, z, hard = nearly_within(
                    b, load_quad(v.position, k), load_quad(v.target, k), matrix.stiffness[k], world, number
                )
                s, t, u, p, q, r = outer(x, y, z, hard)
                xx, xy, xz, yx, yy, yz = xx + s, xy + t, xz + u, yx + t, yy + p, yz + q
                zx, zy, zz = zx + u, zy + q, zz + r
            store_block(matrix.blocks, n, (xx, xy, xz, yx, yy, yz, zx, zy, zz))
            s, t, u, p, q, r, good = inverse(xx, xy, xz, yy, yz, zz)
            store_six(matrix.inverses, particles, k, s, t, u, p, q, r)
            if not good:
                bad = one
        return bad

    @inline
    def store_six(array, count, k, a, b, c, d, e, f):
        array[k], array[count + k], array[2 * count + k] = a, b, c
        array[3 * count + k], array[4 * count + k], array[5 * count + k] = d, e, f

    return SimpleNamespace(gather=gather, apply=apply, settle_row=settle_row)


@cache
def make_solving(real: Real, math: str, apply: Callable) -> Callable:
    """Make solving(kind, k, particles, solver, added, alpha, beta): particle k's summand in that pass of
    conjugate gradients; `added`: the coarse level's correction of the residual there."""
    inline, moved = inlined(math), device_formulas(newton, real, math).moved
    products, zero = device_formulas(solving, real, math), real(0)
    preconditioned, dot, load_six = products.preconditioned, products.dot, make_block_access(math).load_six

    @inline
    def moved_3(a, fraction, b):
        return moved(a[0], fraction, b[0]), moved(a[1], fraction, b[1]), moved(a[2], fraction, b[2])

    @inline
    def solve(kind, k, particles, solver, added, alpha, beta):
        v, matrix, total = solver.vectors, solver.matrix, zero
        if kind == PRODUCT:
            x, y, z = apply(k, solver.rows, matrix.blocks, v.direction)
            store_quad(v.product, k, x, y, z, zero)
            d = load_quad(v.direction, k)
            total = dot(d[0], d[1], d[2], x, y, z)
        elif kind == UPDATE:
            d, q = load_quad(v.direction, k), load_quad(v.product, k)
            x, y, z = moved_3(load_quad(v.solution, k), alpha, d)
            store_quad(v.solution, k, x, y, z, zero)
            x, y, z = moved_3(load_quad(v.residual, k), -alpha, q)
            store_quad(v.residual, k, x, y, z, zero)
        elif kind == CORRECT:
            r = load_quad(v.residual, k)
            x, y, z = preconditioned(load_six(matrix.inverses, k, particles), r[0], r[1], r[2])
            x, y, z = x + added[0], y + added[1], z + added[2]
            store_quad(v.better, k, x, y, z, zero)
            total = dot(r[0], r[1], r[2], x, y, z)
        elif kind == DIRECTION:
            x, y, z = moved_3(load_quad(v.better, k), beta, load_quad(v.direction, k))
            store_quad(v.direction, k, x, y, z, zero)
        return total

    return solve


@cache
def make_moving(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make `weigh(k, solver, world, number)`, the potential's gradient at particle k and its energy without
    tetrahedra, and `move(kind, k, v, fraction)`, the passes that only move it, with its summand in MOVE."""
    inline, formulas = inlined(math), device_formulas(newton, real, math)
    products = device_formulas(solving, real, math)
    inertia_of, inertial_energy, moved = formulas.inertia_of, formulas.inertial_energy, formulas.moved
    scaled, dot, contact = products.scaled, products.dot, make_contact(real, math, parts)
    has_bodies, within, zero, next_one = contact.has_bodies, contact.within, real(0), np.int32(1)
    pulled, sprung = make_pulled(real, math), bool(parts & PARTS)

    @inline
    def weigh(k, solver, world, number):
        v, rows, matrix = solver.vectors, solver.rows, solver.matrix
        b, at, target = load_quad(v.before, k), load_quad(v.position, k), load_quad(v.target, k)
        parameters = world.parameters
        inertia = inertia_of(parameters.newton_inertia, b[3])
        x, y, z = at[0] - target[0], at[1] - target[1], at[2] - target[2]
        total = inertial_energy(inertia, x, y, z)
        x, y, z = scaled(inertia, x, y, z)
        for n in range(rows.meets[k], rows.meets[k + next_one]):
            f = load_quad(matrix.forces, rows.corners[n])
            x, y, z = x + f[0], y + f[1], z + f[2]
        if sprung:
            p, q, r, _, spring_energy = pulled(k, v.position, solver.springs)
            total, x, y, z = total + spring_energy, x + p, y + q, z + r
        if has_bodies:
            p, q, r, hard = within(b, at, matrix.stiffness[k], world, number)
            total = total + inertial_energy(hard, p, q, r)
            x, y, z = moved(x, hard, p), moved(y, hard, q), moved(z, hard, r)
        store_quad(v.trial, k, x, y, z, zero)
        return total

    @inline
    def put(k, v, b, x, y, z):
        store_quad(v.position, k, x, y, z, b[3])

    @inline
    def move(kind, k, v, fraction):
        b, total = load_quad(v.before, k), zero
        if kind == MOVE:
            c, s, g = load_quad(v.current, k), load_quad(v.solution, k), load_quad(v.gradient, k)
            put(k, v, b, moved(c[0], fraction, s[0]), moved(c[1], fraction, s[1]), moved(c[2], fraction, s[2]))
            total = dot(g[0], g[1], g[2], s[0], s[1], s[2])
        elif kind == SOLVE:
            g = load_quad(v.gradient, k)
            store_quad(v.solution, k, zero, zero, zero, zero)
            store_quad(v.residual, k, -g[0], -g[1], -g[2], zero)
            store_quad(v.direction, k, zero, zero, zero, zero)
        elif kind == RETURN:
            c = load_quad(v.current, k)
            put(k, v, b, c[0], c[1], c[2])
        elif kind == AHEAD:
            c = load_quad(v.target, k)
            put(k, v, b, c[0], c[1], c[2])
        else:
            p, g = load_quad(v.position, k), load_quad(v.trial, k)
            store_quad(v.current, k, p[0], p[1], p[2], zero)
            store_quad(v.gradient, k, g[0], g[1], g[2], zero)
        return total

    return SimpleNamespace(weigh=weigh, move=move)
