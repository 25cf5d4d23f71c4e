"""The judge of tetrahedra, small displacements: patches, rigid motions, and the tabled sags and frequencies of a bar.

The bar of the tables: 1 m x 0.1 m x 0.1 m, E 1e6 Pa, density 1000 kg/m^3, `across` voxels along a side, each cut into 5 or 6
tetrahedra. 27-node hexahedra, three across, sag by 3.99879e-4 m at nu 0.3 under the same load: the rest is mesh error.
"""

from __future__ import annotations

import numpy as np
import pytest
from bar_mesh import Bar, bar, cube

from softlab.bench.reference import elastic_materials as materials
from softlab.bench.reference import finite_elements as fem
from softlab.bench.reference.finite_elements_newton import nonlinear_static

YOUNG = 1e6
each_material = pytest.mark.parametrize("material", materials.MATERIALS)
SAGS = {  # per voxel, nu -> 1, 2 and 4 across [m]: under 0.01 N, spread over the end
    (6, 0.3): (8.844e-5, 2.0305e-4, 3.1731e-4),
    (6, 0.45): (4.401e-5, 1.2056e-4, 2.4113e-4),
    (6, 0.499): (5.08e-6, 8.48e-6, 2.13e-5),
    (5, 0.3): (1.4276e-4, 2.7106e-4, 3.5700e-4),
    (5, 0.45): (1.3170e-4, 2.5756e-4, 3.4704e-4),
    (5, 0.499): (1.2212e-4, 2.3473e-4, 3.2463e-4),
}


def end_shares(made: Bar, across: int) -> np.ndarray:
    """(n,): of a force spread evenly over the end, what each vertex gets: a quarter of each voxel's face for its corners."""
    place = np.round((made.position[:, 1:] + 0.05) / (0.1 / across)).astype(int)
    inside = (place > 0) & (place < across)
    return np.where(made.tip, np.where(inside, 2, 1).prod(axis=1) / (4 * across**2), 0.0)


def sag(made: Bar, poisson: float, load: np.ndarray) -> float:
    """[m]: how far the end goes down by Hooke's law, each vertex by its share of the load."""
    moved = fem.linear_static(made.position, made.tetrahedra, YOUNG, poisson, made.clamped, load)
    return -float((moved * load).sum() / load.sum())


@pytest.mark.parametrize(("across", "place"), [(1, 0), (2, 1), (4, 2)])
@pytest.mark.parametrize(("per_voxel", "poisson"), list(SAGS))
def test_sags_of_the_bar(per_voxel: int, poisson: float, across: int, place: int) -> None:
    """To half of the last digit printed. The tables' load is a quarter of each voxel's face for its corners; spread over the
    tetrahedra's triangles it is another one, which at one voxel across differs by the triangles' asymmetry."""
    made, printed = bar(across, per_voxel), SAGS[per_voxel, poisson][place]
    found = sag(made, poisson, end_shares(made, across)[:, None] * np.array([0, -0.01, 0]))
    assert found == pytest.approx(printed, abs=0.51e-8)
    over_triangles = fem.spread_evenly(made.position, made.tetrahedra, made.tip, (0.0, -0.01, 0.0))
    assert sag(made, poisson, over_triangles) == pytest.approx(found, rel=1e-3)


FREQUENCIES = {  # per voxel, across -> kind: Hz, nu 0.3, lumped masses
    (5, 1): {"bending": (4.8062, 4.8084), "torsion": (11.2737,), "stretching": (15.6999,), "clamped": 0.8334},
    (5, 2): {"bending": (3.7184, 3.7184), "torsion": (10.5797,), "stretching": (15.7751,), "clamped": 0.6188},
    (6, 2): {"bending": (4.0030, 4.6988), "torsion": (11.2162,), "clamped": 0.6592},
}


def kind_of(made: Bar, mass: np.ndarray, shape: np.ndarray) -> str:
    """What most of a mode's kinetic energy does: sections move along, across, or turn."""
    section = np.unique(np.round(made.position[:, 0], 6), return_inverse=True)[1]
    whole = np.bincount(section, mass)
    along, *across = (np.bincount(section, mass * shape[:, axis]) ** 2 / whole for axis in range(3))
    y, z = made.position[:, 1], made.position[:, 2]
    twist = np.bincount(section, mass * (y * shape[:, 2] - z * shape[:, 1])) ** 2 / np.bincount(
        section, mass * (y * y + z * z)
    )
    return max(
        (along.sum(), "stretching"), (np.sum(across), "bending"), (twist.sum(), "torsion"), key=lambda part: part[0]
    )[1]


@pytest.mark.parametrize(("per_voxel", "across"), list(FREQUENCIES))
def test_frequencies_of_the_bar(per_voxel: int, across: int) -> None:
    """To half of the last digit printed; a free body has six motions without a frequency (under 1e-4 Hz)."""
    made, printed = bar(across, per_voxel), dict(FREQUENCIES[per_voxel, across])
    mass = fem.lumped_mass(made.position, made.tetrahedra, 1000.0)
    assert mass.sum() == pytest.approx(10, rel=1e-12)
    free = np.zeros(len(mass), dtype=bool)
    found, shapes = fem.mode_shapes(made.position, made.tetrahedra, YOUNG, 0.3, 1000.0, free, 14)
    assert (found[:6] < 1e-4).all() and found[6] > 3
    kinds = [kind_of(made, mass, shape) for shape in shapes[6:]]
    clamped = fem.modes(made.position, made.tetrahedra, YOUNG, 0.3, 1000.0, made.clamped, 1)
    assert clamped[0] == pytest.approx(printed.pop("clamped"), abs=5.1e-5)
    for kind, values in printed.items():
        first = [hertz for hertz, one in zip(found[6:], kinds, strict=True) if one == kind][: len(values)]
        assert first == pytest.approx(values, abs=5.1e-5), kind


