"""Materials of tetrahedra, in float64 on the host: energies and stresses for checks and display, and the kernels'
values.

Energies per volume of the stretches s (the singular values of F, the smallest with the sign of det F) and J = det F,
with mu and lambda of Young's modulus and Poisson's ratio:
  fixed corotated   mu sum (s - 1)^2 + lambda / 2 (J - 1)^2          (A. Stomakhin et al., SCA 2012, eq. 4)
  corotated         mu sum (s - 1)^2 + lambda / 2 (sum (s - 1))^2    (M. Mueller, M. Gross, GI 2004)
  neo-Hookean       mu / 2 (sum s^2 - 3) + (lambda + mu) / 2 (J - alpha)^2, less its value at rest; alpha = 1 + mu /
                    (lambda + mu) (B. Smith, F. de Goes, T. Kim, TOG 37 (2018), section 3.4, without the logarithm);
                    equal to mu / 2 (sum s^2 + J^2 - 4 J) + lambda / 2 (J - 1)^2, where voxels that conserve their
                    volume use the voxel's J in the last term
"""

from __future__ import annotations

import numpy as np

from softlab.model.formulas.constraints.tetrahedron import COUNT, MATERIALS
from softlab.model.formulas.constraints.voxel_volume import COUNT as VOXEL_COUNT
from softlab.model.geometry.arithmetic.ordered import norm
from softlab.model.particles.tetrahedra_set import TetrahedraSet

LEAST_RATIO = 0.05  # of volumes: smallest divisor of a stress, which would be unbounded at 0
LEAST_PRESSURE = 1e-12  # of the stiffness against shape changes: a Poisson ratio of 0 would need an infinite compliance


def deformation(body_set: TetrahedraSet, position: np.ndarray) -> np.ndarray:
    """Return F at `position` (particles, 3), (tetrahedra, 3, 3) float64."""
    corners = np.asarray(position, np.float64)[body_set.tetrahedra]
    edges: np.ndarray = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)
    return edges @ body_set.rest_inverse


def stretches(gradient: np.ndarray) -> np.ndarray:
    """Return the singular values, descending, the last one with the sign of the determinant, (tetrahedra, 3)
    float64."""
    singular: np.ndarray = np.linalg.svd(gradient, compute_uv=False)
    singular[:, 2] *= np.where(np.linalg.det(gradient) < 0, -1.0, 1.0)
    return singular


def volume_ratios(body_set: TetrahedraSet, ratio: np.ndarray) -> np.ndarray:
    """Return det F, (tetrahedra,) float64: `ratio` (tetrahedra,), or its mean by volume over tetrahedra with a common
    volume."""
    if body_set.patch[-1] == len(ratio) - 1:
        return ratio
    volume = body_set.whole_volume
    whole = np.bincount(body_set.patch, volume)
    mean: np.ndarray = (np.bincount(body_set.patch, volume * ratio) / whole)[body_set.patch]
    return mean


def material_of(body_set: TetrahedraSet) -> np.ndarray:
    """Return the index in MATERIALS of each tetrahedron, (tetrahedra,) int64."""
    kinds: np.ndarray = np.array([MATERIALS.index(part.material) for part in body_set.parts], np.int64)[body_set.body]
    return kinds


def energies(body_set: TetrahedraSet, position: np.ndarray) -> np.ndarray:
    """Return the energy of each tetrahedron, (tetrahedra,) float64 [J]; nan where a position is not finite."""
    gradient = deformation(body_set, position)
    finite = np.isfinite(gradient).all(axis=(1, 2))
    s = stretches(np.where(finite[:, None, None], gradient, 0.0))
    mu, lame = body_set.lame()
    local = np.linalg.det(np.where(finite[:, None, None], gradient, 0.0))
    volume_ratio, off = volume_ratios(body_set, local), s - 1
    alpha = rest_ratio(mu, lame)
    hookean = mu / 2 * ((s**2).sum(axis=1) - 3) + (lame + mu) / 2 * ((volume_ratio - alpha) ** 2 - (1 - alpha) ** 2)
    hookean += mu / 2 * (local - volume_ratio) * (local + volume_ratio - 4)
    shape = mu * (off**2).sum(axis=1)
    density = np.choose(
        material_of(body_set),
        [shape + lame / 2 * (volume_ratio - 1) ** 2, shape + lame / 2 * off.sum(axis=1) ** 2, hookean],
    )
    return np.where(finite, density * body_set.volume, np.nan)


def von_mises(body_set: TetrahedraSet, position: np.ndarray) -> np.ndarray:
    """Return the von Mises stress of each tetrahedron without dampers, (tetrahedra,) float64 [Pa].

    sqrt(((t1 - t2)^2 + (t2 - t3)^2 + (t3 - t1)^2) / 2) of its principal values t = s dPsi/ds / J, J at least
    LEAST_RATIO; nan where a position is not finite.
    """
    gradient = deformation(body_set, position)
    finite = np.isfinite(gradient).all(axis=(1, 2))
    s = stretches(np.where(finite[:, None, None], gradient, 0.0))
    mu, lame = (one[:, None] for one in body_set.lame())
    volume_ratio = volume_ratios(body_set, np.linalg.det(np.where(finite[:, None, None], gradient, 0.0)))[:, None]
    shape = 2 * mu * (s - 1) * s
    pulled = np.select(
        [kind[:, None] for kind in (material_of(body_set) == k for k in range(2))],
        [shape + lame * (volume_ratio - 1) * volume_ratio, shape + lame * (s - 1).sum(axis=1, keepdims=True) * s],
        mu * s**2 + (lame + mu) * (volume_ratio - rest_ratio(mu, lame)) * volume_ratio,
    )
    principal = pulled / np.maximum(np.abs(volume_ratio), LEAST_RATIO)
    apart = principal - np.roll(principal, 1, axis=1)
    return np.where(finite, np.sqrt((apart**2).sum(axis=1) / 2), np.nan)


