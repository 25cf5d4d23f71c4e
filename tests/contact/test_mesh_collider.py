"""Meshes as colliders: the tree against every triangle, laws of contact, what moves and turns, bad input, pictures.

Formulas run here as plain Python; the compiled ones give the same bits.
"""

from __future__ import annotations

from math import atan, cos, radians, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cloth_solve import cloth, each_solver
from surface_touch import check_compiled, check_falling_cloth, check_formulas, fall_by, touch_by

from softlab.bench.reference import cloth as judge
from softlab.model.base.variant import plain_formulas
from softlab.model.formulas import triangle_tree as formulas
from softlab.model.formulas.triangle_tree import CORNERS, NODE, SETTLED
from softlab.model.geometry.triangle_tree import order_of, parts_of, tree_numbers
from softlab.model.tables.cloth import Sphere
from softlab.model.tables.colliders.mesh_collider import MeshCollider

TERRAIN = {"name": "terrain", "resolution": 2}
each_precision = pytest.mark.parametrize("real", [np.float32, np.float64])


def soup(count: int, seed: int = 0) -> np.ndarray:
    """(count, 3, 3): triangles of any shape anywhere in about 4 m, in their order in the tree."""
    random = np.random.default_rng(seed)
    corners = random.normal(size=(count, 1, 3)) + random.choice([0.03, 0.3, 2.0], (count, 1, 1)) * random.normal(
        size=(count, 3, 3)
    )
    return corners[order_of(corners)]


def touch(part: MeshCollider, real: Any = np.float64, in_place: bool = False) -> Any:
    """See `touch_by`."""
    return touch_by(formulas, "mesh_collider", part, real, in_place)


def written(path: Path, position: Any, triangles: Any) -> str:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.asarray(position, dtype=float).tolist()]
    lines += ["f " + " ".join(str(k + 1) for k in triangle) for triangle in triangles]
    path.write_text("\n".join(lines) + "\n")
    return str(path)


FLOOR = [[-2, 0, -2], [-2, 0, 2], [2, 0, 2], [2, 0, -2]], [[0, 1, 2], [0, 2, 3]]


@pytest.fixture
def floor(tmp_path: Path) -> str:
    """4 m x 4 m in y = 0, two triangles, upper side up."""
    return written(tmp_path / "floor.obj", *FLOOR)


def fall(part: MeshCollider, place: Any, velocity: Any, steps: int, dt: float, gravity: float = 9.81) -> Any:
    """See `fall_by`."""
    return fall_by(touch(part), place, velocity, steps, dt, gravity)


# ---------------------------------------------------------------------- the tree


@pytest.mark.parametrize("count", [1, 2, 3, 7, 100])
def test_the_tree_holds_every_triangle_once_and_skips_to_where_a_part_ends(count: int) -> None:
    corners = soup(count)
    numbers = tree_numbers(corners, np.float64)
    nodes = numbers[: NODE * (2 * count - 1)].reshape(-1, NODE)
    assert np.array_equal(numbers[nodes.size :].reshape(count, 3, 3), corners)
    assert sorted(nodes[nodes[:, 7] >= 0, 7]) == list(range(count))
    assert sum(len(level) for level in parts_of(count)) == len(nodes)
    for k, node in enumerate(nodes):
        below = nodes[k : int(node[6])]
        own = corners[below[below[:, 7] >= 0, 7].astype(int)]
        assert (own >= node[:3]).all() and (own <= node[3:6]).all()
        assert (len(own) == 1) == (node[7] >= 0) and len(below) == 2 * len(own) - 1


@each_precision
@pytest.mark.parametrize("far", [1.0, 3.0])
def test_the_tree_finds_what_looking_at_every_triangle_finds(real: Any, far: float) -> None:
    """The same triangle, and its numbers to the bit: boxes are larger by more than the rounding of a distance."""
    corners, made = soup(60), plain_formulas(formulas, real)
    numbers = tree_numbers(corners, real)
    first = NODE * (2 * len(corners) - 1)
    triangles = numbers[first:].reshape(-1, CORNERS)
    ways = (far * np.random.default_rng(1).normal(size=(120, 2, 3))).astype(real)
    crossings = 0
    for p, q in ways:
        parts = [made.crossing(p, q, *triangle.reshape(3, 3)) for triangle in triangles]
        part, place = made.first_crossing(numbers, 0, *p, *q)
        assert part == min(parts)
        assert place == (first + CORNERS * int(np.argmin(parts)) if part < 2 else -1)
        crossings += part < 2
        found = [made.from_triangle(q, *triangle.reshape(3, 3)) for triangle in triangles]
        k = int(np.argmin([way[0] for way in found]))
        assert made.nearest(numbers, 0, *q, real(1e30)) == (*found[k], first + CORNERS * k)
        assert made.nearest(numbers, 0, *q, found[k][0])[4] == -1
    assert crossings > 15


