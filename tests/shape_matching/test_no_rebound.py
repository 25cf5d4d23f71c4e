"""With a restitution of 0 a rigid body stays where it lands, whatever it meets: what particles alone were stopped by came
back as they went to their goals, a quarter of the speed of a cube and half of that of a column."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bodies_scenes import bodies_scene, by_hand, clusters_of, end_state, method, opened, start
from closed_meshes import rotation
from rebound_scenes import BRICK

SMOOTH = {"thickness": 0.0, "static_friction": 1e-30, "dynamic_friction": 0.0}
THICK = SMOOTH | {"thickness": 0.05}
MESH = {"shape": {"name": "box", "resolution": 2, "sides": [4.0, 1.0, 4.0]}, "origin": [0.0, -0.5, 0.0]}
COLLIDERS: dict[str, dict[str, Any]] = {
    "plane": SMOOTH,
    "sphere": SMOOTH | {"center": [0.0, -5.0, 0.0], "radius": 5.0},
    "box": SMOOTH | {"center": [0.0, -0.5, 0.0], "half_size": [2.0, 0.5, 2.0]},
    "capsule": SMOOTH | {"start": [-4.0, -1.0, 0.0], "end": [4.0, -1.0, 0.0], "radius": 1.0},
    "mesh_collider": THICK | MESH,
    "distance_field": THICK | MESH | {"spacing": 0.25},
}


def bodies(counts: tuple[int, int, int]) -> np.ndarray:
    """Particles of a block, 0.2 m apart, its middle at the origin."""
    grid = np.stack(np.meshgrid(*(0.2 * np.arange(count) for count in counts), indexing="ij"), axis=-1).reshape(-1, 3)
    return grid - grid.mean(axis=0)


def landed(points: np.ndarray, colliders: dict[str, Any], dt: float = 1e-4, steps: int = 12, **how: Any) -> np.ndarray:
    """The mean velocity [m/s] of a rigid body that comes down at 1 m/s on what reaches up to y = 0."""
    thickness = max(part["thickness"] for part in colliders.values())
    at = points + np.array([0.0, thickness + 0.25 * dt - points[:, 1].min(), 0.0])
    if "sphere" in colliders or "capsule" in colliders:  # its edges meet a round top beside the middle
        at[:, 1] -= 0.3
        lowest = at[at[:, 1] < at[:, 1].min() + 1e-9]
        z = lowest[0, 2] if "capsule" in colliders else np.hypot(lowest[0, 0], lowest[0, 2])
        radius = 1.0 if "capsule" in colliders else 5.0
        at[:, 1] += np.sqrt(radius**2 - z**2) - radius - at[:, 1].min() + 0.25 * dt
    scene = by_hand(
        clusters_of(at, [np.arange(len(at))]), body=BRICK, gravity=0.0, method=method(1, 1, dt), **colliders
    )
    begin = start(scene, velocity=np.tile([0.0, -1.0, 0.0], (len(at), 1)))
    return np.asarray(end_state(scene, start=begin, steps=steps, **how).velocity.mean(axis=0))


@pytest.mark.parametrize("kind", COLLIDERS)
@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_a_cube_lands_on_anything(kind: str, restitution: float) -> None:
    """Flat, or with four corners beside a round top. A substep's way of 1e-4 m turns a normal of a sphere or a capsule by a
    hundredth of that over their radius; a distance field of cells of 0.2 m is a plane but for roundings near its middle."""
    velocity = landed(bodies((2, 2, 2)), {kind: COLLIDERS[kind] | {"restitution": restitution}})
    assert velocity == pytest.approx(np.array([0.0, restitution, 0.0]), abs=2e-3)


@pytest.mark.parametrize("counts", [(1, 32, 1), (1, 2, 1), (4, 3, 2)])
@pytest.mark.parametrize("dt,substeps", [(1e-4, 1), (1e-2, 1)])
def test_whatever_part_of_it_touches(counts: tuple[int, int, int], dt: float, substeps: int) -> None:
    """A thirty-second of a column, of which a rebound made 0.57 of the speed."""
    velocity = landed(bodies(counts), {"plane": SMOOTH | {"restitution": 0.0}}, dt)
    assert np.abs(velocity).max() < 1e-12


def test_on_a_corner_as_with_next_to_none() -> None:
    """It goes on turning: what comes off is what does at a restitution of 1e-9."""
    cube = bodies((2, 2, 2)) @ rotation([0.5, 0.3, 0.6]).T
    found = [landed(cube, {"plane": SMOOTH | {"restitution": e}}, steps=4) for e in (0.0, 1e-9)]
    assert found[0] == pytest.approx(found[1], abs=1e-8) and found[0][1] < 0


@pytest.mark.parametrize("density", [1000.0, 3000.0])
@pytest.mark.parametrize("left", [0.0, 0.1, 0.4, 0.7, 0.99])
def test_bodies_that_meet_do_not_part(density: float, left: float) -> None:
    """Two bricks at 1 m/s, flat: to roundings as in test_rebound.py. They parted at 0.6 m/s, and later at 0.25 m/s by an
    overlap of part of a substep's way, `left`, which is moved out of the later substeps."""
    dt = 0.005
    one = BRICK | {"origin": [-1.1, 0.0, 0.0], "velocity": [1.0, 0.0, 0.0]}
    contact = {"restitution": 0.0, "static_friction": 0.0, "dynamic_friction": 0.0}
    scene = bodies_scene(
        one=one, other=BRICK | {"density": density}, contact=contact, gravity=0.0, method=method(1, 1, dt)
    )
    at = scene.body_set.position[:, 0]
    gap = at[28:].min() - at[:28].max() - BRICK["particle_spacing"]
    scene = scene.replace({"one.origin": [-1.1 + gap - (1 - left) * dt, 0.0, 0.0]})
    velocity, mass = end_state(scene, kernel="stages", steps=8).velocity, scene.body_set.clusters.mass
    first, second = (np.average(velocity[part], axis=0, weights=mass[part]) for part in (slice(28), slice(28, 56)))
    assert -1e-9 < (second - first)[0] < 1e-9 and second[0] > 0.1


