"""Colliders of a cloth: distances against many points of a surface, Coulomb's law, and the two hard cases of a ball."""

from __future__ import annotations

from math import atan, cos, pi, sin, sqrt

import numpy as np
import pytest
from cloth_solve import cloth, each_solver, solve

from softlab.bench.reference import cloth as judge
from softlab.bench.reference import mass_spring as reference
from softlab.model.base.variant import plain_formulas
from softlab.model.core.energy import energies
from softlab.model.formulas import colliders as formulas
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import Box, Capsule, Plane, Sphere

POINTS = 40_000  # of a surface


def ball(count: int) -> np.ndarray:
    """(count, 3) points of the unit sphere, evenly spread (a golden spiral)."""
    k = np.arange(count) + 0.5
    height, angle = 1 - 2 * k / count, pi * (1 + sqrt(5)) * k
    return np.stack([np.sqrt(1 - height**2) * np.cos(angle), np.sqrt(1 - height**2) * np.sin(angle), height], axis=1)


def sphere_points() -> np.ndarray:
    return np.array([0.1, -0.2, 0.3]) + 0.5 * ball(POINTS)


def capsule_points() -> np.ndarray:
    """Two balls' outer halves and the tube between them."""
    start, end, radius = np.array([0.0, 0.1, 0.0]), np.array([0.6, 0.4, -0.3]), 0.2
    axis = (end - start) / np.linalg.norm(end - start)
    round_ = ball(POINTS)
    caps = [start + radius * round_[round_ @ axis <= 0], end + radius * round_[round_ @ axis >= 0]]
    u = np.cross(axis, [0, 0, 1.0])
    u /= np.linalg.norm(u)
    angle, part = np.meshgrid(np.linspace(0, 2 * pi, 300), np.linspace(0, 1, 150))
    side = np.cos(angle)[..., None] * u + np.sin(angle)[..., None] * np.cross(axis, u)
    return np.concatenate([*caps, (start + part[..., None] * (end - start) + radius * side).reshape(-1, 3)])


def box_points() -> np.ndarray:
    u, v = (part.ravel() for part in np.meshgrid(np.linspace(-1, 1, 120), np.linspace(-1, 1, 120)))
    faces = [np.insert(np.stack([u, v], axis=1), axis, sign, axis=1) for axis in range(3) for sign in (-1, 1)]
    return np.array([0.2, 0.0, -0.1]) + np.concatenate(faces) * (0.4, 0.25, 0.3)


BODIES = {
    "sphere": (Sphere(center=(0.1, -0.2, 0.3), radius=0.5), sphere_points),
    "capsule": (Capsule(start=(0.0, 0.1, 0.0), end=(0.6, 0.4, -0.3), radius=0.2), capsule_points),
    "box": (Box(center=(0.2, 0.0, -0.1), half_size=(0.4, 0.25, 0.3)), box_points),
}


@pytest.mark.parametrize("kind", BODIES)
def test_distances_are_those_to_the_nearest_point(kind):
    """|distance| to the nearest of many points of the surface: never nearer than it, and farther by less than the points
    lie apart. The normal leads along the distance's gradient (central differences: h^2 / 2 distance < 1e-6)."""
    body, surface = BODIES[kind]
    points, places = surface(), np.random.default_rng(1).uniform(-0.7, 0.7, (100, 3))
    distance, normal = judge.distances(body, places)
    nearest = np.array([np.sqrt(((points - place) ** 2).sum(axis=1).min()) for place in places])
    apart = (
        0.012  # m, from any place of a surface to the nearest point: at most sqrt(4 pi 0.25 / 40 000) = 0.009 and sides
    )
    assert (np.abs(distance[:, 0]) <= nearest + 1e-12).all()
    assert (nearest <= np.abs(distance[:, 0]) + apart).all()
    assert (distance > 0).any() and (distance < 0).any()
    h = 1e-5
    for axis in range(3):
        ahead, behind = (judge.distances(body, places + sign * h * np.eye(3)[axis])[0] for sign in (1, -1))
        smooth = np.abs(distance[:, 0]) > 0.05  # away from edges, where a box's normal jumps
        slope = ((ahead - behind) / (2 * h))[:, 0]
        assert np.isclose(slope, normal[:, axis], atol=1e-6)[smooth].mean() > 0.95
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1, abs=1e-14)


