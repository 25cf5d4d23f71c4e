"""Elastic materials in slow, plain NumPy float64 from the papers: energy, stress and tangent of many tetrahedra.

With the singular values s of the deformation gradient F, J = det F, and F = R S, R a rotation also where J < 0 (the
smallest singular value has the sign):

- `corotated` (linear): mu |S - I|^2 + lambda/2 tr^2(S - I);
- `fixed-corotated`: mu |S - I|^2 + lambda/2 (J - 1)^2. Stomakhin et al., "Energetically Consistent Invertible
  Elasticity", SCA 2012;
- `neo-hookean`: mu/2 (|F|^2 - 3) + lambda'/2 ((J - alpha)^2 - (1 - alpha)^2), lambda' = lambda + mu,
  alpha = 1 + mu/lambda'. Smith, de Goes, Kim, "Stable Neo-Hookean Flesh Simulation", ACM TOG 2018, without its
  logarithm. lambda' gives the requested Young's modulus and Poisson's ratio; with lambda instead, the bar is 10 % too
  soft at 0.3.

Arrays: F (..., 3, 3); mu, lambda [Pa] scalars or (...); energies (...) [J/m^3]; stresses P = d Psi / dF (..., 3, 3)
[Pa]; tangents dP/dF (..., 9, 9) [Pa], the nine in row-major order: 3 i + j of F_ij.
"""

from __future__ import annotations

import numpy as np

MATERIALS = ("corotated", "fixed-corotated", "neo-hookean")

_LEVI_CIVITA = np.zeros((3, 3, 3))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _LEVI_CIVITA[_i, _j, _k], _LEVI_CIVITA[_i, _k, _j] = 1.0, -1.0
# d cof_ij / dF_kl = sum over a, b of [i, k, a] [j, l, b] F_ab
_DOUBLE = np.einsum("ika,jlb->ijklab", _LEVI_CIVITA, _LEVI_CIVITA).reshape(81, 9)
_TWISTS = ((1, 2), (2, 0), (0, 1))


