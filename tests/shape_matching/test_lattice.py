"""Lattices in space: their tables, sums along axes against direct sums and the reference, and the laws that they keep."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bodies_scenes import (
    BAR,
    block,
    blocks,
    bodies_scene,
    end_state,
    method,
    opened,
    same,
    start,
)
from closed_meshes import rotation as rotation_by

from softlab.app.output.files import read_state, write_state
from softlab.app.render.bodies.skinning import ClusterFrames
from softlab.app.render.particle_colours import cluster_colours
from softlab.bench.experiments.body_scenes import FLOOR, ULP, masses
from softlab.bench.reference import shape_matching as reference
from softlab.model.assets.baked import baked
from softlab.model.assets.lattice import Lattice
from softlab.model.assets.soft_lattice import SoftLattice
from softlab.model.geometry.shapes import Shape
from softlab.model.particles import body_set

KERNELS = [("stages", 1), ("stages", 3), ("fused", 1), ("fused", 2), ("fused", 5)]
SHAPES = [((5, 4, 3), 2), ((1, 1, 1), 1), ((7, 1, 2), 1), ((3, 9, 2), 3), ((2, 2, 2), 5), ((1, 6, 13), 2)]


@pytest.mark.parametrize("counts,region", SHAPES)
def test_tables_are_the_windows(counts: tuple[int, int, int], region: int) -> None:
    """Shares, masses and rest centres of windows as products and sums of the axes', against the compressed form."""
    lattice = Lattice(counts, region, 0.1)
    clusters = lattice.clusters(lattice.positions(), np.full(lattice.size, 0.5), 100.0)
    x, y, z = lattice.axes

    def product(name: str) -> np.ndarray:
        one, two, three = (getattr(axis, name) for axis in (z, y, x))
        found: np.ndarray = (one[:, None, None] * two[:, None] * three).ravel()
        return found

    np.testing.assert_allclose(product("mass"), clusters.cluster_mass / 0.5, rtol=1e-13)
    np.testing.assert_array_equal(product("count"), np.diff(clusters.offsets))
    np.testing.assert_allclose(product("weight")[clusters.indices], clusters.weights, rtol=1e-13)
    away = (clusters.rest_centre - lattice.positions()) / 0.1
    grids = np.meshgrid(z.centre, y.centre, x.centre, indexing="ij")
    np.testing.assert_allclose(away, np.stack([grid.ravel() for grid in grids[::-1]], axis=1), atol=1e-12)


