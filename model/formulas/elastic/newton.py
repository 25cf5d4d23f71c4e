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
from typing import NamedTuple

import numpy as np

from softlab.model.base.variant import OfPrecision, formula


class Passes(NamedTuple):
    """Passes, in the order of the method; each is followed by the next one unless `after` decides otherwise."""

    BEGIN: int  # inertial or driven positions
    ENERGIES: int  # forces and energies of tetrahedra
    WEIGH: int  # gradient and energy at particles
    ACCEPT: int  # the state becomes the current one
    RETURN: int  # back to the current state
    AHEAD: int  # positions without elasticity
    BLOCKS: int  # tangents of tetrahedra
    ROWS: int  # rows of the matrix, inverses of its diagonal blocks
    CENTRES: int  # centres of groups
    COARSE: int  # the coarse matrix
    FACTOR: int  # its factor
    SOLVE: int  # start of conjugate gradients
    PRODUCT: int  # of the matrix with the direction
    UPDATE: int  # of solution and residual
    RESTRICT: int  # residual of groups
    SUBSTITUTE: int  # solution of the coarse system
    CORRECT: int  # preconditioned residual
    DIRECTION: int  # the next direction
    MOVE: int  # along the solution
    FINISH: int  # velocities


class Done(NamedTuple):
    """Counters of a simulation, in its array `done`."""

    SOLVES: int
    EVALUATIONS: int
    MATRICES: int
    PRODUCTS: int
    STEPS: int


PASS, DONE = Passes(*range(len(Passes._fields))), Done(*range(len(Done._fields)))
# states whose potential is evaluated: the substep's start, without elasticity, along a step
BEHIND, BEFORE, SEARCH = range(3)
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
    fraction: float
    slope: float
    unsure: float


SMALLEST_STEP = OfPrecision(lambda real: CONVERGED[np.dtype(real).itemsize])
NEAR_SQUARE = NEAR**2
EPS = OfPrecision(lambda real: np.finfo(real).eps)


@formula
def after_looking(phase, halvings, energy, trial, noise, fraction, slope):
    """Return (next pass, energy, fraction of the step, halvings so far) when the energy `trial` of a trial step is
    known."""
    if phase == BEHIND:
        return PASS.ACCEPT, trial, fraction, halvings
    if phase == BEFORE:
        if trial < energy:
            return PASS.ACCEPT, trial, fraction, halvings
        return PASS.RETURN, energy, fraction, halvings
    if trial <= (energy + DOWNHILL * fraction * slope) + noise:
        return PASS.ACCEPT, trial, fraction, halvings
    if halvings + 1 < MOST_HALVINGS:
        return PASS.MOVE, energy, 0.5 * fraction, halvings + 1
    return PASS.RETURN, energy, fraction, halvings


@formula
def after_moving(kind, phase, safe, steps, energy, slope, iterations):
    """Return (next pass, phase, safe, steps) after `accept` or `return`."""
    if phase == BEHIND:
        return PASS.AHEAD, BEFORE, safe, steps
    if phase == BEFORE:
        return PASS.BLOCKS, SEARCH, 0, steps
    if kind == PASS.RETURN:
        if safe == 0:
            return PASS.BLOCKS, phase, 1, steps
        return PASS.FINISH, phase, safe, steps
    if steps + 1 < iterations and -slope > SMALLEST_STEP * energy:
        return PASS.BLOCKS, phase, 0, steps + 1
    return PASS.FINISH, phase, safe, steps + 1


@formula
def after_solving(kind, safe, products, squared, enough, value, floor):
    """Return (next pass, safe, products, squared, enough, alpha, beta) within conjugate gradients."""
    if kind == PASS.PRODUCT:
        if value > 0.0:
            return PASS.UPDATE, safe, products, squared, enough, squared / value, 0.0
        if safe == 0:
            return PASS.BLOCKS, 1, products, squared, enough, 0.0, 0.0
        return PASS.MOVE if products > 0 else PASS.FINISH, safe, products, squared, enough, 0.0, 0.0
    if kind == PASS.UPDATE:
        return PASS.RESTRICT, safe, products + 1, squared, enough, 0.0, 0.0
    if products == 0:
        enough = max(NEAR_SQUARE * value, floor)
        return PASS.DIRECTION if value > floor else PASS.FINISH, safe, 0, value, enough, 0.0, 0.0
    if value > enough and products < MOST_PRODUCTS:
        return PASS.DIRECTION, safe, products, value, enough, 0.0, value / squared
    return PASS.MOVE, safe, products, value, enough, 0.0, 0.0


