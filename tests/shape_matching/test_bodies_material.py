"""Clusters that stretch, creep and are damped: against the NumPy reference, among kernels and threads, and by their laws."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bodies_scenes import (
    BAR,
    BRICK,
    STEPS,
    bodies_scene,
    by_hand,
    clusters_of,
    degenerate,
    end_state,
    method,
    of_all_materials,
    opened,
    same,
    start,
)
from closed_meshes import ball, box
from closed_meshes import rotation as rotation_by

from softlab.app.output.files import read_state, write_state
from softlab.app.render.bodies.skinning import ClusterFrames
from softlab.bench.reference import shape_matching as reference
from softlab.model.assets.baked import baked, body_key
from softlab.model.assets.clusters import Clusters, matching_factor
from softlab.model.assets.material import Material, even
from softlab.model.assets.skin import make_skin
from softlab.model.assets.soft_body import MATERIAL, SoftBody
from softlab.model.base.errors import InputError
from softlab.model.base.variant import plain_formulas
from softlab.model.formulas.shape_matching import deformation, pace
from softlab.model.geometry.normals import mesh_normals
from softlab.model.geometry.shapes import Shape

CORNERS = np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-0.5, 0.5) for z in (-0.3, 0.3)])
SQUEEZE = np.diag([1.25, 0.8, 1.0])  # of volume 1
EPS = 2.0**-52
H = 0.01


def block(stiffness: float = np.inf, **values: float) -> Clusters:
    """CORNERS as one cluster, and far away a particle that has all of a material, so that one variant is compiled for all."""
    other = {"linear": 1.0, "creep": 1.0, "damping": 1.0}
    names = ("linear", "threshold", "creep", "limit", "damping")
    material = Material(**{name: np.array([values.get(name, 0.0), other.get(name, 0.0)]) for name in names})
    bare = clusters_of([*CORNERS, [50.0, 0.0, 0.0]], [np.arange(8), [8]], stiffness=[stiffness, np.inf])
    return replace(bare, material=material)


def placed(corners: np.ndarray, last: Any = (50.0, 0.0, 0.0)) -> np.ndarray:
    return np.concatenate([corners, [last]])


def run_of(clusters: Clusters, corners: np.ndarray, steps: int, velocity: Any = None, **options: Any) -> Any:
    scene = by_hand(clusters, method=method(1, 1, H))
    moving = None if velocity is None else placed(velocity, np.zeros(3))
    return end_state(scene, start=start(scene, placed(corners), moving), steps=steps, **options)


# ---------------------------------------------------------------------- kernels


def test_a_state_goes_on_bit_for_bit(tmp_path: Path) -> None:
    scene = of_all_materials()
    half, whole = end_state(scene), end_state(scene, steps=2 * STEPS)
    kept = read_state(write_state(tmp_path / "half.npz", half), scene)
    assert np.array_equal(kept.plastic, half.plastic)
    assert same(end_state(scene, start=kept), whole)
    with opened(scene, initial=half) as simulation:
        simulation.advance(2)
        simulation.rewind()
        assert np.array_equal(simulation.read("plastic"), half.plastic)
        found = simulation.read("deformation")
        expected = scene.body_set.clusters.deformations(half.position, half.plastic)
        assert found == pytest.approx(expected, abs=64 * EPS)
        assert same(simulation.state(), half)  # a look makes nothing creep
        assert np.array_equal(simulation.state().plastic, half.plastic)
        matrices = ClusterFrames(scene).of_simulation(simulation)  # neither body is turned at the start
        assert matrices[:, :, :3] == pytest.approx(found, abs=2.0**-23)
        simulation.reset()
        assert np.array_equal(simulation.read("plastic"), np.broadcast_to(np.eye(3), (4, 3, 3)))


@pytest.mark.parametrize(
    "plastic,word",
    [
        (np.eye(3)[None], r"shape \(1, 3, 3\), this scene needs \(4, 3, 3\)"),
        (2 * np.tile(np.eye(3), (4, 1, 1)), "cluster 0 has the volume 8; it must be 1"),
        (np.full((4, 3, 3), np.nan), "volume nan"),
        (np.ones((4, 3, 3), int), "real numbers"),
    ],
)
def test_bad_strains_are_refused(plastic: Any, word: str) -> None:
    scene = of_all_materials()
    bad = replace(start(scene), plastic=plastic)
    with opened(scene) as simulation, pytest.raises(InputError, match=word):
        simulation.load(bad)
    plain = bodies_scene(brick=BRICK)
    bad = replace(start(plain), plastic=np.eye(3)[None])
    with opened(plain) as simulation, pytest.raises(InputError, match="plastic: this scene has no such array"):
        simulation.load(bad)


def test_clusters_without_a_volume_only_turn() -> None:
    """Flat, collinear, of one particle, of none: as without a material, to the bit; and what is said of them."""
    bare = degenerate()
    every = [np.full(bare.count, value) for value in (1.0, 0.0, 50.0, 0.5)]
    damping = np.where(np.diff(bare.offsets) == 0, 1.0, 0.0)  # of the empty one, so that nothing new is compiled
    given = replace(bare, material=Material(*every, damping))
    assert given.flat.all()
    pushed = bare.position + np.random.default_rng(2).normal(0, 0.03, bare.position.shape)
    plain, shaped = by_hand(bare), by_hand(given)
    expected = end_state(plain, start=start(plain, pushed), steps=2)
    found = end_state(shaped, start=start(shaped, pushed), steps=2)
    assert same(found, expected) and np.array_equal(found.plastic, np.broadcast_to(np.eye(3), (bare.count, 3, 3)))


def test_a_flat_body_is_told_of() -> None:
    position, triangles = box()
    body = SoftBody.from_mesh((position * [1.0, 1.0, 0.005], triangles), particle_spacing=0.2, linear=0.5)
    flat = int(body.clusters.flat.sum())
    assert flat and f"{flat} of {body.clusters.count} clusters are flat: they only rotate" in "".join(body.report.notes)


# ---------------------------------------------------------------------- linear goals


@pytest.mark.parametrize("volume", [1.0, 1.3])
def test_a_linear_cluster_keeps_any_linear_map_but_for_its_volume(volume: float) -> None:
    """beta 1: A sheared, stretched and turned block stays as it is where its volume is that at rest, and else goes to the
    same shape of that volume. Some 60 roundings of 2 m a step; what is wrong in one adds to velocities: STEPS^2 / 2 times."""
    sheared = rotation_by([0.3, 1.0, -0.4]) @ np.array([[1.3, 0.4, 0.0], [0.1, 0.9, -0.2], [0.0, 0.3, 1.0]])
    sheared /= np.cbrt(np.linalg.det(sheared))
    state = run_of(block(linear=1.0), np.cbrt(volume) * CORNERS @ sheared.T, STEPS if volume == 1 else 1)
    assert np.abs(state.position[:8] - CORNERS @ sheared.T).max() < STEPS**2 / 2 * 60 * 2 * EPS


@pytest.mark.parametrize("linear", [0.0, 0.5, 0.9])
def test_a_goal_is_mixed_of_map_and_rotation(linear: float) -> None:
    """A rigid cluster's particles go to b F + (1 - b) R in one step: R = 1, F = SQUEEZE."""
    state = run_of(block(linear=linear), CORNERS @ SQUEEZE, 1)
    expected = CORNERS @ (linear * SQUEEZE + (1 - linear) * np.eye(3))
    assert np.abs(state.position[:8] - expected).max() < 64 * EPS