@pytest.mark.parametrize("kind", [*BODIES, "plane"])
def test_formulas_are_the_references(kind):
    """The backends' distances (model/formulas/colliders.py) at random places, and at the centre, within 8 roundings."""
    body = BODIES[kind][0] if kind in BODIES else Plane(point=(0.1, 0.2, 0.3), normal=(1.0, 2.0, -1.0))
    made = plain_formulas(formulas, np.float64)
    start = np.array(getattr(body, {"plane": "point", "capsule": "start"}.get(kind, "center")))
    own = {
        "plane": lambda: np.array(body.normal) / np.linalg.norm(body.normal),
        "sphere": lambda: [body.radius],
        "capsule": lambda: [*np.subtract(body.end, body.start), body.radius],
        "box": lambda: body.half_size,
    }[kind]()
    for place in [start, *np.random.default_rng(2).uniform(-1, 1, (200, 3))]:
        distance, normal = judge.distances(body, place)
        assert getattr(made, kind)(*(place - start), *own) == pytest.approx([distance[0], *normal], abs=1e-14)


def block(degrees: float, friction: tuple[float, float], dt: float) -> Scene:
    """One mass on an inclined plane through the origin, falling along +x where it slides."""
    angle = np.radians(degrees)
    plane = {"normal": (sin(angle), cos(angle), 0.0), "thickness": 0.0}
    return cloth(
        1, 1, gravity={}, plane=plane | {"static_friction": friction[0], "dynamic_friction": friction[1]},
        method={"integrator": "semi-implicit-euler", "dt": dt},
    )  # fmt: skip


@each_solver
@pytest.mark.parametrize("degrees", [20, 30])
def test_a_block_sticks_below_the_static_coefficient(solver, degrees):
    """tan a < mu_s: its velocity is 0 after every step. Friction acts on velocities, so that a block still creeps by what
    gravity adds within a step, g dt sin a: first order in dt, and so tested."""
    scene = block(degrees, (np.tan(np.radians(degrees + 1)), 0.1), 0.001)
    position, velocity = solve(solver, scene, 200)
    assert np.abs(velocity).max() < 1e-15
    creep = 200 * 9.81 * 0.001**2 * sin(np.radians(degrees))
    assert np.linalg.norm(position) == pytest.approx(creep, rel=1e-9)


@each_solver
@pytest.mark.parametrize("degrees", [20, 30])
def test_a_block_slides_above_it(solver, degrees):
    """tan a > mu_s: it gains g (sin a - mu_d cos a) a second, in each step exactly (1e-12: 200 roundings)."""
    angle = np.radians(degrees)
    mu = 0.5 * np.tan(angle)
    scene = block(degrees, (np.tan(np.radians(degrees - 1)), mu), 0.001)
    _, velocity = solve(solver, scene, 200)
    gain = 9.81 * (sin(angle) - mu * cos(angle)) * 200 * 0.001
    assert velocity[0] == pytest.approx([gain * cos(angle), -gain * sin(angle), 0], abs=1e-12)


@each_solver
def test_a_mass_lands_on_a_moving_floor(solver):
    """What comes to rest on a floor that rises at 0.5 m/s rises with it, at the thickness above it."""
    floor = {"kind": "plane", "point": (0.0, -0.1, 0.0), "velocity": (0.0, 0.5, 0.0), "thickness": 0.02}
    scene = cloth(1, 1, gravity={}, floor=floor, method={"integrator": "semi-implicit-euler", "dt": 0.001})
    position, velocity = solve(solver, scene, 300)
    assert velocity[0] == pytest.approx([0, 0.5, 0], abs=1e-14)
    assert position[0] == pytest.approx([0, -0.1 + 0.3 * 0.5 + 0.02, 0], abs=1e-14)


def b16(**ball_fields) -> Scene:
    """A free cloth of 21 x 21 masses, spacing 0.05 m, in z = 0, and a ball of radius 0.1 m that flies through it at
    100 m/s, 1.67 m a step of 1/60 s."""
    return cloth(
        21, 21, sheet={"spacing": 0.05, "origin": (-0.5, 0.5, 0.0)},
        structural={"stiffness": 1.0}, shear={"stiffness": 1.0}, bending={"stiffness": 0.1},
        sphere={"center": (0.01, 0.02, -0.8), "velocity": (0.0, 0.0, 100.0), "radius": 0.1} | ball_fields,
        method={"dt": 1 / 60},
    )  # fmt: skip