@pytest.mark.parametrize("counts,region", SHAPES[2:])
def test_sums_along_axes_are_direct_sums(
    counts: tuple[int, int, int], region: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To rounding: of 20 iterations, each with some hundred roundings of 1 m, in float64."""
    summed = end_state(blocks(counts=counts, region=region))
    monkeypatch.setattr(body_set, "is_summed", lambda body: False)
    directly = blocks(counts=counts, region=region)
    assert not directly.body_set.lattices and directly.body_set.loose.count == directly.body_set.clusters.count
    away = np.abs(summed.position - end_state(directly).position).max()
    assert 0 < away < 20 * 100 * 4 * 2.0**-53


def test_fast_math_is_near_exact() -> None:
    options = {"precision": "float32", "kernel": "stages", "threads": 2}
    fast, exact = (end_state(blocks(), math=math, **options) for math in ("fast", "exact"))
    assert np.abs(fast.position - exact.position).max() < 2e-12 * 2.0**29


def test_reading_states_and_going_on(tmp_path: Any) -> None:
    scene = blocks()
    with opened(scene) as simulation:
        assert simulation.read("rotation").shape == (scene.body_set.clusters.count, 4)
        simulation.advance(2)
        half = simulation.state()
        turns, centres = simulation.read("rotation").copy(), simulation.read("centre").copy()
        np.testing.assert_allclose(centres, scene.body_set.clusters.centres(half.position), atol=1e-14)
        found = np.einsum(
            "nij,nkj->nik", simulation.read("deformation"), scene.body_set.clusters.rotations(half.position)
        )
        np.testing.assert_allclose(found, np.broadcast_to(np.eye(3), found.shape), atol=1e-12)
        simulation.advance(2)
        there = simulation.state()
        simulation.rewind()
        simulation.load(half)
        assert np.array_equal(simulation.read("rotation"), turns)
        simulation.advance(2)
        assert same(simulation.state(), there)
    write_state(tmp_path / "half.npz", half)
    assert same(half, read_state(tmp_path / "half.npz", scene))


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_one_iteration_keeps_angular_momentum(precision: str) -> None:
    """Of a lattice that springs back from rest, whose displacements are from where its masses were: of places of 1 m, which
    are rounded a hundred times at most, the same way at worst."""
    scene = bodies_scene(gravity=0.0, body=block((6, 5, 4), 2), method=method(1, 1, 0.0025))
    at, m, random = scene.body_set.position, masses(scene), np.random.default_rng(5)
    strained = 1.1 * at + random.normal(0, 0.005, at.shape)
    v = end_state(scene, steps=1, start=start(scene, strained), precision=precision).velocity.astype(float)
    assert np.abs(np.sum(np.cross(strained, m * v), axis=0)).max() < 100 * ULP[precision] / 0.0025 * m.sum()
    assert np.abs(v).max() > 0.1


def test_a_stiff_lattice_turns_as_a_whole() -> None:
    """Rigid windows, turned and moved at rest, are where a rigid motion takes them: nothing moves in one substep."""
    scene = bodies_scene(gravity=0.0, body=block((5, 4, 6), 1, cluster_stiffness=1e12), method=method(1, 1, 0.01))
    turned = scene.body_set.position @ rotation_by([1.0, 2.5, -1.4]).T + [0.5, -0.2, 0.1]
    end = end_state(scene, start=start(scene, turned), steps=1)
    np.testing.assert_allclose(end.position, turned, atol=1e-14)


def test_what_clusters_do_beside_turning_is_summed_directly() -> None:
    scene = bodies_scene(body=block(linear=0.5), other=block(origin=[3.0, 0.0, 0.0]))
    assert len(scene.body_set.lattices) == 1 and scene.body_set.lattices[0].first_cluster == 60
    position, _ = reference.simulate(scene, 3)
    assert np.abs(end_state(scene, steps=3).position - position).max() < 1e-12


def test_plastic_bodies_beside_lattices() -> None:
    given = {"linear": 0.6, "plastic_threshold": 0.01, "plastic_creep": 20.0, "velocity": [0.0, -5.0, 0.0]}
    scene = bodies_scene(block=block((3, 2, 2), 1), bar=BAR | given | {"origin": [2.0, 0.0, 0.0]}, plane=FLOOR)
    half = end_state(scene, steps=4)
    assert half.plastic is not None and half.plastic.shape == (scene.body_set.clusters.count, 3, 3)
    assert np.abs(half.plastic[:3] - np.eye(3)).max() > 1e-3 and (half.plastic[3:] == np.eye(3)).all()
    assert same(end_state(scene, steps=2, start=half), end_state(scene, steps=6))


def test_skins_follow_their_own_clusters() -> None:
    """Lattices come first in the scene and last among clusters: at the start each matrix takes its body from the mesh's frame
    to where the copy is."""
    body_set, frames = blocks().body_set, ClusterFrames(blocks())
    with opened(blocks()) as simulation:
        matrices = frames.of_simulation(simulation)
    for copy in body_set.copies:
        own = matrices[copy.first_cluster : copy.first_cluster + copy.baked.clusters.count].astype(float)
        found = np.einsum("cij,pj->cpi", own[:, :, :3], copy.baked.position) + own[:, None, :, 3]
        expected = np.broadcast_to(body_set.position[copy.particles], found.shape)
        np.testing.assert_allclose(found, expected, atol=1e-5)  # of float32 matrices
    assert len(cluster_colours(body_set)) == body_set.clusters.count


def test_the_body_and_its_report(tmp_path: Any) -> None:
    shape = Shape(name="box", resolution=4, sides=(0.5, 0.4, 0.3))
    parameters = SoftLattice(particle_spacing=0.1, region=1, density=500.0)
    made, again = (baked(parameters, shape, folder=tmp_path) for _ in range(2))
    assert made.lattice == again.lattice == Lattice((5, 4, 3), 1, 0.1)
    np.testing.assert_array_equal(made.position, again.position)
    assert made.report == again.report and made.report.mass == pytest.approx(500 * 0.06)
    assert (made.report.particles, made.report.interior, made.report.members) == (60, 3 * 2 * 1, (8, 27))
    assert np.abs(made.position).max(axis=0) == pytest.approx([0.2, 0.15, 0.1])


@pytest.mark.parametrize(
    "sides,asked,spacing,covered",
    [
        ((1.0, 1.0, 1.0), 0.3, 1 / 3, 1.0), ((1.0, 0.5, 0.25), 0.24, 0.25, 1.0), ((1.0, 0.7, 0.3), 0.1, 0.1, 1.0),
        ((1.0, 0.7, 0.31), 0.28, 0.28, 0.8 * 0.28 / 0.31),
    ],
)  # fmt: skip
def test_a_report_says_what_the_particles_fill(
    sides: tuple[float, float, float], asked: float, spacing: float, covered: float
) -> None:
    """A metre at 0.3 m was filled to 0.9 m, and said to be covered: the spacing that fills a box is taken where there is one
    near, and said; else what is filled is."""
    made = SoftLattice.from_mesh(Shape(name="box", sides=sides, resolution=4).mesh(), particle_spacing=asked)
    assert made.spacing == pytest.approx(spacing, rel=1e-9) and made.report.covered == pytest.approx(covered, rel=1e-9)
    size = np.ptp(made.position, axis=0) + made.spacing
    filled = float(np.prod(np.minimum(size, sides)) / np.prod(sides))
    assert made.report.covered == pytest.approx(filled, rel=1e-9)
    assert made.mass.sum() == pytest.approx(1000 * np.prod(sides), rel=1e-12)
    told = " ".join(made.report.notes)
    assert ("fill the box exactly" in told) == (spacing != asked) and ("the box is" in told) == (covered < 1)
