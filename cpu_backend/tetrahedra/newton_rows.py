"""Operations of Newton's method on particles, by groups, on CPU threads: each particle sums its own row, in one order.

newton_arrays.py describes the arrays.
"""

from __future__ import annotations

from softlab.cpu_backend.tetrahedra.newton_coarse import corrected
from softlab.cpu_backend.tetrahedra.newton_contact import within
from softlab.cpu_backend.tetrahedra.newton_matrix import AXES, apply
from softlab.cpu_backend.tetrahedra.springs import pulled
from softlab.model.base.variant import FEATURE, routine
from softlab.model.formulas.elastic.newton import inertia_of, inertial_energy, moved
from softlab.model.tetrahedra.newton import SUMMED


@routine
def dot(a, b, k):
    return (a[k, 0] * b[k, 0] + a[k, 1] * b[k, 1]) + a[k, 2] * b[k, 2]


@routine
def precondition(k, inverses, residual, into):
    x, y, z = residual[k, 0], residual[k, 1], residual[k, 2]
    into[k, 0] = (inverses[k, 0] * x + inverses[k, 1] * y) + inverses[k, 2] * z
    into[k, 1] = (inverses[k, 1] * x + inverses[k, 3] * y) + inverses[k, 4] * z
    into[k, 2] = (inverses[k, 2] * x + inverses[k, 4] * y) + inverses[k, 5] * z


@routine
def start(first, last, before, vectors):
    """Begin a solve of conjugate gradients."""
    gradient, solution = vectors.gradient, vectors.solution
    residual, direction = vectors.residual, vectors.direction
    for k in range(first * SUMMED, min(last * SUMMED, len(before))):
        for axis in range(AXES):
            solution[k, axis] = 0.0
            residual[k, axis] = -gradient[k, axis] if before[k, 3] > 0.0 else 0.0
            direction[k, axis] = 0.0


@routine
def product(first, last, before, rows, vectors, matrix, sums):
    """Write the product of the matrix with the direction."""
    direction, into = vectors.direction, vectors.product
    for group in range(first, last):
        total = 0.0
        for k in range(group * SUMMED, min((group + 1) * SUMMED, len(before))):
            if before[k, 3] > 0.0:
                x, y, z = apply(k, rows, matrix.blocks, direction)
                into[k, 0], into[k, 1], into[k, 2] = x, y, z
                total = total + dot(direction, into, k)
        sums[0, group] = total


@routine
def update(first, last, alpha, before, vectors):
    """Update solution and residual by a step along the direction."""
    solution, residual = vectors.solution, vectors.residual
    direction, applied = vectors.direction, vectors.product
    for k in range(first * SUMMED, min(last * SUMMED, len(before))):
        if before[k, 3] > 0.0:
            for axis in range(AXES):
                solution[k, axis] = solution[k, axis] + alpha * direction[k, axis]
                residual[k, axis] = residual[k, axis] - alpha * applied[k, axis]


@routine
def correct(first, last, position, before, vectors, matrix, groups, coarse, sums):
    """Precondition the residual with both levels."""
    residual, into = vectors.residual, vectors.product
    for group in range(first, last):
        total = 0.0
        for k in range(group * SUMMED, min((group + 1) * SUMMED, len(before))):
            if before[k, 3] > 0.0:
                precondition(k, matrix.inverses, residual, into)
                x, y, z = corrected(k, position, groups, coarse)
                into[k, 0], into[k, 1], into[k, 2] = into[k, 0] + x, into[k, 1] + y, into[k, 2] + z
                total = total + dot(residual, into, k)
        sums[0, group] = total


@routine
def direct(first, last, beta, vectors):
    """Write the next direction."""
    direction, preconditioned = vectors.direction, vectors.product
    for k in range(first * SUMMED, min(last * SUMMED, len(direction))):
        for axis in range(AXES):
            direction[k, axis] = preconditioned[k, axis] + beta * direction[k, axis]


@routine
def weigh(first, last, number, position, before, inputs, solver):
    """Write the potential's gradient at the positions, and its energy besides that of tetrahedra."""
    rows, vectors, matrix, sums = solver.rows, solver.vectors, solver.matrix, solver.sums
    target, gradient, parameters = vectors.target, vectors.trial, inputs.parameters
    offsets, corners, forces = rows.corner_starts, rows.corners, matrix.forces
    for group in range(first, last):
        total = 0.0
        for k in range(group * SUMMED, min((group + 1) * SUMMED, len(position))):
            if before[k, 3] == 0.0:
                continue
            inertia = inertia_of(parameters.newton_inertia, before[k, 3])
            x, y, z = position[k, 0] - target[k, 0], position[k, 1] - target[k, 1], position[k, 2] - target[k, 2]
            energy = inertial_energy(inertia, x, y, z)
            x, y, z = inertia * x, inertia * y, inertia * z
            for n in range(offsets[k], offsets[k + 1]):
                tetrahedron, corner = corners[n] >> 2, AXES * (corners[n] & 3)
                x = x + forces[tetrahedron, corner]
                y = y + forces[tetrahedron, corner + 1]
                z = z + forces[tetrahedron, corner + 2]
            if FEATURE.springs:
                p, q, r, _, spring_energy = pulled(k, position, solver.springs)
                energy, x, y, z = energy + spring_energy, x + p, y + q, z + r
            if FEATURE.colliders:
                p, q, r, hard = within(
                    k, number, position, before, matrix.stiffness, (parameters, inputs.bodies, inputs.kinds)
                )
                energy = energy + inertial_energy(hard, p, q, r)
                x, y, z = x + hard * p, y + hard * q, z + hard * r
            gradient[k, 0], gradient[k, 1], gradient[k, 2] = x, y, z
            total = total + energy
        sums[0, group], sums[1, group] = total, 0.0


@routine
def move(first, last, fraction, position, before, vectors, sums):
    """Set the positions to a fraction of the step."""
    current, gradient, solution = vectors.current, vectors.gradient, vectors.solution
    for group in range(first, last):
        total = 0.0
        for k in range(group * SUMMED, min((group + 1) * SUMMED, len(position))):
            if before[k, 3] > 0.0:
                for axis in range(AXES):
                    position[k, axis] = moved(current[k, axis], fraction, solution[k, axis])
                total = total + dot(gradient, solution, k)
        sums[0, group] = total


@routine
def accept(first, last, position, vectors):
    """Store positions and gradient of the accepted state."""
    current, gradient, trial = vectors.current, vectors.gradient, vectors.trial
    for k in range(first * SUMMED, min(last * SUMMED, len(position))):
        for axis in range(AXES):
            current[k, axis] = position[k, axis]
            gradient[k, axis] = trial[k, axis]


@routine
def put(first, last, position, before, source):
    """Set the positions to `source`, except for pins."""
    for k in range(first * SUMMED, min(last * SUMMED, len(position))):
        for axis in range(AXES):
            if before[k, 3] > 0.0:
                position[k, axis] = source[k, axis]
