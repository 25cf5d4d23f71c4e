"""Position-based tetrahedra in slow, plain NumPy float64, colour by colour: the reference of both backends' sweeps.

XPBD (Macklin, Mueller, Chentanez, MIG 2016, eq. 17, 18 and 26) of each material as two rows per tetrahedron, whose
energies C^2 / (2 compliance) add up to V Psi (bench/reference/elastic_materials.py), the first of the shape, the second
of the volume:

- `corotated`: |F - R|, 1/(2 mu V); tr(R' F) - 3, 1/(lambda V);
- `fixed-corotated`: |F - R|, 1/(2 mu V); det F - 1, 1/(lambda V);
- `neo-hookean`: det F - 1, 1/(lambda V), and instead of a second row the rest of the energy, mu V S / 2 with
  S = |F|^2 + J^2 - 4 J, which is minimal at every rotation. (Macklin and Mueller, "A Constraint-based Formulation of
  Stable Neo-Hookean Materials", MIG 2021, use |F| and det F - alpha, which balance each other at rest, so that rows in
  turn are not at rest there.) A projection moves along the residual to the minimum of the substep's energy, to second
  order (`Sweep.descend`).

`rows` projects them one after the other, the shape first, as all orders do for neo-Hookean except `volume-first`;
`SCHEMES` has other orders. `blocks` is another scheme: F - R as one system (`Sweep.block`), then the volume. With
iterations a scalar row keeps multipliers along past directions of |F - R| and ends some per cent off the step of
implicit Euler (finite_elements_newton.py), to which blocks and the rows of the neo-Hookean material converge.

Damping by a time tau in proportion to stiffness is a damper beta = tau / compliance on each row: with alpha~ =
alpha/h^2 and beta~ = h^2 beta, eq. 26's gamma = alpha~ beta~ / h is tau / h. For a block it damps the rate of the
stretch S, F = R S. Multipliers start at 0 in every substep and persist over its iterations, in J s^2. Positions (...,
n, 3): leading axes are bodies without contact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softlab.bench.reference import elastic_materials
from softlab.bench.reference.finite_elements import Body

ROUND = 1e-9  # |F - R| below it has no direction, and no row
SHAPE, VOLUME = 0, 1
LEAST_CURVATURE = 2.0  # lower bound of the curvature of S / 2 along a unit direction without rotation, at rest
SCHEMES = {"rows": ((SHAPE,), (VOLUME,)), "volume-first": ((VOLUME,), (SHAPE,)), "together": ((SHAPE, VOLUME),)}


def row(body: Body, kind: int, members: np.ndarray, gradient: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return C (..., c), dC/dF (..., c, 3, 3) and the compliance (c,) [1/(N m)] of a row of tetrahedra.

    `members` (c,): the tetrahedra. `gradient`: their F. C is 0 and the compliance infinite where there is no row."""
    mu, lam, volume = body.mu[members], body.lam[members], body.volume[members]
    if kind == SHAPE:
        if body.material == "neo-hookean":
            raise ValueError("the shape of a neo-Hookean tetrahedron is no row: see Sweep.descend")
        difference, modulus = gradient - elastic_materials.rotation(gradient), 2 * mu
        length = np.sqrt((difference**2).sum(axis=(-2, -1)))
        there = length >= ROUND
        slope = difference / np.where(there, length, 1.0)[..., None, None] * there[..., None, None]
        return np.where(there, length, 0.0), slope, 1 / (modulus * volume)
    if body.material == "corotated":
        u, s, w = elastic_materials.decompose(gradient)
        value, slope, modulus = s.sum(axis=-1) - 3, u @ w, lam
    else:
        value, slope, modulus = np.linalg.det(gradient) - 1, elastic_materials.cofactor(gradient), lam
    with np.errstate(divide="ignore"):
        return value, slope, 1 / (modulus * volume)