def test_patches() -> None:
    """An affine displacement of the surface is that of the inside to 1e-10, by Hooke's law and by Newton's method."""
    position, tetrahedra = cube(3, jitter=0.2)
    edge = np.zeros(len(position), dtype=bool)
    edge[fem.surface(tetrahedra).ravel()] = True
    assert 0 < (~edge).sum() < len(edge)
    slope = np.array([[0.10, 0.05, -0.02], [0.03, -0.06, 0.04], [-0.05, 0.02, 0.08]])
    affine = position @ slope.T
    nothing = np.zeros_like(position)
    small = fem.linear_static(position, tetrahedra, YOUNG, 0.3, edge, nothing, fixed_displacement=1e-3 * affine)
    np.testing.assert_allclose(small, 1e-3 * affine, rtol=0, atol=1e-10 * 1e-3 * 0.1)
    for material in materials.MATERIALS:
        start = position + np.where(edge[:, None], affine, 0)
        found = nonlinear_static(fem.Body.of(position, tetrahedra, material, YOUNG, 0.3), edge, start=start)
        np.testing.assert_allclose(found, position + affine, rtol=0, atol=1e-10 * 0.1)


@each_material
def test_rigid_motions_make_no_force(material: str) -> None:
    """To 1e-5 E a^2 (here 1e-10), turned by more than a right angle and far away; and no frequencies but the body's own."""
    position, tetrahedra = cube(2)
    turn = materials.rotation(np.random.default_rng(2).normal(size=(3, 3)))
    body = fem.Body.of(position, tetrahedra, material, YOUNG, 0.3)
    moved = position @ turn.T + np.array([3.0, -1.0, 2.0])
    assert np.abs(body.force(moved)).max() < 1e-10 * YOUNG * 0.05**2
    assert abs(body.energy(moved)) < 1e-10


@each_material
def test_forces_of_anything(material: str) -> None:
    """Minus the energy's slope (central differences, 1e-7 of the largest), without a sum and without a torque; the stiffness
    is the forces' slope, and symmetric; without negative eigenvalues where that is asked for."""
    position, tetrahedra = cube(1)
    body = fem.Body.of(position, tetrahedra, material, YOUNG, 0.3)
    moved = position + np.random.default_rng(4).normal(size=position.shape) * 0.02
    force = body.force(moved)
    np.testing.assert_allclose(force.sum(axis=0), 0, atol=1e-12 * np.abs(force).max())
    np.testing.assert_allclose(np.cross(moved, force).sum(axis=0), 0, atol=1e-12 * np.abs(force).max())
    stiffness, eps = body.stiffness(moved).toarray(), 1e-7
    scale = np.abs(stiffness).max()
    np.testing.assert_allclose(stiffness, stiffness.T, rtol=0, atol=1e-12 * scale)
    for place in range(position.size):
        step = np.zeros(position.size)
        step[place] = eps
        step = step.reshape(-1, 3)
        slope = (body.energy(moved + step) - body.energy(moved - step)) / (2 * eps)
        assert -slope == pytest.approx(force.flat[place], abs=1e-7 * np.abs(force).max())
        slopes = (body.force(moved + step) - body.force(moved - step)).ravel() / (2 * eps)
        np.testing.assert_allclose(-slopes, stiffness[place], rtol=0, atol=1e-6 * scale)
    assert np.linalg.eigvalsh(body.stiffness(moved, positive=True).toarray()).min() > -1e-9 * scale


def test_values_per_tetrahedron_and_volumes() -> None:
    """Regions: a bar in two halves, in series, stretches as the sum of its parts; volumes add up to the hull's."""
    made = bar(2)
    volume, _ = fem.shape_gradients(made.position, made.tetrahedra)
    assert volume.sum() == pytest.approx(0.01, rel=1e-12)
    x = made.position[made.tetrahedra].mean(axis=1)[:, 0]
    pull = fem.spread_evenly(made.position, made.tetrahedra, made.tip, (1.0, 0.0, 0.0))
    rolling = np.zeros(made.position.shape, dtype=bool)
    rolling[made.clamped, 0] = True
    rolling[np.flatnonzero(made.clamped)[[0, 0, 2]], [1, 2, 1]] = True  # nor shifts nor turns of the section
    young = np.where(x < 0.5, YOUNG, YOUNG / 3)
    moved = fem.linear_static(made.position, made.tetrahedra, young, 0.0, rolling, pull)
    np.testing.assert_allclose(moved[made.tip, 0], 1.0 / 0.01 * (0.5 / YOUNG + 1.5 / YOUNG), rtol=1e-9)
    inside_out = made.tetrahedra.copy()
    inside_out[7] = inside_out[7, [1, 0, 2, 3]]
    with pytest.raises(ValueError, match="tetrahedron 7"):
        fem.shape_gradients(made.position, inside_out)