def largest_strain(body_set: TetrahedraSet, position: np.ndarray) -> np.ndarray:
    """Return the largest |stretch - 1| of each tetrahedron, (tetrahedra,) float64; nan where a position is not
    finite."""
    gradient = deformation(body_set, position)
    finite = np.isfinite(gradient).all(axis=(1, 2))
    s = stretches(np.where(finite[:, None, None], gradient, 0.0))
    return np.where(finite, np.abs(s - 1).max(axis=1), np.nan)


def at_particles(body_set: TetrahedraSet, value: np.ndarray) -> np.ndarray:
    """Return the volume-weighted mean of a value (tetrahedra,) over the tetrahedra at each particle, (particles,); 0
    where there is none."""
    weight = np.repeat(body_set.volume, 4)
    corner = body_set.tetrahedra.ravel()
    total = np.bincount(corner, weight * np.repeat(value, 4), body_set.particle_count)
    mean: np.ndarray = total / np.maximum(np.bincount(corner, weight, body_set.particle_count), np.finfo(float).tiny)
    return mean


def rest_ratio(mu: np.ndarray, lame: np.ndarray) -> np.ndarray:
    """Return alpha of the neo-Hookean material: the J at which its second term is 0."""
    return 1 + mu / (lame + mu)


def stiffnesses(body_set: TetrahedraSet, chosen: np.ndarray) -> np.ndarray:
    """Return V k_D, V k_H [J] of the `chosen` tetrahedra (n,), alpha, or 1, and a damper's time [s], (n, 4) float64."""
    mu, lame = (one[chosen] for one in body_set.lame())
    hookean = np.array([part.material == "neo-hookean" for part in body_set.parts])[body_set.body[chosen]]
    pressure, alpha = np.where(hookean, lame + mu, lame), np.where(hookean, rest_ratio(mu, lame), 1.0)
    return _values(body_set, chosen, pressure, alpha)


def row_stiffnesses(body_set: TetrahedraSet, chosen: np.ndarray) -> np.ndarray:
    """Return the values of `stiffnesses` for position-based rows, each of which is at rest on its own: k_H is lambda,
    and J is 1 at rest."""
    return _values(body_set, chosen, body_set.lame()[1][chosen], np.ones(len(chosen)))


def _values(body_set: TetrahedraSet, chosen: np.ndarray, pressure: np.ndarray, rest: np.ndarray) -> np.ndarray:
    mu, volume = body_set.lame()[0][chosen], body_set.volume[chosen]
    hookean = np.array([part.material == "neo-hookean" for part in body_set.parts])[body_set.body[chosen]]
    shape = np.where(hookean, mu, 2 * mu)
    pressure = np.maximum(pressure, LEAST_PRESSURE * shape)
    return np.column_stack([shape * volume, pressure * volume, rest, body_set.matter.damping[chosen]])


def constraint_values(body_set: TetrahedraSet, chosen: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the values of the two constraints of the `chosen` tetrahedra (n,), (n, COUNT) float64 (see the formula).

    Their corners are in the order of `corners` (n, 4).
    """
    stiff = row_stiffnesses(body_set, chosen)
    values = np.column_stack([framed_rest(body_set.position[corners]), 1 / stiff[:, :2], stiff[:, 2:]])
    assert values.shape[1] == COUNT
    return values


def framed_rest(corners: np.ndarray) -> np.ndarray:
    """Return the rows of B of tetrahedra with rest corners (n, 4, 3) [m], (n, 6) float64 [1/m].

    They are in the frame of each one's first edge and first two edges (model/formulas/elastic/deformation.py).
    """
    e, f, g = (corners[:, k] - corners[:, 0] for k in (1, 2, 3))
    xx = norm(e)
    x = e / xx[:, None]
    xy, xz = (x * f).sum(axis=1), (x * g).sum(axis=1)
    across = f - xy[:, None] * x
    yy = norm(across)
    y = across / yy[:, None]
    yz, zz = (y * g).sum(axis=1), (np.cross(x, y) * g).sum(axis=1)
    return np.column_stack(
        [1 / xx, -xy / (xx * yy), (xy * yz - xz * yy) / (xx * yy * zz), 1 / yy, -yz / (yy * zz), 1 / zz]
    )


def voxel_values(body_set: TetrahedraSet, chosen: np.ndarray, run: int) -> np.ndarray:
    """Return the values of the constraint of each voxel's volume, (voxels, COUNT) float64 (voxel_volume.py).

    The `chosen` tetrahedra (n,) are in runs of `run` per voxel; several materials in one are averaged.
    """
    stiff, volume = row_stiffnesses(body_set, chosen).reshape(-1, run, 4), body_set.volume[chosen].reshape(-1, run)
    whole, pressure = body_set.whole_volume[chosen].reshape(-1, run).sum(axis=1), stiff[..., 1].sum(axis=1)
    rest, time = ((volume * stiff[..., k]).sum(axis=1) / volume.sum(axis=1) for k in (2, 3))
    values = np.column_stack([1 / (6 * whole), 1 / pressure, rest, time])
    assert values.shape[1] == VOXEL_COUNT
    return values
