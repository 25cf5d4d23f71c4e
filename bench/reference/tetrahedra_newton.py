"""Implicit Euler of tetrahedral bodies in slow, plain NumPy float64, solved to convergence with dense matrices.

From the principal stretches, without model/formulas or a backend; from the model it takes the mesh. A substep of h
minimises (S. Martin et al., "Example-Based Elastic Materials", ACM TOG 2011, eq. 3, and damping in proportion to
stiffness)

 sum m / (2 h^2) |x - y|^2 + sum V (W(F(x)) + tau / h (mu |E - E_0|^2 + lambda / 2 tr(E - E_0)^2)),

y = x_0 + h v_0 + h^2 a, E = (F'F - I) / 2 Green's strain, E_0 that at the beginning of the substep. The stiffness is by
central differences of the stress, without the formulas of the tangent.

At order 2 a substep has the two stages of R. Alexander, SIAM J. Numer. Anal. 14 (1977), table 1, s = 2, as written
there, and the strain is a separate quantity, whose rate in a stage is its change over the stage's own part of h.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from softlab.model.particles.tetrahedra_set import TetrahedraSet
from softlab.model.scene.scene import Scene

IMPLICIT = 1 - 2**-0.5  # implicit weight of each stage
STEP = 1e-6  # difference of F's entries: the error of differences is about its square
ENOUGH = 1e-9  # residual relative to the first one, or to the rounding of forces in float64
MOST = 200

Stress = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]  # F (tetrahedra, 3, 3) -> (W, P)


def stress(mesh: TetrahedraSet, gradient: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (W (tetrahedra,) [Pa], P (tetrahedra, 3, 3) [Pa]) of F `gradient`."""
    u, s, v = np.linalg.svd(gradient)
    reflected = np.linalg.det(u) * np.linalg.det(v) < 0
    s[reflected, 2] *= -1
    u[reflected, :, 2] *= -1
    mu, lame = mesh.lame()
    kind = np.array([part.material for part in mesh.parts])[mesh.body]
    x, y, z = s.T
    volume, cofactor, off = x * y * z, np.stack([y * z, z * x, x * y], axis=1), s - 1
    pressure = lame + mu
    rest = 1 + mu / pressure
    bulk = lame * (volume - 1)
    fixed = mu * (off**2).sum(axis=1) + lame / 2 * (volume - 1) ** 2, 2 * mu[:, None] * off + bulk[:, None] * cofactor
    along = off.sum(axis=1)
    plain = mu * (off**2).sum(axis=1) + lame / 2 * along**2, 2 * mu[:, None] * off + (lame * along)[:, None]
    hookean = (
        mu / 2 * ((s**2).sum(axis=1) - 3) + pressure / 2 * ((volume - rest) ** 2 - (1 - rest) ** 2),
        mu[:, None] * s + (pressure * (volume - rest))[:, None] * cofactor,
    )
    chosen = [kind == "fixed-corotated", kind == "corotated", kind == "neo-hookean"]
    energy = np.select(chosen, [fixed[0], plain[0], hookean[0]])
    slope = np.select([one[:, None] for one in chosen], [fixed[1], plain[1], hookean[1]])
    return energy, (u * slope[:, None, :]) @ v


def rows_of_corners(mesh: TetrahedraSet) -> np.ndarray:
    """Return the weight of each corner in F: (tetrahedra, 4, 3) [1/m]."""
    others = mesh.rest_inverse
    return np.concatenate([-others.sum(axis=1, keepdims=True), others], axis=1)


def gradient_of(mesh: TetrahedraSet, position: np.ndarray) -> np.ndarray:
    """Return F: (tetrahedra, 3, 3)."""
    return np.einsum("tai,taj->tij", position[mesh.tetrahedra], rows_of_corners(mesh))


def energy_and_force(mesh: TetrahedraSet, position: np.ndarray, stress: Stress) -> tuple[float, np.ndarray]:
    """Return (energy [J], its gradient (particles, 3) [N])."""
    rows = rows_of_corners(mesh)
    energy, p = stress(gradient_of(mesh, position))
    pull = np.zeros_like(position)
    np.add.at(pull, mesh.tetrahedra, mesh.volume[:, None, None] * np.einsum("tij,taj->tai", p, rows))
    return float((energy * mesh.volume).sum()), pull


def strain_of(gradient: np.ndarray) -> np.ndarray:
    """Return Green's strain: (tetrahedra, 3, 3)."""
    return (np.swapaxes(gradient, 1, 2) @ gradient - np.eye(3)) / 2


def element_stiffness(mesh: TetrahedraSet, position: np.ndarray, positive: bool, stress: Stress) -> np.ndarray:
    """Return the stiffness of each element (tetrahedra, 12, 12) [N/m]; without negative eigenvalues if `positive`."""
    rows, count = rows_of_corners(mesh), len(mesh.tetrahedra)
    gradient = gradient_of(mesh, position)
    tangent = np.zeros((count, 9, 9))
    for entry in range(9):
        shift = np.zeros((3, 3))
        shift.flat[entry] = STEP
        change = (stress(gradient + shift)[1] - stress(gradient - shift)[1]) / (2 * STEP)
        tangent[:, :, entry] = change.reshape(-1, 9)
    tangent = (tangent + np.swapaxes(tangent, 1, 2)) / 2
    if positive:
        value, vector = np.linalg.eigh(tangent)
        tangent = (vector * np.maximum(value, 0)[:, None, :]) @ np.swapaxes(vector, 1, 2)
    spread = np.einsum("taj,ik->taijk", rows, np.eye(3))  # dF_kj by x_ai
    spread = np.swapaxes(spread, 3, 4).reshape(count, 12, 9)
    return mesh.volume[:, None, None] * (spread @ tangent @ np.swapaxes(spread, 1, 2))


