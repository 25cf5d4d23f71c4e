"""Operations of Newton's method on one particle, on CUDA: its row of the matrix, and its part of each pass over
particles.

As cpu_backend/tetrahedra/newton_rows.py. Vectors are quads; those of a pinned particle stay zero.
"""

from __future__ import annotations

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.gpu_backend.tetrahedra.newton_coarse import corrected
from softlab.gpu_backend.tetrahedra.newton_contact import nearly_within, within
from softlab.gpu_backend.tetrahedra.newton_elements import added, load_block, load_six, store_block, transposed
from softlab.gpu_backend.tetrahedra.springs import pulled
from softlab.model.base.variant import FEATURE, inlined_routine, unrolled
from softlab.model.formulas.elastic.deformation import times
from softlab.model.formulas.elastic.newton import inertia_of, inertial_energy, inverse, moved, outer
from softlab.model.formulas.elastic.solving import dot, preconditioned, scaled
from softlab.model.tetrahedra.newton import SUMMED


@inlined_routine
def block_of(n, rows, element_blocks):
    """Return block n of the rows: the sum over its tetrahedra and springs."""
    s = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for place in range(rows.sources[n], rows.sources[n + 1]):
        item = rows.items[place]
        m = load_block(element_blocks, np.int32(item >> 1))
        if item & 1:
            m = transposed(m)
        s = added(s, m)
    return s


@inlined_routine
def assemble(group, particles, rows, matrix):
    """Write the rows of SUMMED particles, the sums of the blocks of their tetrahedra, for a block of threads."""
    t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
    first = np.int32(group * SUMMED)
    last = np.int32(min(np.int32(first + SUMMED), particles))
    for n in range(rows.starts[first] + t, rows.starts[last], threads):
        store_block(matrix.blocks, n, block_of(n, rows, matrix.element_blocks))
    cuda.syncthreads()


@inlined_routine
def apply(k, rows, blocks, vector):
    """Return a row's product with a vector."""
    x, y, z = 0.0, 0.0, 0.0
    for n in range(rows.starts[k], rows.starts[k + 1]):
        d = load_quad(vector, rows.columns[n])
        p, q, r = times(load_block(blocks, n), d[0], d[1], d[2])
        x, y, z = x + p, y + q, z + r
    return x, y, z


@inlined_routine
def settle_row(k, particles, solver, world, number):
    """Write the row's diagonal block and its inverse. Returns 1 if that is not positive, else 0."""
    v, matrix = solver.vectors, solver.matrix
    b, n = load_quad(v.before, k), solver.rows.diagonal[k]
    bad = 0.0
    if b[3] != 0.0:
        inertia, m = inertia_of(world.parameters.newton_inertia, b[3]), load_block(matrix.blocks, n)
        xx, xy, xz = m[0] + inertia, m[1], m[2]
        yx, yy, yz = m[3], m[4] + inertia, m[5]
        zx, zy, zz = m[6], m[7], m[8] + inertia
        if FEATURE.colliders:
            x, y, z, hard = nearly_within(
                b, load_quad(v.position, k), load_quad(v.target, k), matrix.stiffness[k], world, number
            )
            s, t, u, p, q, r = outer(x, y, z, hard)
            xx, xy, xz, yx, yy, yz = xx + s, xy + t, xz + u, yx + t, yy + p, yz + q
            zx, zy, zz = zx + u, zy + q, zz + r
        store_block(matrix.blocks, n, (xx, xy, xz, yx, yy, yz, zx, zy, zz))
        inverted = inverse(xx, xy, xz, yy, yz, zz)
        for n in unrolled(6):
            matrix.inverses[n * particles + k] = inverted[n]
        if not inverted[-1]:
            bad = 1.0
    return bad


@inlined_routine
def moved_3(a, fraction, b):
    return moved(a[0], fraction, b[0]), moved(a[1], fraction, b[1]), moved(a[2], fraction, b[2])


