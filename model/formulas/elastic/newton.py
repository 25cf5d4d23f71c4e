"""Newton's method with a line search and conjugate gradients: the order of passes over tetrahedra and particles.

J. Nocedal, S. Wright, "Numerical Optimization", 2nd edition, algorithms 3.1 (backtracking), 5.3 (preconditioned
conjugate gradients; by the diagonal blocks' inverses and a coarse level, coarse.py) and 7.1 (line search Newton-CG).
The start is the previous positions or the positions without elasticity, whichever has the lower potential. The matrix
is the exact tangent. Where that has a curvature that is not positive, or gives no descent, it is assembled again,
`safe` (tangent.py). The next pass is decided from sums over all particles; the caller stores `counts` and `values`
between passes.
"""

from __future__ import annotations

from math import sqrt
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from softlab.model.formulas import plain

KINDS = (
    "begin", "look", "weigh", "accept", "return", "ahead", "blocks", "rows",
    "centres", "coarse rows", "solve", "product", "update", "restrict", "correct", "direction", "move", "finish",
)  # fmt: skip
(
    BEGIN, ENERGIES, WEIGH, ACCEPT, RETURN, AHEAD, BLOCKS, ROWS, CENTRES, COARSE,
    SOLVE, PRODUCT, UPDATE, RESTRICT, CORRECT, DIRECTION, MOVE, FINISH,
) = range(len(KINDS))  # fmt: skip
BEHIND, BEFORE, SEARCH = range(
    3
)  # states whose potential is evaluated: the substep's start, without elasticity, along a step
DONE = ("solves", "looks", "matrices", "products", "steps")  # counters of a simulation
SOLVES, EVALUATIONS, MATRICES, PRODUCTS, STEPS = range(len(DONE))
NEAR = 1e-4  # remaining residual, in the norm of the preconditioner, over the first one
DOWNHILL = 1e-4  # of the descent that the slope predicts
MOST_HALVINGS = 20  # to a millionth of a step
MOST_PRODUCTS = 1000  # a system that needs more is not solved in this step: the next step continues
CONTACT = 10.0  # stiffness of colliders while a step is solved, over that of a particle's inertia and elasticity
SOON = 1 / 64  # of the displacement to the inertial position: a particle within a collider there rests on it
CONVERGED = {4: 1e-6, 8: 1e-13}  # descent that a step predicted, over the potential: below it no step follows


class Counts(NamedTuple):
    """Integers between passes: the state whose potential is evaluated (BEHIND ...), 1 for a matrix that is assembled
    `safe`, products of a solve, steps of a substep, halvings of a step."""

    phase: int
    safe: int
    products: int
    steps: int
    halvings: int


class Values(NamedTuple):
    """Numbers between passes: potential of the accepted state, of a trial, and its rounding error [J]; squared residual
    of a solve, and where it ends; factors of the last step, the next direction, a Newton step; slope along that step;
    rounding error of the accepted state's potential [J]."""

    energy: float
    trial: float
    noise: float
    squared: float
    enough: float
    alpha: float
    beta: float
    share: float
    slope: float
    unsure: float


def make_search(real, compiled=plain):
    """Make the decisions after `weigh`, and after `accept` or `return`: see make_control."""
    half, downhill = real(0.5), real(DOWNHILL)
    converged = real(CONVERGED[np.dtype(real).itemsize])

    @compiled
    def after_looking(phase, halvings, energy, trial, noise, fraction, slope):
        """(next pass, energy, fraction, halvings)"""
        if phase == BEHIND:
            return ACCEPT, trial, fraction, halvings
        if phase == BEFORE:
            if trial < energy:
                return ACCEPT, trial, fraction, halvings
            return RETURN, energy, fraction, halvings
        if trial <= (energy + downhill * fraction * slope) + noise:
            return ACCEPT, trial, fraction, halvings
        if halvings + 1 < MOST_HALVINGS:
            return MOVE, energy, half * fraction, halvings + 1
        return RETURN, energy, fraction, halvings

    @compiled
    def after_moving(kind, phase, safe, steps, energy, slope, iterations):
        """(next pass, phase, safe, steps) after `accept` or `return`."""
        if phase == BEHIND:
            return AHEAD, BEFORE, safe, steps
        if phase == BEFORE:
            return BLOCKS, SEARCH, 0, steps
        if kind == RETURN:
            if safe == 0:
                return BLOCKS, phase, 1, steps
            return FINISH, phase, safe, steps
        if steps + 1 < iterations and -slope > converged * energy:
            return BLOCKS, phase, 0, steps + 1
        return FINISH, phase, safe, steps + 1

    return SimpleNamespace(after_looking=after_looking, after_moving=after_moving)