def test_the_nearest_point_is_the_nearest_of_many() -> None:
    """No point of a triangle is nearer than the one found, and of a fine net of them one is as near but for its width."""
    made, random = plain_formulas(formulas, np.float64), np.random.default_rng(3)
    steps = np.arange(41) / 40
    u, v = (x.ravel() for x in np.meshgrid(steps, steps))
    weights = np.stack([1 - u - v, u, v], axis=1)[u + v <= 1 + 1e-9]
    for triangle, q in zip(soup(40, 5), random.normal(size=(40, 3)), strict=True):
        squared, *way = made.from_triangle(q, *triangle)
        assert np.linalg.norm(way) == pytest.approx(sqrt(squared), rel=1e-12)
        away = np.linalg.norm(weights @ triangle - q, axis=1).min()
        net = np.linalg.norm(np.ptp(triangle, axis=0)) / 40
        assert sqrt(squared) <= away + 1e-12 and away <= sqrt(squared) + net


# ---------------------------------------------------------------------- nothing passes


@each_precision
def test_no_mass_passes_at_100_metres_a_second(real: Any) -> None:
    """A way of 1.67 m through a terrain, a third of the ways through corners and edges of its triangles, from above and from
    below: a mass ends on its side, at the thickness, and so it does after three steps more with what is left of its speed."""
    mesh = MeshCollider(shape=TERRAIN, thickness=0.02)
    meet, random, made, tree = (
        touch(mesh, real),
        np.random.default_rng(4),
        plain_formulas(formulas, real),
        mesh.numbers(real),
    )
    corners = mesh.corners.astype(real).astype(float)
    inner = corners[(np.abs(corners[..., [0, 2]]) < 3.5).all(axis=(1, 2))]
    for k, triangle in enumerate(inner[random.permutation(len(inner))[:90]]):
        weights = [random.dirichlet([1, 1, 1]), np.array([0.5, 0.5, 0]), np.array([1.0, 0, 0])][k % 3]
        normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
        side = 1 if k % 2 else -1
        way = -side * normal / np.linalg.norm(normal) * (100 / 60)
        target = weights @ triangle
        before = (target - 0.3 * way).astype(real)
        position, velocity = meet(0, 1 / 60, before, before + way.astype(real), way * 60)
        height = side * (position - target) @ normal / np.linalg.norm(normal)
        assert 0.01 < height < 0.04  # neighbours, of slopes up to 0.93, push it a little farther
        for step in range(4):
            squared, *out, _ = made.nearest(tree, 0, *position, real(4))
            assert sqrt(squared) >= 0.02 * SETTLED - 8 * np.finfo(real).eps
            assert side * out[1] > 0 or np.abs(position).max() > 3.9  # or it slid over the rim
            now = position + velocity * real(1 / 60)
            position, velocity = meet(step / 60, (step + 1) / 60, position, now, velocity)


def test_a_mass_that_begins_in_contact_is_held_and_one_outside_is_not_touched(floor: str) -> None:
    meet = touch(MeshCollider(file=floor, thickness=0.05))
    for height in (0.05, 0.02, 1e-9, -1e-9, -0.05):
        position, velocity = meet(
            0, 0.01, (0.3, height, 0.4), (0.3, height - np.sign(height), 0.4), (0, -np.sign(height), 0)
        )
        assert position == pytest.approx([0.3, np.copysign(0.05, height), 0.4], abs=1e-15)
        assert velocity.tolist() == [0, 0, 0]
    for place in ((0.3, 0.06, 0.4), (2.2, -0.06, 0.0)):
        position, velocity = meet(0, 0.01, (place[0], 0.07 * np.sign(place[1]), place[2]), place, (1.0, -1.0, 0.5))
        assert (position.tolist(), velocity.tolist()) == (list(place), [1.0, -1.0, 0.5])


