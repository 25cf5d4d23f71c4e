"""Energy per volume W(F) of the materials of tetrahedra, and the first Piola-Kirchhoff stress P = dW/dF.

W = k_D C_D^2 / 2 + k_H C_H^2 / 2, whose two terms are the two constraints of each material in
formulas/constraints/tetrahedron.py. The neo-Hookean W is split here as by its authors: C_D = |F|, k_D = mu, C_H = J -
alpha, k_H = lambda + mu (model/tetrahedra/material.py). `shape` is k_D, `pressure` k_H, `rest` the J at which C_H is 0.
So
  fixed corotated   P = k_D (F - R) + k_H (J - 1) C              C the cofactors of F, R the rotation nearest to F
  corotated         P = k_D (F - R) + k_H (tr(R'F) - 3) R
  neo-Hookean       P = k_D F + k_H (J - alpha) C
(T. Sifakis, J. Barbic, "FEM Simulation of 3D Deformable Solids", SIGGRAPH 2012 courses, part 1, section 3; A. Stomakhin
et al., SCA 2012, eq. 4; B. Smith, F. de Goes, T. Kim, TOG 37 (2018), section 3.4.) The derivative of C_H is G = C, or
R, which is also all that the stiffness needs. Where the constants are multiplied by a volume, so are energies and
stresses.
"""

from __future__ import annotations

from softlab.model.base.variant import FEATURE, formula
from softlab.model.formulas.constraints.tetrahedron import COROTATED, HOOKEAN
from softlab.model.formulas.elastic import deformation
from softlab.model.formulas.elastic.deformation import cofactor, determinant, inner_product, rotation

OPERATIONS_STRESS = 9 + 2 + 27  # F - R, the pressure, the sum of both terms


def operations(material: int, item: int) -> int:
    """Count the operations of one stress for a known F, on numbers of `item` bytes."""
    turn = 0 if material == HOOKEAN else deformation.OPERATIONS_ROTATION[item]
    volume = 17 if material == COROTATED else deformation.OPERATIONS_COFACTOR + deformation.OPERATIONS_DETERMINANT
    return OPERATIONS_STRESS + turn + volume


@formula
def parts_of(f, rest):
    """Return (matrix D whose square is C_D^2, C_H, its derivative G by F, R or, where the material has none, F)."""
    if FEATURE.material == HOOKEAN:
        g = cofactor(f)
        return f, determinant(f, g) - rest, g, f
    r = rotation(f)
    d = (
        f[0] - r[0], f[1] - r[1], f[2] - r[2], f[3] - r[3], f[4] - r[4], f[5] - r[5],
        f[6] - r[6], f[7] - r[7], f[8] - r[8],
    )  # fmt: skip
    if FEATURE.material == COROTATED:
        return d, inner_product(r, f) - 3.0, r, r
    g = cofactor(f)
    return d, determinant(f, g) - rest, g, r


@formula
def energy(f, shape, pressure, rest):
    """W [Pa]. For the neo-Hookean material it is not 0 at rest."""
    d, violation, _, _ = parts_of(f, rest)
    return 0.5 * (shape * inner_product(d, d) + pressure * (violation * violation))


@formula
def stress(f, shape, pressure, rest):
    """Return (P, G, R, k_H C_H), matrices as nine numbers by rows. R is F where the material does not use it."""
    d, violation, g, r = parts_of(f, rest)
    p = pressure * violation
    return (
        (
            shape * d[0] + p * g[0], shape * d[1] + p * g[1], shape * d[2] + p * g[2],
            shape * d[3] + p * g[3], shape * d[4] + p * g[4], shape * d[5] + p * g[5],
            shape * d[6] + p * g[6], shape * d[7] + p * g[7], shape * d[8] + p * g[8],
        ), g, r, p,
    )  # fmt: skip
