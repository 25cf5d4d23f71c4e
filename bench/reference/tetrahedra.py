"""Position-based tetrahedra in slow, plain NumPy float64, one colour after the other: the judge of both backends' sweeps.

XPBD (Macklin, Mueller, Chentanez, MIG 2016, eq. 17, 18 and 26) of each material as two rows a tetrahedron, whose energies
C^2 / (2 compliance) add up to V Psi (bench/reference/elastic_materials.py), the first of the shape, the second of the volume:

- `corotated`: |F - R|, 1/(2 mu V); tr(R' F) - 3, 1/(lambda V);
- `fixed-corotated`: |F - R|, 1/(2 mu V); det F - 1, 1/(lambda V);
- `neo-hookean`: |F|, 1/(mu V); det F - alpha, 1/(lambda' V). Macklin and Mueller, "A Constraint-based Formulation of Stable
  Neo-Hookean Materials", MIG 2021, whose C_D and C_H these are, with lambda' = lambda + mu and alpha = 1 + mu/lambda'.

Damping by a time tau in proportion to stiffness is a damper beta = tau / compliance on each row: with alpha~ = alpha/h^2 and
beta~ = h^2 beta eq. 26's gamma = alpha~ beta~ / h is tau / h. Multipliers start at 0 in every substep and are kept over its
iterations, in J s^2; positions (..., n, 3): leading axes are bodies that never meet.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bench.reference import elastic_materials
from bench.reference.finite_elements import Body

ROUND = 1e-9  # |F - R| below it has no direction: no row
SHAPE, VOLUME = 0, 1
WAYS = {"rows": (SHAPE, VOLUME), "volume-first": (VOLUME, SHAPE), "together": ()}


def row(body: Body, kind: int, members: np.ndarray, gradient: np.ndarray) -> tuple[np.ndarray, ...]:
    """C (..., c), dC/dF (..., c, 3, 3) and the compliance (c,) [1/(N m)] of a row of the tetrahedra `members` (c,), whose F
    is `gradient`; 0 and infinite where there is none."""
    mu, lam, volume = body.mu[members], body.lam[members], body.volume[members]
    if kind == SHAPE:
        if body.material == "neo-hookean":
            ways, modulus = gradient, mu
        else:
            ways, modulus = gradient - elastic_materials.rotation(gradient), 2 * mu
        length = np.sqrt((ways**2).sum(axis=(-2, -1)))
        there = length >= ROUND
        slope = ways / np.where(there, length, 1.0)[..., None, None] * there[..., None, None]
        return np.where(there, length, 0.0), slope, 1 / (modulus * volume)
    if body.material == "corotated":
        u, s, w = elastic_materials.decompose(gradient)
        value, slope, modulus = s.sum(axis=-1) - 3, u @ w, lam
    else:
        modulus = lam + mu if body.material == "neo-hookean" else lam
        rest = 1 + mu / modulus if body.material == "neo-hookean" else 1.0
        value, slope = np.linalg.det(gradient) - rest, elastic_materials.cofactor(gradient)
    with np.errstate(divide="ignore"):
        return value, slope, 1 / (modulus * volume)


def project(
    body: Body, members: np.ndarray, way: str, position: np.ndarray, before: np.ndarray, multipliers: np.ndarray,
    inverse_mass: np.ndarray, h: float, damping_time: float,
) -> None:  # fmt: skip
    """Both rows of the tetrahedra `members` (c,), no two of which share a vertex, in place: `position` (..., n, 3) [m],
    `multipliers` (..., m, 2). `before`: at the substep's start. `way`: see WAYS; together: one system of two."""
    corners, hats = body.tetrahedra[members], body.gradient[members]
    weight, gamma = inverse_mass[corners], damping_time / h
    softness: list[np.ndarray] = []
    values: list[np.ndarray] = []
    slopes: list[np.ndarray] = []
    for kind in WAYS[way] or (SHAPE, VOLUME):
        here = position[..., corners, :]
        f = np.einsum("...mai,maj->...mij", here, hats)
        value, slope, compliance = row(body, kind, members, f)
        ways = np.einsum("...mij,maj->...mai", slope, hats)
        moved = (ways * (here - before[..., corners, :])).sum(axis=(-2, -1))
        alpha, multiplier = compliance / h**2, multipliers[..., members, kind]
        there = np.isfinite(alpha) & (ways**2).any(axis=(-2, -1))
        alpha = np.where(np.isfinite(alpha), alpha, 1.0)
        left = np.where(there, -value - alpha * multiplier - gamma * moved, 0.0)
        if way == "together":
            values.append(left)
            slopes.append(ways)
            softness.append(alpha)
            continue
        heavy = (weight * (ways**2).sum(axis=-1)).sum(axis=-1)
        change = left / ((1 + gamma) * heavy + alpha)
        multipliers[..., members, kind] += change
        position[..., corners, :] += weight[..., None] * change[..., None, None] * ways
    if way == "together":
        pair = np.stack(slopes, axis=-3)
        system = (1 + gamma) * np.einsum("...mkai,ma,...mlai->...mkl", pair, weight, pair)
        system[..., 0, 0] += softness[0]
        system[..., 1, 1] += softness[1]
        changes = np.linalg.solve(system, np.stack(values, axis=-1)[..., None])[..., 0]
        multipliers[..., members, :] += changes
        position[..., corners, :] += weight[..., None] * np.einsum("...mk,...mkai->...mai", changes, pair)