def lame(young: np.ndarray | float, poisson: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
    """Return (mu, lambda) [Pa] of Young's modulus [Pa] and Poisson's ratio in (-1, 0.5)."""
    young, poisson = np.asarray(young, dtype=np.float64), np.asarray(poisson, dtype=np.float64)
    if not ((young > 0).all() and (poisson > -1).all() and (poisson < 0.5).all()):
        raise ValueError("young > 0 and -1 < poisson < 0.5")
    return young / (2 * (1 + poisson)), young * poisson / ((1 + poisson) * (1 - 2 * poisson))


def decompose(gradient: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return F = U diag(s) W': rotations U and W' (..., 3, 3), s (..., 3), of which the last may be negative.

    For F = 0, U W' = I.
    """
    u, s, w = np.linalg.svd(gradient)
    nothing = (s[..., :1] == 0)[..., None]
    u, w = np.where(nothing, np.eye(3), u), np.where(nothing, np.eye(3), w)
    sign_u, sign_w = np.sign(np.linalg.det(u)), np.sign(np.linalg.det(w))
    u, w, s = u.copy(), w.copy(), s.copy()
    u[..., :, 2] *= sign_u[..., None]
    w[..., 2, :] *= sign_w[..., None]
    s[..., 2] *= sign_u * sign_w
    return u, s, w


def rotation(gradient: np.ndarray) -> np.ndarray:
    """Return the rotation nearest to F: (..., 3, 3)."""
    u, _, w = decompose(gradient)
    return u @ w


def cofactor(gradient: np.ndarray) -> np.ndarray:
    """Return dJ/dF (..., 3, 3); its columns are the cross products of the other two columns of F."""
    a, b, c = (gradient[..., :, column] for column in range(3))
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-1)


def _cofactor_slope(gradient: np.ndarray) -> np.ndarray:
    """Return the second derivatives of J: (..., 9, 9)."""
    flat = gradient.reshape(*gradient.shape[:-2], 9)
    return (flat @ _DOUBLE.T).reshape(*flat.shape[:-1], 9, 9)


def _rotation_slope(gradient: np.ndarray) -> np.ndarray:
    """Return dR/dF (..., 9, 9), one mode per pair of axes, which rotates by 2 / (s_i + s_j).

    Smith, de Goes, Kim, "Analytic Eigensystems", ACM TOG 2019. Where that sum is 0 the rotation is discontinuous, and
    the mode is left out.
    """
    u, s, w = decompose(gradient)
    slope = np.zeros((*gradient.shape[:-2], 9, 9))
    for i, j in _TWISTS:
        mode = u[..., :, i, None] * w[..., None, j, :] - u[..., :, j, None] * w[..., None, i, :]
        flat = mode.reshape(*mode.shape[:-2], 9)
        sum_of_two = s[..., i] + s[..., j]
        rate = np.divide(1.0, sum_of_two, out=np.zeros_like(sum_of_two), where=np.abs(sum_of_two) > 1e-12)
        slope += rate[..., None, None] * flat[..., :, None] * flat[..., None, :]
    return slope


def _constants(mu: np.ndarray, lam: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return lambda' and alpha of the stable neo-Hookean material."""
    lam_here = lam + mu
    return lam_here, 1 + mu / lam_here


def energy_density(material: str, gradient: np.ndarray, mu: np.ndarray, lam: np.ndarray) -> np.ndarray:
    """Return the energy density (...) [J/m^3]; `neo-hookean` accepts complex F too (complex step)."""
    determinant = np.linalg.det(gradient)
    if material == "neo-hookean":
        lam_here, alpha = _constants(mu, lam)
        square = (gradient * gradient).sum(axis=(-2, -1))
        return mu / 2 * (square - 3) + lam_here / 2 * ((determinant - alpha) ** 2 - (1 - alpha) ** 2)
    stretch = decompose(gradient)[1] - 1
    shape = mu * (stretch**2).sum(axis=-1)
    if material == "fixed-corotated":
        return shape + lam / 2 * (determinant - 1) ** 2
    if material == "corotated":
        return shape + lam / 2 * stretch.sum(axis=-1) ** 2
    raise ValueError(f"material {material!r}: one of {MATERIALS}")


def stress(material: str, gradient: np.ndarray, mu: np.ndarray, lam: np.ndarray) -> np.ndarray:
    """Return the first Piola-Kirchhoff stress: (..., 3, 3) [Pa]."""
    mu, lam = (np.asarray(value)[..., None, None] for value in (mu, lam))
    determinant = np.linalg.det(gradient)[..., None, None]
    if material == "neo-hookean":
        lam_here, alpha = _constants(mu, lam)
        return mu * gradient + lam_here * (determinant - alpha) * cofactor(gradient)
    u, s, w = decompose(gradient)
    turn = u @ w
    if material == "fixed-corotated":
        return 2 * mu * (gradient - turn) + lam * (determinant - 1) * cofactor(gradient)
    if material == "corotated":
        return 2 * mu * (gradient - turn) + lam * (s.sum(axis=-1) - 3)[..., None, None] * turn
    raise ValueError(f"material {material!r}: one of {MATERIALS}")


def tangent(material: str, gradient: np.ndarray, mu: np.ndarray, lam: np.ndarray) -> np.ndarray:
    """Return dP/dF (..., 9, 9) [Pa], exact; not positive definite everywhere."""
    mu, lam = (np.asarray(value)[..., None, None] for value in (mu, lam))
    determinant = np.linalg.det(gradient)[..., None, None]
    slope = cofactor(gradient).reshape(*gradient.shape[:-2], 9)
    along = slope[..., :, None] * slope[..., None, :]
    if material == "neo-hookean":
        lam_here, alpha = _constants(mu, lam)
        return mu * np.eye(9) + lam_here * (along + (determinant - alpha) * _cofactor_slope(gradient))
    shape = 2 * mu * (np.eye(9) - _rotation_slope(gradient))
    if material == "fixed-corotated":
        return shape + lam * (along + (determinant - 1) * _cofactor_slope(gradient))
    if material == "corotated":
        u, s, w = decompose(gradient)
        turn = (u @ w).reshape(slope.shape)
        trace = (s.sum(axis=-1) - 3)[..., None, None]
        return shape + lam * (turn[..., :, None] * turn[..., None, :] + trace * _rotation_slope(gradient))
    raise ValueError(f"material {material!r}: one of {MATERIALS}")


def linear_tangent(mu: np.ndarray, lam: np.ndarray) -> np.ndarray:
    """Return the tangent of Hooke's law, mu (G + G') + lambda tr(G) I of a displacement gradient G: (..., 9, 9) [Pa]."""
    one = np.eye(3)
    transposition = np.einsum("il,jk->ijkl", one, one).reshape(9, 9)
    volume = np.einsum("ij,kl->ijkl", one, one).reshape(9, 9)
    mu, lam = (np.asarray(value)[..., None, None] for value in (mu, lam))
    return mu * (np.eye(9) + transposition) + lam * volume