def test_a_mesh_of_a_sphere_is_the_sphere_within_its_sagitta(tmp_path: Path) -> None:
    """Facets whose corners lie on a sphere are inside it by at most s = r - sqrt(r^2 - c^2), c the largest circumradius. So a
    mass that is pushed out to the thickness t ends between r + t - s and r + t, and along a normal that leans by
    asin(c / r) at most."""
    import trimesh

    made, radius, thickness = trimesh.creation.icosphere(3, 0.5), 0.5, 0.05
    file = written(tmp_path / "ball.obj", made.vertices, made.faces)
    mesh = MeshCollider(file=file, thickness=thickness)
    a, b, c = np.moveaxis(mesh.corners, 1, 0)
    sides = [np.linalg.norm(x - y, axis=1) for x, y in ((a, b), (b, c), (c, a))]
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    circumradius = (sides[0] * sides[1] * sides[2] / (4 * area)).max()
    sagitta = radius - sqrt(radius**2 - circumradius**2)
    assert 1e-4 < sagitta < 0.003
    meet, random = touch(mesh), np.random.default_rng(6)
    for _ in range(60):
        out = random.normal(size=3)
        out /= np.linalg.norm(out)
        end = out * random.uniform(radius, radius + thickness - sagitta)
        position, velocity = meet(0, 0.01, 0.7 * out, end, -out)
        distance, normal = judge.distances(Sphere(center=(0.0, 0.0, 0.0), radius=radius), position)
        assert thickness - sagitta - 1e-12 <= distance[0] <= thickness + 1e-12
        assert normal @ velocity == pytest.approx(0, abs=circumradius / radius)


def test_a_valley_holds_a_mass(tmp_path: Path) -> None:
    """Between two slopes of the angle a the place at the thickness t from both is t / cos a above the bottom. A mass is moved
    on until it is no nearer than t (1 - 1/64) to either, or four times; of slopes so steep that this is not enough it is held
    where it was, and never below."""
    for degrees in (30, 60, 85):
        s, c = sin(radians(degrees)), cos(radians(degrees))
        points = [[-c, s, -1], [-c, s, 1], [0, 0, -1], [0, 0, 1], [c, s, -1], [c, s, 1]]
        file = written(tmp_path / f"valley{degrees}.obj", points, [[0, 1, 3], [0, 3, 2], [2, 3, 5], [2, 5, 4]])
        mesh = MeshCollider(file=file, thickness=0.02, static_friction=0.2, dynamic_friction=0.2)
        position, velocity = fall(mesh, (0.03 * c, 0.5, 0.1), (0, -1.0, 0), 400, 0.002)
        away = [position @ (-side * s, c, 0) for side in (1, -1)]
        assert min(away) > 0 and position[1] > 0
        if degrees < 85:
            assert min(away) >= 0.02 * SETTLED - 1e-12
            assert position[1] == pytest.approx(0.02 / c, rel=2 / 64)
            assert np.linalg.norm(velocity) < 2 * 9.81 * 0.002  # no more than two steps of gravity


@each_precision
def test_a_mass_at_rest_rests(floor: str, real: Any) -> None:
    meet, dt = touch(MeshCollider(file=floor, thickness=0.05, static_friction=0.3), real), real(0.01)
    p, v = np.array([0.3, 0.05, 0.4], real), np.zeros(3, real)
    for step in range(200):
        v = v - np.array([0, real(9.81) * dt, 0], real)
        p, v = meet(step * dt, (step + 1) * dt, p, p + dt * v, v)
    assert not v.any()
    assert np.abs(p - np.array([0.3, 0.05, 0.4], real)).max() <= np.finfo(real).eps * 0.05


# ---------------------------------------------------------------------- what moves


def test_a_floor_carries_a_mass(floor: str) -> None:
    """It rises at 0.5 m/s and goes sideways at 0.8: what stuck to it has its velocity, at the thickness above it, and
    has gone with it since it landed."""
    mesh = MeshCollider(
        file=floor, origin=(0.0, -0.2, 0.0), velocity=(0.8, 0.5, 0.0), thickness=0.02, static_friction=5.0
    )
    position, velocity = fall(mesh, (0.1, 0.0, 0.0), (0, 0, 0), 300, 0.001)
    assert velocity == pytest.approx([0.8, 0.5, 0], abs=1e-12)
    assert position[1] == pytest.approx(-0.2 + 0.3 * 0.5 + 0.02, abs=1e-12)
    again, _ = fall(mesh, (0.1, 0.0, 0.0), (0, 0, 0), 400, 0.001)
    assert again[0] - position[0] == pytest.approx(0.1 * 0.8, abs=1e-12)


