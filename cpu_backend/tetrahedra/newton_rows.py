"""Operations of Newton's method on particles, by groups, on CPU threads: each particle sums its own row, in one order.

newton_arrays.py describes the arrays.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.tetrahedra.newton_matrix import AXES
from softlab.cpu_backend.tetrahedra.springs import make_springs
from softlab.model.base.types import Real
from softlab.model.formulas.elastic import newton
from softlab.model.tetrahedra.newton import SUMMED
from softlab.model.tetrahedra.springs import PARTS


def make_solving(compiler: Compiler, real: Real, apply: Callable, corrected: Callable) -> SimpleNamespace:
    """Make the passes of conjugate gradients, each over groups: `start`, `product`, `update`, `correct`, `direct`."""
    compiled, zero = compiler.compiled, real(0)

    @compiled
    def dot(a, b, k):
        return (a[k, 0] * b[k, 0] + a[k, 1] * b[k, 1]) + a[k, 2] * b[k, 2]

    @compiled
    def precondition(k, inverses, residual, into):
        x, y, z = residual[k, 0], residual[k, 1], residual[k, 2]
        into[k, 0] = (inverses[k, 0] * x + inverses[k, 1] * y) + inverses[k, 2] * z
        into[k, 1] = (inverses[k, 1] * x + inverses[k, 3] * y) + inverses[k, 4] * z
        into[k, 2] = (inverses[k, 2] * x + inverses[k, 4] * y) + inverses[k, 5] * z

    @compiled
    def start(first, last, before, vectors):
        gradient, solution = vectors.gradient, vectors.solution
        residual, direction = vectors.residual, vectors.direction
        for k in range(first * SUMMED, min(last * SUMMED, len(before))):
            for axis in range(AXES):
                solution[k, axis] = zero
                residual[k, axis] = -gradient[k, axis] if before[k, 3] > zero else zero
                direction[k, axis] = zero

    @compiled
    def product(first, last, before, rows, vectors, matrix, sums):
        direction, into = vectors.direction, vectors.product
        for group in range(first, last):
            total = zero
            for k in range(group * SUMMED, min((group + 1) * SUMMED, len(before))):
                if before[k, 3] > zero:
                    x, y, z = apply(k, rows, matrix.blocks, direction)
                    into[k, 0], into[k, 1], into[k, 2] = x, y, z
                    total = total + dot(direction, into, k)
            sums[0, group] = total

    @compiled
    def update(first, last, alpha, before, vectors):
        solution, residual = vectors.solution, vectors.residual
        direction, applied = vectors.direction, vectors.product
        for k in range(first * SUMMED, min(last * SUMMED, len(before))):
            if before[k, 3] > zero:
                for axis in range(AXES):
                    solution[k, axis] = solution[k, axis] + alpha * direction[k, axis]
                    residual[k, axis] = residual[k, axis] - alpha * applied[k, axis]

    @compiled
    def correct(first, last, position, before, vectors, matrix, groups, coarse, sums):
        """Precondition the residual with both levels."""
        residual, into = vectors.residual, vectors.product
        for group in range(first, last):
            total = zero
            for k in range(group * SUMMED, min((group + 1) * SUMMED, len(before))):
                if before[k, 3] > zero:
                    precondition(k, matrix.inverses, residual, into)
                    x, y, z = corrected(k, position, groups, coarse)
                    into[k, 0], into[k, 1], into[k, 2] = into[k, 0] + x, into[k, 1] + y, into[k, 2] + z
                    total = total + dot(residual, into, k)
            sums[0, group] = total

    @compiled
    def direct(first, last, beta, vectors):
        direction, preconditioned = vectors.direction, vectors.product
        for k in range(first * SUMMED, min(last * SUMMED, len(direction))):
            for axis in range(AXES):
                direction[k, axis] = preconditioned[k, axis] + beta * direction[k, axis]

    return SimpleNamespace(start=start, product=product, update=update, correct=correct, direct=direct, dot=dot)


def make_moving(
    compiler: Compiler, real: Real, parts: frozenset[str], dot: Callable, contact: SimpleNamespace
) -> SimpleNamespace:
    """Make `weigh`, the potential's gradient at the positions and the rest of its energy, and `move`, `accept`, `put`,
    over groups."""
    compiled, formulas = compiler.compiled, compiler.formulas(newton, real)
    inertia_of, inertial_energy, moved = formulas.inertia_of, formulas.inertial_energy, formulas.moved
    has_bodies, within = contact.has_bodies, contact.within
    zero = real(0)
    pulled, sprung = make_springs(compiler, real).pulled, bool(parts & PARTS)

    @compiled
    def weigh(first, last, number, position, before, inputs, solver):
        rows, vectors, matrix, sums = solver.rows, solver.vectors, solver.matrix, solver.sums
        target, gradient, parameters = vectors.target, vectors.trial, inputs.parameters
        offsets, corners, forces = rows.meets, rows.corners, matrix.forces
        for group in range(first, last):
            total = zero
            for k in range(group * SUMMED, min((group + 1) * SUMMED, len(position))):
                if before[k, 3] == zero:
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
                if sprung:
                    p, q, r, _, spring_energy = pulled(k, position, solver.springs)
                    energy, x, y, z = energy + spring_energy, x + p, y + q, z + r
                if has_bodies:
                    p, q, r, hard = within(
                        k, number, position, before, matrix.stiffness, (parameters, inputs.bodies, inputs.kinds)
                    )
                    energy = energy + inertial_energy(hard, p, q, r)
                    x, y, z = x + hard * p, y + hard * q, z + hard * r
                gradient[k, 0], gradient[k, 1], gradient[k, 2] = x, y, z
                total = total + energy
            sums[0, group], sums[1, group] = total, zero

    @compiled
    def move(first, last, fraction, position, before, vectors, sums):
        current, gradient, solution = vectors.current, vectors.gradient, vectors.solution
        for group in range(first, last):
            total = zero
            for k in range(group * SUMMED, min((group + 1) * SUMMED, len(position))):
                if before[k, 3] > zero:
                    for axis in range(AXES):
                        position[k, axis] = moved(current[k, axis], fraction, solution[k, axis])
                    total = total + dot(gradient, solution, k)
            sums[0, group] = total

    @compiled
    def accept(first, last, position, vectors):
        current, gradient, trial = vectors.current, vectors.gradient, vectors.trial
        for k in range(first * SUMMED, min(last * SUMMED, len(position))):
            for axis in range(AXES):
                current[k, axis] = position[k, axis]
                gradient[k, axis] = trial[k, axis]

    @compiled
    def put(first, last, position, before, source):
        """Set the positions to `source`, except for pins."""
        for k in range(first * SUMMED, min(last * SUMMED, len(position))):
            for axis in range(AXES):
                if before[k, 3] > zero:
                    position[k, axis] = source[k, axis]

    return SimpleNamespace(weigh=weigh, move=move, accept=accept, put=put)