def substep(
    body: Body,
    position: np.ndarray,
    velocity: np.ndarray,
    inverse_mass: np.ndarray,
    order: Sequence[np.ndarray],
    h: float,
    iterations: int = 1,
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    damping_time: float = 0.0,
    drag: float = 0.0,
    way: str = "rows",
) -> tuple[np.ndarray, np.ndarray]:
    """(position, velocity) after h [s]; the arguments as in `simulate`."""
    free = (inverse_mass > 0)[:, None]
    v = np.where(free, velocity * (1 - h * drag) + h * np.asarray(gravity), 0.0)
    p = position + h * v
    multipliers = np.zeros((*p.shape[:-2], len(body.tetrahedra), 2))
    for _ in range(iterations):
        for members in order:
            project(body, members, way, p, position, multipliers, inverse_mass, h, damping_time)
    return p, (p - position) / h


def simulate(
    body: Body,
    position: np.ndarray,
    velocity: np.ndarray,
    inverse_mass: np.ndarray,
    order: Sequence[np.ndarray],
    dt: float,
    substeps: int,
    iterations: int,
    steps: int,
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    damping_time: float = 0.0,
    drag: float = 0.0,
    way: str = "rows",
) -> tuple[np.ndarray, np.ndarray]:
    """(position [m], velocity [m/s]), (..., n, 3), after `steps` steps of `dt` [s]. `inverse_mass` (n,) [1/kg], 0 of what is
    held; `order`: sets of tetrahedra without a common vertex, one after the other; `damping_time` [s]: tau; `drag` [1/s]: of
    the velocity, in proportion to mass; `way`: of WAYS."""
    p, v = np.array(position, dtype=np.float64), np.array(velocity, dtype=np.float64)
    for _ in range(steps * substeps):
        p, v = substep(
            body, p, v, inverse_mass, order, dt / substeps, iterations, gravity, damping_time, drag, way
        )  # fmt: skip
    return p, v


def at_rest(
    body: Body,
    start: np.ndarray,
    inverse_mass: np.ndarray,
    order: Sequence[np.ndarray],
    h: float,
    iterations: int = 1,
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    damping_time: float = 0.0,
    way: str = "rows",
    enough: float = 1e-8,
) -> np.ndarray:
    """Positions (n, 3) [m] that a substep of h [s] leaves where they are, without a velocity: where `simulate` comes to rest.

    By Newton's method on the substep, its slope by differences; until one moves nothing by more than `enough` of what
    gravity alone would, or float64's rounding. Not the material's equilibrium: iterations that are cut off leave their
    error in it."""
    free = np.flatnonzero(np.repeat(inverse_mass > 0, 3))
    extent = float(np.ptp(body.rest, axis=0).max())
    near = max(enough * h**2 * float(np.linalg.norm(gravity)), 2e-13 * extent)

    def moved(x: np.ndarray) -> np.ndarray:
        p, _ = substep(body, x, np.zeros_like(x), inverse_mass, order, h, iterations, gravity, damping_time, 0.0, way)
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