def test_a_fast_wall_sweeps_a_mass_along(floor: str) -> None:
    """At 100 m/s it passes 1 m in a step: the mass in its way is ahead of it then, at the thickness, as fast as it is."""
    wall = MeshCollider(
        file=floor, angle=90.0, axis=(0.0, 0.0, 1.0), origin=(-0.5, 0.0, 0.0), velocity=(100.0, 0.0, 0.0)
    )
    position, velocity = touch(wall)(0, 0.01, (0.1, 0.2, 0.3), (0.1, 0.2, 0.3), (0.0, 0.0, 0.0))
    assert position == pytest.approx([0.51, 0.2, 0.3], abs=1e-14)
    assert velocity == pytest.approx([100, 0, 0], abs=1e-12)


def test_a_turntable_turns_what_sticks_to_it(floor: str) -> None:
    """Friction takes velocities to the floor's, positions follow them: each step turns by atan(w h) and leads out by
    sqrt(1 + w^2 h^2), as a step along the tangent does."""
    spin, dt, steps = 2.0, 0.01, 100
    mesh = MeshCollider(file=floor, spin=(0.0, spin, 0.0), thickness=0.02, static_friction=5.0)
    position, velocity = fall(mesh, (0.5, 0.02, 0.0), (0, 0, -spin * 0.5), steps, dt)
    radius, angle = 0.5 * sqrt(1 + spin**2 * dt**2) ** steps, steps * atan(spin * dt)
    assert position == pytest.approx([radius * cos(angle), 0.02, -radius * sin(angle)], abs=1e-12)
    assert velocity == pytest.approx(np.cross([0, spin, 0], position), abs=1e-12)


def test_a_blade_that_turns_sweeps_a_mass(floor: str) -> None:
    """A wall that turns about the y axis by a quarter in a step hits a mass at rest: it is on the side it was on, at the
    thickness, and moves with the place where it touches."""
    wall = MeshCollider(file=floor, angle=90.0, axis=(0.0, 0.0, 1.0), spin=(0.0, 5 * np.pi, 0.0), thickness=0.01)
    meet = touch(wall)
    before = np.array([-0.1, 0.2, 0.8])  # the wall x = 0 turns its half z > 0 towards +x, its half z < 0 towards -x
    assert meet(0, 0.1, before, before, np.zeros(3))[0].tolist() == before.tolist()
    place = np.array([0.3, 0.2, 0.5])
    position, velocity = meet(0, 0.1, place, place, np.zeros(3))
    normal = np.array([0.0, 0.0, -1.0])  # of the wall after a quarter, to the side that +x was
    assert position @ normal == pytest.approx(0.01, abs=1e-12)
    surface = np.cross([0, 5 * np.pi, 0], position)
    assert (velocity - surface) @ normal == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(
    ("spin", "in_place"), [((0.0, 0.0, 0.0), False), ((1.0, 2.0, -0.5), False), ((1.0, 2.0, -0.5), True)]
)
def test_formulas_are_the_references(spin: Any, in_place: bool) -> None:
    """Of masses that fall on the terrain: the reference knows no tree."""
    mesh = {
        "shape": TERRAIN, "origin": (0.1, -0.2, 0.3), "angle": 20.0, "axis": (1.0, 0.2, 0.0), "velocity": (0.3, 0.1, -0.2),
        "spin": spin, "thickness": 0.12, "static_friction": 0.3, "dynamic_friction": 0.2,
    }  # fmt: skip
    scene = cloth(10, 20, mesh_collider=mesh, method={"dt": 0.02})
    random = np.random.default_rng(8)
    position = random.uniform(-2, 2, (200, 3)) * [1, 0.15, 1] - [0, 0.3, 0]
    check_formulas(scene, touch(MeshCollider(**mesh), in_place=in_place), position, random, 160, in_place)


@each_precision
def test_compiled_formulas_have_the_bits_of_plain_ones(real: Any) -> None:
    ways = np.abs(np.random.default_rng(9).normal(size=(150, 12))) * 0.3
    ways[:, :9] = np.random.default_rng(10).normal(size=(150, 9))
    assert 30 < check_compiled(formulas, tree_numbers(soup(30, 2), real), ways.astype(real)) < 150


@each_solver
def test_a_cloth_falls_on_it(solver: str) -> None:
    mesh = {"shape": TERRAIN, "velocity": (0.1, 1.0, 0.0), "spin": (0.0, 0.3, 0.0), "thickness": 0.05}
    scene = cloth(
        6, 7, sheet={"placement": "flat", "origin": (-0.3, 0.5, 0.2)}, structural={"stiffness": 5.0}, gravity={},
        mesh_collider=mesh | {"static_friction": 0.4, "dynamic_friction": 0.3},
        method={"integrator": "semi-implicit-euler", "dt": 0.01},
    )  # fmt: skip
    check_falling_cloth(solver, scene, "mesh_collider")