@pytest.mark.parametrize("dt", [0.01, 0.008, 0.005, 0.004])
def test_particles_between_each_others_hardly_part(dt: float) -> None:
    """One brick is turned by a quarter: eight pairs, of up to four a particle, 30 degrees off the way: at sin(30)^4 = 1/16
    of the speed at most, wherever within a substep they meet. They parted at 0.16 m/s."""
    one = BRICK | {"origin": [-1.1, 0.0, 0.0], "velocity": [1.0, 0.0, 0.0]}
    contact = {"restitution": 0.0, "static_friction": 0.0, "dynamic_friction": 0.0}
    other = BRICK | {"angle": 90.0, "axis": [0.0, 1.0, 0.0]}
    scene = bodies_scene(one=one, other=other, contact=contact, gravity=0.0, method=method(1, 1, dt))
    velocity = end_state(scene, kernel="stages", steps=round(0.8 / dt)).velocity
    parting = velocity[28:, 0].mean() - velocity[:28, 0].mean()
    assert 0 < parting < (0.02 if dt == 0.005 else 1 / 16)


def test_a_brick_stays_on_the_floor() -> None:
    """With its weight: it lands at 2 m/s, and lies."""
    floor = {"point": [0.0, 0.0, 0.0], "normal": [0.0, 1.0, 0.0], **SMOOTH, "restitution": 0.0}
    brick = BRICK | {"origin": [0.0, 0.3, 0.0], "velocity": [0.0, -2.0, 0.0]}
    scene, seen = bodies_scene(brick=brick, plane=floor, method=method(2, 1, 0.005)), []
    with opened(scene) as simulation:
        for _ in range(20):
            simulation.advance(2)
            seen.append(simulation.state().velocity[:, 1].max())
    assert max(seen) < 1e-12 and abs(seen[-1]) < 2 * 9.81 * 0.0025