@formula
def after(kind, counts, values, first, second, iterations, floor):
    """Return (next pass, Counts, Values) from the sums of a pass, `first` and `second`: energies and their rounding errors,
    how many matrices are not positive, or scalar products."""
    phase, safe, products, steps, halvings = counts
    energy, trial, noise, squared, enough, alpha, beta, fraction, slope, unsure = values
    later = kind + 1
    if kind == PASS.BEGIN:
        phase, safe, steps = BEHIND, 0, 0
    elif kind == PASS.ENERGIES:
        trial, noise = first, second
    elif kind == PASS.WEIGH:
        trial, noise = trial + first, noise + second
        later, energy, fraction, halvings = after_looking(phase, halvings, energy, trial, unsure, fraction, slope)
        if later == PASS.ACCEPT:  # of the accepted state: the noise of a trial may be infinite
            unsure = noise
    elif kind in (PASS.ACCEPT, PASS.RETURN):
        later, phase, safe, steps = after_moving(kind, phase, safe, steps, energy, slope, iterations)
    elif kind in (PASS.ROWS, PASS.FACTOR) and first > 0.0 and safe == 0:
        later, safe = PASS.BLOCKS, 1
    elif kind == PASS.SOLVE:
        later, products = PASS.RESTRICT, 0
    elif kind in (PASS.PRODUCT, PASS.UPDATE, PASS.CORRECT):
        later, safe, products, squared, enough, alpha, beta = after_solving(
            kind, safe, products, squared, enough, first, floor
        )  # fmt: skip
        fraction, halvings = 1.0, 0
    elif kind == PASS.DIRECTION:
        later = PASS.PRODUCT
    elif kind == PASS.MOVE:
        later, slope = PASS.ENERGIES, first
    elif kind == PASS.AHEAD:
        later = PASS.ENERGIES
    elif kind == PASS.FINISH:
        later = PASS.BEGIN
    counts = Counts(phase, safe, products, steps, halvings)
    return later, counts, Values(energy, trial, noise, squared, enough, alpha, beta, fraction, slope, unsure)


@formula
def doubt(energy, volume, mu, lame, hookean):
    """Rounding error [J] of the energy of a tetrahedron, W = `energy`, by rounding of F's entries."""
    stiff = (mu + mu) + lame
    strain = 4.0 * sqrt(stiff * abs(energy)) + EPS * stiff
    if hookean:
        strain = strain + mu
    return EPS * (volume * strain)


@formula
def inertia_of(mean, weight):
    """m / h^2 of a particle, from the mean mass over h^2."""
    return mean / weight


@formula
def inertial_energy(inertia, x, y, z):
    """Energy [J] of a displacement from the inertial position."""
    return 0.5 * inertia * ((x * x + y * y) + z * z)


@formula
def moved(x, fraction, d):
    return x + fraction * d


@formula
def outer(x, y, z, hard):
    """`hard` times n n', (xx, xy, xz, yy, yz, zz), with n along (x, y, z); 0 where (x, y, z) is 0."""
    squared = (x * x + y * y) + z * z
    s = hard / squared if squared > 0.0 else 0.0
    return s * (x * x), s * (x * y), s * (x * z), s * (y * y), s * (y * z), s * (z * z)


@formula
def inverse(a, b, c, d, e, f):
    """Return (the inverse's xx, xy, xz, yy, yz, zz, True if it is positive) of the symmetric matrix (xx, xy, xz, yy,
    yz, zz)."""
    p, q, r = d * f - e * e, e * c - b * f, b * e - d * c
    whole = (a * p + b * q) + c * r
    minor = a * d - b * b
    good = (a > 0.0) & (minor > 0.0) & (whole > 0.0)
    s = 1.0 / whole if good else 0.0
    return s * p, s * q, s * r, s * (a * f - c * c), s * (b * c - a * e), s * minor, good
