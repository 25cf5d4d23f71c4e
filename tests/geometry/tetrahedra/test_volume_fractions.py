"""Cut voxels weigh and stiffen by their part inside the mesh: volumes, centres and second moments, and a bent beam."""

import numpy as np
import pytest
from closed_meshes import blocks, both, box, rotation

from bench.reference.finite_elements import linear_static
from model.geometry.edges import components
from model.geometry.moments import point_moments, surface_moments, tetrahedra_moments
from model.geometry.shapes import Shape
from model.geometry.tetrahedra.voxels import VoxelMesh, voxel_mesh

DENSITY, YOUNG, POISSON, GRAVITY = 1000.0, 1e6, 0.3, 9.81
TILTED = box((0.5, 0.3, 1.0))[0] @ rotation((0.4, 1.0, -0.3)).T + [4, 5, 6], box()[1]


def cylinder(radius: float = 0.3, length: float = 1.0, sides: int = 96):
    """Along x; at the far end its axis has left the axes of the lattice by a slope of 0.1."""
    angle = np.arange(sides) * (2 * np.pi / sides)
    ring = np.stack([np.zeros(sides), radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    return prism(ring, np.array([length, 0.1 * length, 0.0]))


def prism(ring: np.ndarray, along: np.ndarray):
    """The prism of a polygon `ring` (n, 3), in mathematical order seen from +x, and the way `along` (3,)."""
    n = len(ring)
    here, then = np.arange(n), (np.arange(n) + 1) % n
    sides = [np.stack([here, then, here + n], axis=1), np.stack([then, then + n, here + n], axis=1)]
    fan = np.stack([np.zeros(n - 2, int), here[1:-1], here[2:]], axis=1)
    return np.concatenate([ring, ring + along]), np.concatenate([*sides, fan[:, ::-1], fan + n])


SHAPES = {
    "sphere": Shape(name="ball", resolution=24).mesh(), "torus": Shape(name="torus", resolution=32).mesh(),
    "cylinder": cylinder(), "tilted box": TILTED,
}  # fmt: skip


def weights(body: VoxelMesh) -> np.ndarray:
    """(tetrahedra, 4) [m^3]: what each holds for each of its corners."""
    return body.mesh.volumes[:, None] / 4 * body.fractions


def masses(body: VoxelMesh) -> np.ndarray:
    return np.bincount(body.mesh.tetrahedra.ravel(), DENSITY * weights(body).ravel(), len(body.mesh.position))


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("per_voxel", [5, 6])
def test_volumes_are_exact_and_moments_converge_with_the_second_power(name, per_voxel):
    """Second moments of what is lumped at vertices or spread over a tetrahedron are off by parts of an edge squared."""
    off = []
    for voxels in (5, 10, 20):
        body = voxel_mesh(SHAPES[name], voxels=voxels, per_voxel=per_voxel)
        volume, centre, second = surface_moments(body.hull.position, body.hull.triangles)
        size = np.ptp(body.hull.position, axis=0).max()
        own = tetrahedra_moments(body.mesh.position[body.mesh.tetrahedra], weights(body).sum(axis=1))
        lumped = point_moments(body.mesh.position, masses(body) / DENSITY)
        assert lumped[0] == pytest.approx(volume, rel=1e-12) and own[0] == pytest.approx(volume, rel=1e-12)
        assert np.abs(lumped[1] - centre).max() < 2e-3 * size
        off.append([np.abs(moments[2] / second - 1).max() for moments in (own, lumped)])
    order = np.log2(np.array(off[:-1]) / np.array(off[1:])).mean(axis=0)
    assert (order > 1.6).all() and (np.array(off[-1]) < [0.02, 0.03]).all(), (off, order)


@pytest.mark.parametrize("sides", [(1, 0.25, 0.25), (1, 0.23, 0.37), (0.02, 0.5, 0.011)])
@pytest.mark.parametrize("size", [{"voxels": 10}, {"edge": 0.1}])
def test_boxes_are_met_exactly(sides, size):
    body = voxel_mesh(box(sides, (0.1, 0.2, 0.3)), **size)
    assert np.ptp(body.mesh.position, axis=0) == pytest.approx(sides, rel=1e-12) and (body.fractions == 1).all()
    volume, _, second = tetrahedra_moments(body.mesh.position[body.mesh.tetrahedra], body.mesh.volumes)
    x, y, z = np.square(sides) * (volume / 12)
    assert second == pytest.approx([y + z, z + x, x + y], rel=1e-10)
    assert body.edge <= size.get("edge", max(sides) / 10) * (1 + 1e-12)


@pytest.mark.parametrize("where", [0.13, 0.5, 0.77])
def test_a_face_along_the_axes_is_exact_wherever_it_lies_in_a_voxel(where):
    """An L of three blocks, one of whose inner faces is on no lattice: the lines along the axis of its normal are exact, up
    to the number by which all cut voxels are scaled."""
    position, triangles = blocks([(0, 0, 0), (1, 0, 0), (0, 1, 0)], 1.0)
    inner = np.isclose(position, 1.0)
    position = np.where(inner & (np.arange(3) == 1), where + 0.9, position)
    body = voxel_mesh((position, triangles), edge=0.25)
    column = (body.voxel[:, 0] == 6) & (body.voxel[:, 2] == 1)  # crossed by no face but the one of normal y
    held = weights(body)[column].sum()
    assert held == pytest.approx((where + 0.9) * np.prod(body.edges[[0, 2]]), rel=0.01)


def test_parts_of_a_doubled_voxel_weigh_what_is_theirs():
    thin, thick = box((1, 0.02, 0.1)), box((1, 0.06, 0.1), (0, 0.05, 0))
    body = voxel_mesh(both(thin, thick), edge=0.1)
    ends = [body.mesh.tetrahedra[:, [0, k]] for k in (1, 2, 3)]
    label = components(len(body.mesh.position), np.concatenate(ends))[body.mesh.tetrahedra[:, 0]]
    upper = label == label[body.embedding.tetrahedron[-1]]
    assert body.doubled == 10 and upper.sum() == 50
    assert weights(body)[upper].sum() == pytest.approx(0.006, rel=0.02)
    assert weights(body)[~upper].sum() == pytest.approx(0.002, rel=0.06)


def test_what_overlaps_counts_once():
    """Two blocks that share half of each: the hull's volume counts that half twice."""
    body = voxel_mesh(both(box((1, 0.4, 0.4)), box((1, 0.4, 0.4), (0.5, 0, 0))), edge=0.05)
    assert weights(body).sum() == pytest.approx(1.5 * 0.16, rel=1e-9) and body.hull.volume == pytest.approx(0.32)


def test_no_vertex_is_without_mass():
    for mesh in SHAPES.values():
        body = voxel_mesh(mesh, voxels=9)
        assert masses(body).min() > 0 and body.fractions.min() > 1e-5 and body.fractions.max() < 4.5


def sag(body: VoxelMesh, fraction: np.ndarray, mass: np.ndarray) -> float:
    """[m] of the end of a beam held at its lower x, under its own weight."""
    position = body.mesh.position
    held, end = (np.isclose(position[:, 0], value) for value in (position[:, 0].min(), position[:, 0].max()))
    force = np.zeros_like(position)
    force[:, 1] = -GRAVITY * mass
    moved = linear_static(position, body.mesh.tetrahedra, YOUNG * fraction, POISSON, held, force)
    return float(-np.average(moved[end, 1], weights=mass[end]))


@pytest.mark.parametrize("degrees", [30.0, 45.0])
def test_a_beam_whose_section_does_not_fit_bends_as_one_that_does(degrees):
    """A square turned about its length bends as it does unturned, by Timoshenko's w L^4 / (8 E I) + w L^2 / (2 k G A), less
    what linear tetrahedra lock: the conforming mesh of as many voxels across tells how much that is. Whole voxels in place of
    fractions are 0.45 and 0.57 times as far."""
    side, length = 0.1, 1.0
    shear = YOUNG / (2 * (1 + POISSON))
    load = DENSITY * GRAVITY * side**2
    exact = load * length**4 / (8 * YOUNG * side**4 / 12) + load * length**2 / (2 * (5 / 6) * shear * side**2)
    angle = np.radians(degrees) + np.arange(4) * np.pi / 2
    corner = side / np.sqrt(2) * np.stack([np.zeros(4), np.cos(angle + np.pi / 4), np.sin(angle + np.pi / 4)], axis=1)
    turned = voxel_mesh(prism(corner, np.array([length, 0.0, 0.0])), edge=np.ptp(corner, axis=0).max() / 4 * 1.001)
    fitting = voxel_mesh(box((length, side, side)), edge=side / 4)
    ratio = sag(turned, turned.fractions.mean(axis=1), masses(turned)) / exact
    conforming = sag(fitting, np.ones(len(fitting.mesh.tetrahedra)), masses(fitting)) / exact
    whole = DENSITY / 4 * np.repeat(turned.mesh.volumes, 4)
    lumped = np.bincount(turned.mesh.tetrahedra.ravel(), whole, len(turned.mesh.position))
    before = sag(turned, np.ones(len(whole) // 4), lumped) / exact
    assert 0.86 < conforming < 0.9 and abs(ratio - conforming) < 0.09 and before < 0.6