@pytest.mark.parametrize("linear", [0.0, 0.5, 0.9])
def test_a_linear_cluster_is_softer_in_shear(linear: float) -> None:
    """x = (1 + E) r with E small and without a trace, along the block's axes, has the goal (1 + b E) r, so that a step goes
    a (1 - b) of the way back: the square of the frequency of shear is (1 - b) w^2. What is left out is E^2, a step."""
    a, size, shear = matching_factor(3600.0, H, 1), 1e-5, np.diag([1.0, -1.0, 0.0])
    before = now = size
    for _ in range(STEPS):
        before, now = now, (1 - a * (1 - linear)) * (2 * now - before)
    state = run_of(block(3600.0, linear=linear), CORNERS + size * CORNERS @ shear, STEPS)
    assert np.abs(state.position[:8] - CORNERS - now * CORNERS @ shear).max() < STEPS * size**2


def test_momentum_is_kept() -> None:
    """Of overlapping clusters pushed about at random, from rest: the bound is that of test_bodies_solver."""
    material = {"linear": 0.7, "plastic_creep": 30.0, "cluster_damping": 3.0}
    scene = bodies_scene(bar=BAR | material, gravity=0.0, method=method(1, 1))
    body_set, random = scene.body_set, np.random.default_rng(4)
    pushed = body_set.position + random.normal(0, 0.05, body_set.position.shape)
    bent = np.array([np.diag([1.2, 1 / 1.2, 1.0])] * body_set.clusters.count)
    ways = reference.iterate(body_set.clusters, pushed, H, 1, bent) - pushed
    state = end_state(scene, start=start(scene, pushed), steps=1)
    for position, moved in ((pushed, ways), (state.position, state.velocity)):
        m = body_set.clusters.mass[:, None] * moved
        arms = np.cross(position - pushed.mean(axis=0), m)
        assert np.linalg.norm(m.sum(axis=0)) < 1e-14 * np.linalg.norm(m, axis=1).sum()
        assert np.linalg.norm(arms.sum(axis=0)) < 1e-14 * np.linalg.norm(arms, axis=1).sum()