@dataclass
class Sweep:
    """State shared by the projections of one substep of h [s].

    `shape`: multipliers (..., m, 3, 3) of shapes; a row uses only [0, 0], and for a neo-Hookean tetrahedron they
    include the impulse of its volume's row. `volume`: multipliers (..., m) of volumes. `before`: positions at the start
    of the substep."""

    body: Body
    inverse_mass: np.ndarray
    before: np.ndarray
    h: float
    gamma: float
    shape: np.ndarray
    volume: np.ndarray

    def gradient(self, members: np.ndarray, position: np.ndarray) -> np.ndarray:
        """Return F of these tetrahedra, or for a displacement its gradient: (..., c, 3, 3)."""
        return np.einsum(
            "...mai,maj->...mij", position[..., self.body.tetrahedra[members], :], self.body.gradient[members]
        )

    def push(self, members: np.ndarray, position: np.ndarray, change: np.ndarray) -> None:
        """Move the corners by the multipliers' `change` times dC/dF (..., c, 3, 3), in place."""
        corners = self.body.tetrahedra[members]
        displacements = np.einsum("...mij,maj->...mai", change, self.body.gradient[members])
        position[..., corners, :] += self.inverse_mass[corners][..., None] * displacements

    def rows(self, members: np.ndarray, position: np.ndarray, kinds: Sequence[int]) -> None:
        """Project the rows `kinds` of these tetrahedra as one system, in place."""
        f = self.gradient(members, position)
        moved = f - self.gradient(members, self.before)
        parts = [row(self.body, kind, members, f) for kind in kinds]
        slope = np.stack([part[1] for part in parts], axis=-3)
        heavy = self.weight(members)
        between = np.einsum("...mkij,mjl,...mnil->...mkn", slope, heavy, slope)
        left = np.empty(between.shape[:-1])
        for n, (kind, (value, gradients, compliance)) in enumerate(zip(kinds, parts, strict=True)):
            known = self.shape[..., members, 0, 0] if kind == SHAPE else self.volume[..., members]
            there = np.isfinite(compliance) & (gradients**2).any(axis=(-2, -1))
            alpha = np.where(np.isfinite(compliance), compliance, 1.0) / self.h**2
            rate = self.gamma * (gradients * moved).sum(axis=(-2, -1))
            left[..., n] = np.where(there, -value - alpha * known - rate, 0.0)
            between[..., n, :] *= 1 + self.gamma
            between[..., n, n] += alpha
        change = np.linalg.solve(between, left[..., None])[..., 0]
        for n, kind in enumerate(kinds):
            if kind == SHAPE:
                self.shape[..., members, 0, 0] += change[..., n]
            else:
                self.volume[..., members] += change[..., n]
        self.push(members, position, np.einsum("...mk,...mkij->...mij", change, slope))

    def block(self, members: np.ndarray, position: np.ndarray) -> None:
        """Project the shape F = R S of these tetrahedra as one system, in place.

        A change R Z of the impulse Y changes F by R Z H and, near S = 1, S by the symmetric part of Z H: R rotates with
        the rest. The step takes Z from (Z Ha + Ha Z) / 2 = -(S - 1) - gamma (S - S0) - alpha R'Y with Ha = (1 + gamma)
        H + alpha (a Lyapunov equation, solved along the axes of Ha). For Y = 0, Z is symmetric, and the linear
        projection is the orthogonal one in the norm of the masses."""
        body, f = self.body, self.gradient(members, position)
        turn, before = elastic_materials.rotation(f), self.gradient(members, self.before)
        back = np.swapaxes(turn, -2, -1)
        stretch, start = back @ f, np.swapaxes(elastic_materials.rotation(before), -2, -1) @ before
        alpha = 1 / (2 * body.mu[members] * body.volume[members] * self.h**2)[:, None, None]
        left = -(stretch - np.eye(3)) - self.gamma * (stretch - start) - alpha * back @ self.shape[..., members, :, :]
        size, axes = np.linalg.eigh((1 + self.gamma) * self.weight(members) + alpha * np.eye(3))
        along = np.swapaxes(axes, -2, -1) @ left @ axes / (size[:, :, None] + size[:, None, :])
        change = turn @ (2 * axes @ along @ np.swapaxes(axes, -2, -1))
        self.shape[..., members, :, :] += change
        self.push(members, position, change)

    def descend(self, members: np.ndarray, position: np.ndarray) -> None:
        """Project the shape of these neo-Hookean tetrahedra, in place.

        Let Y be the impulse of shape and volume, l the volume's multiplier, e(D) = (F'D + D'F) / 2, E = e(F) / 2 now,
        and E0 that at the start of the substep. A substep is solved where alpha (Y - l cof F) + dS/dF / 2 + 2 gamma F
        (E - E0) = 0; the last term is a damper in Green's strain. Along the residual's direction D the energy S / 2 has
        the curvature
        |D|^2 + (cof F : D)^2 + 2 (J - 2) F : cof D and the damper 2 gamma (e(D):e(D) + (E - E0) : D'D)."""
        body, f, gamma = self.body, self.gradient(members, position), self.gamma
        cofactor, ratio = elastic_materials.cofactor(f), np.linalg.det(f)
        alpha = 1 / (body.mu[members] * body.volume[members] * self.h**2)
        impulse = self.shape[..., members, :, :] - self.volume[..., members][..., None, None] * cofactor
        grown = (square(f) - square(self.gradient(members, self.before))) / 2
        left = -(f + (ratio - 2)[..., None, None] * cofactor) - alpha[:, None, None] * impulse - 2 * gamma * f @ grown
        direction = left @ self.weight(members)
        size, tilt = inner(direction, direction), np.swapaxes(f, -2, -1) @ direction
        rate = (tilt + np.swapaxes(tilt, -2, -1)) / 2
        elastic = (
            size + inner(cofactor, direction) ** 2 + 2 * (ratio - 2) * inner(f, elastic_materials.cofactor(direction))
        )
        viscous = 2 * (inner(rate, rate) + np.maximum(inner(grown, square(direction)), 0))
        curvature = np.maximum(elastic, LEAST_CURVATURE * size) + gamma * np.maximum(viscous, LEAST_CURVATURE * size)
        along = inner(left, direction)
        moves = along > np.finfo(float).tiny
        step = np.where(moves, along, 0) / np.where(moves, alpha * along + curvature, 1)
        change = step[..., None, None] * left
        self.shape[..., members, :, :] += change
        self.push(members, position, change)

    def hookean(self, members: np.ndarray, position: np.ndarray, order: Sequence[Sequence[int]]) -> None:
        """Project shape and volume of neo-Hookean tetrahedra one after the other, in place.

        Impulses of the volume are added to the shape's multipliers, so that they need not rotate with F."""
        for kind in [kind for kinds in order for kind in kinds]:
            if kind == SHAPE:
                self.descend(members, position)
                continue
            slope = elastic_materials.cofactor(self.gradient(members, position))
            known = self.volume[..., members].copy()
            self.rows(members, position, (VOLUME,))
            self.shape[..., members, :, :] += (self.volume[..., members] - known)[..., None, None] * slope

    def weight(self, members: np.ndarray) -> np.ndarray:
        """Return the response of F to a push, the sum of w g g': (c, 3, 3) [1/(kg m^2)]."""
        hats = self.body.gradient[members]
        return np.einsum("mai,ma,maj->mij", hats, self.inverse_mass[self.body.tetrahedra[members]], hats)

    def project(self, members: np.ndarray, position: np.ndarray, scheme: str) -> None:
        """Project shape and volume of the tetrahedra `members` (c,), no two of which share a vertex, in place."""
        if self.body.material == "neo-hookean":
            self.hookean(members, position, SCHEMES.get(scheme, ((SHAPE, VOLUME),)))
            return
        if scheme == "blocks":
            self.block(members, position)
            self.rows(members, position, (VOLUME,))
            return
        for kinds in SCHEMES[scheme]:
            self.rows(members, position, kinds)