def assembled(mesh: TetrahedraSet, elements: np.ndarray) -> np.ndarray:
    """Return the assembled matrix: (3 particles, 3 particles)."""
    size = 3 * mesh.particle_count
    whole = np.zeros((size, size))
    place = (3 * mesh.tetrahedra[:, :, None] + np.arange(3)).reshape(-1, 12)
    np.add.at(whole, (place[:, :, None], place[:, None, :]), elements)
    return whole


def damped_stress(mesh: TetrahedraSet, strain: np.ndarray, h: float) -> Stress:
    """Return `stress` plus that of dampers, with `strain` (tetrahedra, 3, 3) at the beginning of a stage of h."""
    mu, lame = (one * mesh.matter.damping / h for one in mesh.lame())

    def total(gradient: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        energy, p = stress(mesh, gradient)
        change = strain_of(gradient) - strain
        trace = np.trace(change, axis1=1, axis2=2)
        lost = mu * (change**2).sum(axis=(1, 2)) + lame / 2 * trace**2
        pull = 2 * mu[:, None, None] * change + (lame * trace)[:, None, None] * np.eye(3)
        return energy + lost, p + gradient @ pull

    return total


def substep(
    mesh: TetrahedraSet, before: np.ndarray, target: np.ndarray, mass: np.ndarray, free: np.ndarray, h: float,
    strain: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Return positions (particles, 3) [m] at the end. `target`: y; `free`: mask (particles,); `strain`: E_0."""
    inertia = np.repeat(mass / h**2, 3)
    resisting, unknown = damped_stress(mesh, strain, h), np.repeat(free, 3)

    def potential(x: np.ndarray) -> tuple[float, np.ndarray]:
        energy, pull = energy_and_force(mesh, x, resisting)
        away = (x - target).ravel()
        return energy + float(inertia @ away**2) / 2, np.where(unknown, pull.ravel() + inertia * away, 0.0)

    x = before.copy()
    here, slope = potential(x)
    first = max(np.linalg.norm(slope), 1e-6 * np.linalg.norm(inertia))
    for _ in range(MOST):
        if np.linalg.norm(slope) <= ENOUGH * first:
            return x
        for positive in (False, True):
            whole = assembled(mesh, element_stiffness(mesh, x, positive, resisting)) + np.diag(inertia)
            try:
                np.linalg.cholesky(whole[np.ix_(unknown, unknown)])
                break
            except np.linalg.LinAlgError:
                continue
        step = np.zeros_like(slope)
        step[unknown] = np.linalg.solve(whole[np.ix_(unknown, unknown)], -slope[unknown])
        fraction = 1.0
        while fraction > 1e-8:
            there, left = potential(x + fraction * step.reshape(-1, 3))
            lower = there <= here + 1e-4 * fraction * float(slope @ step)
            if lower or np.linalg.norm(left) < 0.5 * np.linalg.norm(slope):
                break
            fraction /= 2
        else:
            return x  # the limit of the differences
        x, here, slope = x + fraction * step.reshape(-1, 3), there, left
    return x


def simulate(scene: Scene, steps: int, position: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (position [m], velocity [m/s]), (particles, 3) float64, after `steps` steps.

    With gravity and the masses' damper, without colliders.
    """
    mesh, method, gravity = scene.tetrahedra_set, scene.method, scene.gravity
    inverse = 1 / mesh.masses
    inverse[mesh.pinned_vertices] = 0
    free, mass, h = inverse > 0, mesh.masses, method.dt / method.substeps
    fall = np.array([0.0, -gravity.acceleration if gravity and gravity.enabled else 0.0, 0.0])
    drag = (scene.damping.coefficient if scene.damping else 0.0) * inverse[:, None]

    def euler(x: np.ndarray, v: np.ndarray, h: float, strain: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        target = np.where(free[:, None], x + h * (v * (1 - h * drag) + h * fall), x)
        after = substep(mesh, x, target, mass, free, h, strain)
        return after, (after - x) / h

    x, v = np.array(position, dtype=np.float64), np.array(velocity, dtype=np.float64)
    for _ in range(steps * method.substeps):
        strain = strain_of(gradient_of(mesh, x))
        if method.order == 1:
            x, v = euler(x, v, h, strain)
            continue
        first, speed = euler(x, v, IMPLICIT * h, strain)
        slope = speed, (speed - v) / (IMPLICIT * h)
        rest = (1 - IMPLICIT) * h
        strain = strain + rest * (strain_of(gradient_of(mesh, first)) - strain) / (IMPLICIT * h)
        x, v = euler(x + rest * slope[0], v + rest * slope[1], IMPLICIT * h, strain)
    return x, v