def make_control(real, compiled=plain):
    """Make `after(kind, counts, values, first, second, iterations, floor)`: (next pass, Counts, Values) after the pass
    `kind`, whose sums are `first` and `second`."""
    zero, one, near = real(0), real(1), real(NEAR**2)
    search = make_search(real, compiled)
    after_looking, after_moving = search.after_looking, search.after_moving

    @compiled
    def after_solving(kind, safe, products, squared, enough, value, floor):
        """(next pass, safe, products, squared, enough, alpha, beta) within conjugate gradients."""
        if kind == PRODUCT:
            if value > zero:
                return UPDATE, safe, products, squared, enough, squared / value, zero
            if safe == 0:
                return BLOCKS, 1, products, squared, enough, zero, zero
            return MOVE if products > 0 else FINISH, safe, products, squared, enough, zero, zero
        if kind == UPDATE:
            return RESTRICT, safe, products + 1, squared, enough, zero, zero
        if products == 0:
            enough = max(near * value, floor)
            return DIRECTION if value > floor else FINISH, safe, 0, value, enough, zero, zero
        if value > enough and products < MOST_PRODUCTS:
            return DIRECTION, safe, products, value, enough, zero, value / squared
        return MOVE, safe, products, value, enough, zero, zero

    @compiled
    def after(kind, counts, values, first, second, iterations, floor):
        phase, safe, products, steps, halvings = counts
        energy, trial, noise, squared, enough, alpha, beta, fraction, slope, unsure = values
        later = kind + 1
        if kind == BEGIN:
            phase, safe, steps = BEHIND, 0, 0
        elif kind == ENERGIES:
            trial, noise = first, second
        elif kind == WEIGH:
            trial, noise = trial + first, noise + second
            later, energy, fraction, halvings = after_looking(phase, halvings, energy, trial, unsure, fraction, slope)
            if later == ACCEPT:  # of the accepted state: the noise of a trial may be infinite
                unsure = noise
        elif kind in (ACCEPT, RETURN):
            later, phase, safe, steps = after_moving(kind, phase, safe, steps, energy, slope, iterations)
        elif kind in (ROWS, COARSE) and first > zero and safe == 0:
            later, safe = BLOCKS, 1
        elif kind == SOLVE:
            later, products = RESTRICT, 0
        elif kind in (PRODUCT, UPDATE, CORRECT):
            later, safe, products, squared, enough, alpha, beta = after_solving(
                kind, safe, products, squared, enough, first, floor
            )  # fmt: skip
            fraction, halvings = one, 0
        elif kind == DIRECTION:
            later = PRODUCT
        elif kind == MOVE:
            later, slope = ENERGIES, first
        elif kind == AHEAD:
            later = ENERGIES
        elif kind == FINISH:
            later = BEGIN
        counts = Counts(phase, safe, products, steps, halvings)
        return later, counts, Values(energy, trial, noise, squared, enough, alpha, beta, fraction, slope, unsure)

    return SimpleNamespace(after=after)


def make(real, compiled=plain):
    """Make the functions that passes apply to one particle or tetrahedron, in the arithmetic `real`."""
    zero, half, one, four = real(0), real(0.5), real(1), real(4)
    eps = real(np.finfo(real).eps)

    @compiled
    def doubt(energy, volume, mu, lame, hookean):
        """Rounding error [J] of the energy of a tetrahedron, W = `energy`, by rounding of F's entries."""
        stiff = (mu + mu) + lame
        strain = four * sqrt(stiff * abs(energy)) + eps * stiff
        if hookean:
            strain = strain + mu
        return eps * (volume * strain)

    @compiled
    def inertia_of(mean, weight):
        """m / h^2 of a particle, from the mean mass over h^2."""
        return mean / weight

    @compiled
    def inertial_energy(inertia, x, y, z):
        """Energy [J] of a displacement from the inertial position."""
        return half * inertia * ((x * x + y * y) + z * z)

    @compiled
    def moved(x, fraction, d):
        return x + fraction * d

    @compiled
    def outer(x, y, z, hard):
        """`hard` times n n', (xx, xy, xz, yy, yz, zz), with n along (x, y, z); 0 where (x, y, z) is 0."""
        squared = (x * x + y * y) + z * z
        s = hard / squared if squared > zero else zero
        return s * (x * x), s * (x * y), s * (x * z), s * (y * y), s * (y * z), s * (z * z)

    @compiled
    def inverse(a, b, c, d, e, f):
        """(the inverse's xx, xy, xz, yy, yz, zz, True if it is positive) of the symmetric matrix (xx, xy, xz, yy, yz,
        zz)."""
        p, q, r = d * f - e * e, e * c - b * f, b * e - d * c
        whole = (a * p + b * q) + c * r
        minor = a * d - b * b
        good = (a > zero) & (minor > zero) & (whole > zero)
        s = one / whole if good else zero
        return s * p, s * q, s * r, s * (a * f - c * c), s * (b * c - a * e), s * minor, good

    return SimpleNamespace(
        doubt=doubt, inertia_of=inertia_of, inertial_energy=inertial_energy, moved=moved, outer=outer, inverse=inverse
    )
