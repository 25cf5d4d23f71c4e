"""The matrix of Newton's method on CPU threads, by groups of rows: assembly from tetrahedra, and products with a
vector. newton_arrays.py describes `rows` and `matrix`."""

from __future__ import annotations

from softlab.cpu_backend.tetrahedra.newton_contact import nearly_within
from softlab.model.base.variant import FEATURE, routine, unrolled
from softlab.model.formulas.elastic.newton import inertia_of, inverse, outer
from softlab.model.tetrahedra.newton import SUMMED

AXES = 3


@routine
def assemble(first, last, number, position, target, before, rows, matrix, inputs, sums):
    """Assemble the rows of the matrix and the inverses of their diagonal blocks; sums[0]: how many of these are not
    positive."""
    starts, diagonal = rows.starts, rows.diagonal
    blocks, inverses = matrix.blocks, matrix.inverses
    parameters = inputs.parameters
    for group in range(first, last):
        bad = 0.0
        for k in range(group * SUMMED, min((group + 1) * SUMMED, len(diagonal))):
            if before[k, 3] == 0.0:
                continue
            for n in range(starts[k], starts[k + 1]):
                sum_block(n, rows, matrix.element_blocks, blocks)
            n, inertia = diagonal[k], inertia_of(parameters.newton_inertia, before[k, 3])
            for axis in range(AXES):
                blocks[n, 4 * axis] = blocks[n, 4 * axis] + inertia
            if FEATURE.colliders:
                x, y, z, hard = nearly_within(
                    k, number, position, target, before, matrix.stiffness, (parameters, inputs.bodies, inputs.kinds)
                )
                a, b, c, d, e, f = outer(x, y, z, hard)
                blocks[n, 0], blocks[n, 4], blocks[n, 8] = blocks[n, 0] + a, blocks[n, 4] + d, blocks[n, 8] + f
                blocks[n, 1], blocks[n, 3] = blocks[n, 1] + b, blocks[n, 3] + b
                blocks[n, 2], blocks[n, 6] = blocks[n, 2] + c, blocks[n, 6] + c
                blocks[n, 5], blocks[n, 7] = blocks[n, 5] + e, blocks[n, 7] + e
            inverted = inverse(blocks[n, 0], blocks[n, 1], blocks[n, 2], blocks[n, 4], blocks[n, 5], blocks[n, 8])
            for m in unrolled(6):
                inverses[k, m] = inverted[m]
            if not inverted[-1]:
                bad = bad + 1.0
        sums[0, group] = bad


@routine
def apply(k, rows, blocks, vector):
    """Return the product of one row of the matrix with a vector, three numbers."""
    starts, columns = rows.starts, rows.columns
    x, y, z = 0.0, 0.0, 0.0
    for n in range(starts[k], starts[k + 1]):
        c = columns[n]
        p, q, r = vector[c, 0], vector[c, 1], vector[c, 2]
        x = x + ((blocks[n, 0] * p + blocks[n, 1] * q) + blocks[n, 2] * r)
        y = y + ((blocks[n, 3] * p + blocks[n, 4] * q) + blocks[n, 5] * r)
        z = z + ((blocks[n, 6] * p + blocks[n, 7] * q) + blocks[n, 8] * r)
    return x, y, z


@routine
def sum_block(n, rows, element_blocks, into):
    """Write block `n` of the rows: the sum over its tetrahedra and springs."""
    sources, items = rows.sources, rows.items
    for m in range(9):
        into[n, m] = 0
    for one_of in range(sources[n], sources[n + 1]):
        item = items[one_of]
        place = item >> 1
        if item & 1:
            for i in range(AXES):
                for j in range(AXES):
                    into[n, 3 * i + j] = into[n, 3 * i + j] + element_blocks[place, 3 * j + i]
        else:
            for m in range(9):
                into[n, m] = into[n, m] + element_blocks[place, m]