def inner(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return A : B of matrices (..., 3, 3)."""
    return (a * b).sum(axis=(-2, -1))


def square(a: np.ndarray) -> np.ndarray:
    """Return A'A: (..., 3, 3)."""
    return np.swapaxes(a, -2, -1) @ a


@dataclass(frozen=True)
class Method:
    """Parameters of a step of tetrahedra.

    `order`: sets of tetrahedra without a common vertex, one after the other, `iterations` times a substep; `damping_time`
    [s]: tau; `drag` [1/s]: of the velocity, in proportion to mass; `scheme`: a key of SCHEMES, or "blocks".
    """

    order: Sequence[np.ndarray]
    iterations: int = 1
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m/s^2
    damping_time: float = 0.0
    drag: float = 0.0
    scheme: str = "rows"


def substep(
    body: Body, position: np.ndarray, velocity: np.ndarray, inverse_mass: np.ndarray, h: float, method: Method
) -> tuple[np.ndarray, np.ndarray]:
    """Return (position, velocity) after h [s]; the arguments as in `simulate`."""
    free = (inverse_mass > 0)[:, None]
    v = np.where(free, velocity * (1 - h * method.drag) + h * np.asarray(method.gravity), 0.0)
    p = position + h * v
    shape = np.zeros((*p.shape[:-2], len(body.tetrahedra), 3, 3))
    sweep = Sweep(body, inverse_mass, position, h, method.damping_time / h, shape, shape[..., 0, 0].copy())
    for _ in range(method.iterations):
        for members in method.order:
            sweep.project(members, p, method.scheme)
    return p, (p - position) / h


def simulate(
    body: Body,
    position: np.ndarray,
    velocity: np.ndarray,
    inverse_mass: np.ndarray,
    dt: float,
    substeps: int,
    steps: int,
    method: Method,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (position [m], velocity [m/s]), (..., n, 3), after `steps` steps of `dt` [s].

    `inverse_mass` (n,) [1/kg], 0 for fixed vertices."""
    p, v = np.array(position, dtype=np.float64), np.array(velocity, dtype=np.float64)
    for _ in range(steps * substeps):
        p, v = substep(body, p, v, inverse_mass, dt / substeps, method)
    return p, v


def at_rest(
    body: Body, start: np.ndarray, inverse_mass: np.ndarray, h: float, method: Method, enough: float = 1e-8
) -> np.ndarray:
    """Return the positions (n, 3) [m] at which `simulate` is at rest: a substep of h [s] does not move them.

    By Newton's method on the substep, with its slope by differences, until a substep moves no coordinate by more than
    `enough` of the displacement by gravity alone, or the rounding of float64. This is not the material's equilibrium,
    because iterations that have not converged leave an error."""
    free = np.flatnonzero(np.repeat(inverse_mass > 0, 3))
    extent = float(np.ptp(body.rest, axis=0).max())
    near = max(enough * h**2 * float(np.linalg.norm(method.gravity)), 2e-13 * extent)

    def moved(x: np.ndarray) -> np.ndarray:
        p, _ = substep(body, x, np.zeros_like(x), inverse_mass, h, method)
        return (p - x).reshape(*x.shape[:-2], -1)[..., free]

    x, last = np.array(start, dtype=np.float64), np.inf
    inverse = None
    for _ in range(60):
        left = moved(x)
        size = float(np.abs(left).max())
        if size <= near:
            return x
        if inverse is None or size > 0.3 * last:
            eps = 1e-7 * extent
            probes = np.repeat(x.reshape(1, -1), len(free), axis=0)
            probes[np.arange(len(free)), free] += eps
            inverse = np.linalg.inv((moved(probes.reshape(-1, *x.shape)) - left).T / eps)
        last = size
        flat = x.ravel().copy()
        flat[free] -= inverse @ left
        x = flat.reshape(x.shape)
    raise RuntimeError(f"no rest found: a substep still moves {size:.2e} m")