@each_solver
@pytest.mark.parametrize("integrator", ["velocity-verlet", "semi-implicit-euler"])
def test_b16_a_fast_ball_is_caught(solver, integrator):
    """No mass in the ball's way is passed: after the step it lies on the ball's front, at its radius and thickness; all
    others are where they were. Then nothing explodes: seen from the ball, contacts only take energy away, so that no
    more than the cloth's own m v^2 / 2 is ever there, but for the wobble of a symplectic step, at most
    1 / (1 - (w h / 2)^2) = 1.1 at w^2 = 12 k / m."""
    scene = b16().replace({"method.integrator": integrator})
    dt, reach = 1 / 60, 0.11
    begin = reference.start(scene)[0]
    position, velocity = solve(solver, scene, 1)
    center = np.array([0.01, 0.02, -0.8 + 100 * dt])
    in_the_way = np.hypot(*(begin - center)[:, :2].T) < reach
    assert 10 < in_the_way.sum() < 20
    ahead = position - center
    assert np.linalg.norm(ahead, axis=1)[in_the_way] == pytest.approx(reach, abs=1e-12)
    assert (ahead[in_the_way, 2] > 0).all()
    assert position[~in_the_way] == pytest.approx(begin[~in_the_way], abs=1e-12)
    total = 441 * scene.grid.mass * 100**2 / 2
    for steps in (1, 2, 3, 5, 10, 30, 60):
        position, velocity = solve(solver, scene, steps)
        seen = energies(scene, position, velocity - [0, 0, 100.0])
        assert np.isfinite(position).all()
        center = np.array([0.01, 0.02, -0.8 + 100 * dt * steps])
        assert np.linalg.norm(position - center, axis=1).min() > reach - 1e-9
        assert seen["kinetic"] + seen["spring"] < 1.1 * total


@each_solver
def test_b17_a_ball_inside_the_cloth_at_the_start(solver):
    """Pushed out at once, and only in place: no speed comes from the depth. What springs then hold is what the shift of
    0.05 m at most stretched them by, k (2 d)^2 / 2 each, and less than m v^2 / 2 at v = r / h a mass."""
    scene = b16(center=(0.0, 0.0, -0.06), velocity=(0.0, 0.0, 0.0))
    begin = reference.start(scene)[0]
    inside = np.linalg.norm(begin - [0, 0, -0.06], axis=1) < 0.11
    position, velocity = solve(solver, scene, 1)
    assert np.linalg.norm(position - [0, 0, -0.06], axis=1).min() >= 0.11 - 1e-12
    deepest = (0.11 - np.linalg.norm(begin - [0, 0, -0.06], axis=1)).max()
    assert deepest == pytest.approx(0.05)
    springs = inside.sum() * (4 * 1.0 + 4 * 1.0 + 4 * 0.1) * (2 * 0.05) ** 2 / 2
    most = min(springs, inside.sum() * scene.grid.mass * (0.1 * 60) ** 2 / 2)
    for steps in (1, 2, 5, 20, 60):
        position, velocity = solve(solver, scene, steps)
        found = energies(scene, position, velocity)
        assert 0 < found["total"] < most
        assert np.linalg.norm(position - [0, 0, -0.06], axis=1).min() >= 0.11 - 1e-12


@each_solver
def test_pinned_masses_are_not_moved_by_a_collider(solver):
    scene = b16(center=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0)).replace({"cloth.pinned": [(10, 10)]})
    position, velocity = solve(solver, scene, 3)
    assert position[10 * 21 + 10].tolist() == reference.start(scene)[0][10 * 21 + 10].tolist()
    assert not velocity[10 * 21 + 10].any()


@pytest.mark.parametrize("degrees", [5.0, 40.0])
def test_the_angle_at_which_sticking_ends(degrees):
    """Between 0.999 and 1.001 of the angle whose tangent is the static coefficient the block lets go."""
    mu = np.tan(np.radians(degrees))
    speeds = []
    for share in (0.999, 1.001):
        angle = np.degrees(atan(mu)) * share
        speeds.append(np.linalg.norm(reference.simulate(block(angle, (mu, 0.0), 0.001), 50)[1]))
    assert speeds[0] < 1e-15 and speeds[1] > 0.03