# ---------------------------------------------------------------------- formulas


def test_formulas_are_those_of_linear_algebra() -> None:
    """Any volume, mirrored ones, too; 100 roundings of numbers up to 10."""
    formulas, random = plain_formulas(deformation, np.float64), np.random.default_rng(1)
    for volume in (1e-12, 1e-5, 0.3, 1.0, 70.0, 1e12):
        assert formulas.cube_root(volume) == pytest.approx(np.cbrt(volume), rel=4 * EPS)
    corners = CORNERS.copy()
    for scale in (1.0, 0.4, -1.0):
        clusters = replace(clusters_of(corners, [np.arange(8)]), material=even(1, linear=0.7))
        map_ = scale * (np.eye(3) + 0.2 * random.normal(size=(3, 3)))
        turned = clusters.rotations(corners @ map_.T)[0]
        found = formulas.blended(map_.ravel(), turned.ravel(), 0.7)
        assert np.reshape(found, (3, 3)) == pytest.approx(clusters.deformations(corners @ map_.T)[0], abs=1000 * EPS)
        assert (scale > 0) or np.array_equal(np.reshape(found, (3, 3)), turned)
    square = random.normal(size=(3, 4))
    inertia, spin = square @ square.T, random.normal(size=3)
    solved = plain_formulas(pace, np.float64).solved(*inertia[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]], *spin)
    assert inertia @ solved == pytest.approx(spin, abs=100 * 10 * EPS)
    assert plain_formulas(pace, np.float64).solved(*[0.0] * 9) == (0, 0, 0)


def test_a_skins_normals_go_by_the_surface() -> None:
    """Under one linear map for all clusters they are those of the mesh that it makes."""
    position, triangles = ball()
    centres = np.random.default_rng(3).uniform(-0.5, 0.5, (5, 3))
    map_ = np.array([[1.3, 0.4, 0.0], [0.1, 0.7, -0.2], [0.0, 0.3, 1.1]])
    moved, normal = make_skin(position, triangles, centres).skinned(centres @ map_.T, np.broadcast_to(map_, (5, 3, 3)))
    assert moved == pytest.approx(position @ map_.T, abs=64 * EPS)
    assert normal == pytest.approx(mesh_normals(position @ map_.T, triangles), abs=64 * EPS)


# ---------------------------------------------------------------------- parameters


def test_parameters_are_written_where_they_say_something_and_bake_nothing(tmp_path: Path) -> None:
    plain, bar = bodies_scene(bar=BAR), bodies_scene(bar=BAR | {"linear": 0.5, "cluster_damping": 2.0})
    assert not set(MATERIAL) & set(plain.as_dict()["bar"])
    assert type(bar)(bar.as_dict(), "again").canonical() == bar.canonical() != plain.canonical()
    assert bar.body_set.clusters.parts == {"linear", "cluster_damping"} and not plain.body_set.clusters.parts
    soft, same_soft = SoftBody(particle_spacing=0.3), SoftBody(particle_spacing=0.3, plastic_creep=2.0)
    assert body_key(soft, Shape(name="beam")) == body_key(same_soft, Shape(name="beam"))
    for _ in range(2):  # made, and from the file
        made = baked(same_soft, Shape(name="beam"), folder=tmp_path).clusters
        assert made.parts == {"plastic"} and (made.material.limit == 0.5).all()
    assert baked(soft, Shape(name="beam"), folder=tmp_path).clusters.material is None
    assert len(list(tmp_path.iterdir())) == 1