@inlined_routine
def weigh(k, solver, world, number):
    """Write the potential's gradient at particle k. Returns its energy without tetrahedra."""
    v, rows, matrix = solver.vectors, solver.rows, solver.matrix
    b, at, target = load_quad(v.before, k), load_quad(v.position, k), load_quad(v.target, k)
    parameters = world.parameters
    inertia = inertia_of(parameters.newton_inertia, b[3])
    x, y, z = at[0] - target[0], at[1] - target[1], at[2] - target[2]
    total = inertial_energy(inertia, x, y, z)
    x, y, z = scaled(inertia, x, y, z)
    for n in range(rows.corner_starts[k], rows.corner_starts[k + 1]):
        f = load_quad(matrix.forces, rows.corners[n])
        x, y, z = x + f[0], y + f[1], z + f[2]
    if FEATURE.springs:
        p, q, r, _, spring_energy = pulled(k, v.position, solver.springs)
        total, x, y, z = total + spring_energy, x + p, y + q, z + r
    if FEATURE.colliders:
        p, q, r, hard = within(b, at, matrix.stiffness[k], world, number)
        total = total + inertial_energy(hard, p, q, r)
        x, y, z = moved(x, hard, p), moved(y, hard, q), moved(z, hard, r)
    store_quad(v.trial, k, x, y, z, 0.0)
    return total


@inlined_routine
def begin_solve(k, v):
    """Start conjugate gradients at particle k."""
    g = load_quad(v.gradient, k)
    store_quad(v.solution, k, 0.0, 0.0, 0.0, 0.0)
    store_quad(v.residual, k, -g[0], -g[1], -g[2], 0.0)
    store_quad(v.direction, k, 0.0, 0.0, 0.0, 0.0)


@inlined_routine
def multiply(k, rows, blocks, v):
    """Write the product of the matrix with the direction. Returns its scalar product with the direction."""
    x, y, z = apply(k, rows, blocks, v.direction)
    store_quad(v.product, k, x, y, z, 0.0)
    d = load_quad(v.direction, k)
    return dot(d[0], d[1], d[2], x, y, z)


@inlined_routine
def update(k, v, alpha):
    """Update solution and residual by a step along the direction."""
    d, q = load_quad(v.direction, k), load_quad(v.product, k)
    x, y, z = moved_3(load_quad(v.solution, k), alpha, d)
    store_quad(v.solution, k, x, y, z, 0.0)
    x, y, z = moved_3(load_quad(v.residual, k), -alpha, q)
    store_quad(v.residual, k, x, y, z, 0.0)


@inlined_routine
def precondition(k, particles, solver):
    """Write the preconditioned residual, by both levels. Returns its scalar product with the residual."""
    v = solver.vectors
    p, q, s = corrected(k, solver)
    r = load_quad(v.residual, k)
    x, y, z = preconditioned(load_six(solver.matrix.inverses, k, particles), r[0], r[1], r[2])
    x, y, z = x + p, y + q, z + s
    store_quad(v.preconditioned, k, x, y, z, 0.0)
    return dot(r[0], r[1], r[2], x, y, z)


@inlined_routine
def turn(k, v, beta):
    """Write the next direction."""
    x, y, z = moved_3(load_quad(v.preconditioned, k), beta, load_quad(v.direction, k))
    store_quad(v.direction, k, x, y, z, 0.0)


@inlined_routine
def put(k, v, source):
    """Set the position to `source`."""
    c = load_quad(source, k)
    store_quad(v.position, k, c[0], c[1], c[2], load_quad(v.before, k)[3])


@inlined_routine
def accept(k, v):
    """Store position and gradient of the accepted state."""
    p, g = load_quad(v.position, k), load_quad(v.trial, k)
    store_quad(v.current, k, p[0], p[1], p[2], 0.0)
    store_quad(v.gradient, k, g[0], g[1], g[2], 0.0)


@inlined_routine
def move(k, v, fraction):
    """Set the position to a fraction of the step. Returns the descent that the slope predicts of the whole step."""
    c, s, g = load_quad(v.current, k), load_quad(v.solution, k), load_quad(v.gradient, k)
    x, y, z = moved(c[0], fraction, s[0]), moved(c[1], fraction, s[1]), moved(c[2], fraction, s[2])
    store_quad(v.position, k, x, y, z, load_quad(v.before, k)[3])
    return dot(g[0], g[1], g[2], s[0], s[1], s[2])
