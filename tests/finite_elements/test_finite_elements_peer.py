"""A second opinion: scikit-fem on the same tetrahedra, and the continuum that the tables' mesh errors are told against."""

from __future__ import annotations

import numpy as np
import pytest
from bar_mesh import bar

from softlab.bench.reference import elastic_materials as materials
from softlab.bench.reference import finite_elements as fem

skfem = pytest.importorskip("skfem", reason="scikit-fem is not installed: pip install scikit-fem")
YOUNG, POISSON = 1e6, 0.3


def sag(mesh: object, element: object) -> tuple[np.ndarray, float]:
    """(displacements (n, 3) of the mesh's vertices [m], the load's work over the load [m]): 0.01 N spread evenly over the
    end x = 1, the end x = 0 clamped."""
    from skfem.models.elasticity import linear_elasticity

    mu, lam = materials.lame(YOUNG, POISSON)
    basis = skfem.Basis(mesh, skfem.ElementVector(element), intorder=4)
    stiffness = skfem.asm(linear_elasticity(float(lam), float(mu)), basis)
    end = mesh.facets_satisfying(lambda x: np.abs(x[0] - 1) < 1e-9, boundaries_only=True)  # type: ignore[attr-defined]
    face = skfem.FacetBasis(mesh, skfem.ElementVector(element), facets=end, intorder=4)
    load = skfem.asm(skfem.LinearForm(lambda v, w: -0.01 / 0.01 * v[1]), face)
    assert load.sum() == pytest.approx(-0.01, rel=1e-12)
    held = basis.get_dofs(lambda x: np.abs(x[0]) < 1e-9)
    moved = skfem.solve(*skfem.condense(stiffness, load, D=held))
    return moved[basis.nodal_dofs].T, float(load @ moved / 0.01)


@pytest.mark.parametrize("per_voxel", [5, 6])
def test_the_same_tetrahedra(per_voxel: int) -> None:
    """To 1e-9: two assemblies, two loads, one linear system."""
    made = bar(2, per_voxel)
    moved, work = sag(skfem.MeshTet(made.position.T.copy(), made.tetrahedra.T.copy()), skfem.ElementTetP1())
    load = fem.spread_evenly(made.position, made.tetrahedra, made.tip, (0.0, -0.01, 0.0))
    ours = fem.linear_static(made.position, made.tetrahedra, YOUNG, POISSON, made.clamped, load)
    np.testing.assert_allclose(moved, ours, rtol=0, atol=1e-9 * np.abs(ours).max())
    assert work == pytest.approx(float((load * ours).sum() / 0.01), rel=1e-9)


def test_the_continuum() -> None:
    """27-node hexahedra: 3.99879e-4 m with three across, to the digits printed; the table's 3.57e-4 m of four voxels of five
    tetrahedra across is 11 % of mesh error."""
    counts = (30, 3, 3)
    x, y, z = (np.linspace(*ends, count + 1) for ends, count in zip(((0, 1), (0, 0.1), (0, 0.1)), counts, strict=True))
    _, work = sag(skfem.MeshHex.init_tensor(x, y, z), skfem.ElementHex2())
    assert work == pytest.approx(3.99879e-4, rel=1e-4)
