"""Rigid bodies that come off colliders as a whole: steps against the NumPy reference and among kernels and threads, what
a body gets that lands flat, on a corner and spinning, how high it comes, and scenes without it.

All scenes have the same parts, so that kernels are compiled once.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bodies_scenes import BAR, bodies_scene, by_hand, clusters_of, end_state, method, opened, same, start
from rebound_scenes import BRICK, FLOOR, among_soft_ones, dropped

from softlab.bench.reference import shape_matching as reference
from softlab.model.assets.clusters import whole_clusters
from softlab.model.scene.scene import Scene
from softlab.model.shape_matching.plan import body_parts, body_plan
from softlab.model.shape_matching.rigid_rebound import rebound_limits

G = 9.81
CORNERS = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1)])


def cube(restitution: float, friction: float = 0.0, lift: float = 0.0) -> Scene:
    """Eight particles of 1 kg each without weight, the lower four of them at the floor's surface, but for `lift` [m] of all
    but the first one."""
    at = CORNERS + np.array([0.0, 0.1, 0.0])
    at[1:, 1] += lift
    floor = FLOOR | {"restitution": restitution, "static_friction": max(friction, 1e-30), "dynamic_friction": friction}
    return by_hand(clusters_of(at, [np.arange(8)]), body=BRICK, gravity=0.0, plane=floor, method=method(dt=1e-4))


def energy(scene: Scene, velocity: np.ndarray) -> float:
    """[J] of motion."""
    return 0.5 * float((scene.body_set.clusters.mass * (velocity**2).sum(axis=1)).sum())


# ---------------------------------------------------------------------- whole steps


def test_among_soft_bodies_and_contacts() -> None:
    """As in test_particle_contacts.py; only the brick is answered as a whole."""
    scene = among_soft_ones()
    position, velocity = reference.simulate(scene, 8)
    first = end_state(scene, kernel="stages", steps=8)
    assert np.abs(first.position - position).max() < 6e-12
    assert np.abs(first.velocity - velocity).max() < 6e-12 / 0.005
    for threads in (1, 3):
        assert same(first, end_state(scene, steps=8, threads=threads))
    assert whole_clusters(scene.body_set.clusters).sum() == 1 and scene.body_set.clusters.count > 2


# ---------------------------------------------------------------------- laws of an impact


@pytest.mark.parametrize("restitution", [0.3, 1.0])
def test_flat_the_whole_body_turns_round(restitution: float) -> None:
    """Half of a cube touches, and all of it goes up with e of its 4 m/s: but for roundings of 0.2 m over h."""
    scene = cube(restitution)
    state = end_state(scene, start=start(scene, velocity=np.tile([0.0, -4.0, 0.0], (8, 1))), steps=1)
    assert state.velocity == pytest.approx(np.tile([0.0, 4.0 * restitution, 0.0], (8, 1)), abs=1e-10)


def test_on_a_corner_it_gets_what_a_rigid_body_does() -> None:
    """One particle at r from the middle: J = (1 + e) v / (1/M + (r x n) I^-1 (r x n)), I = M a^2 / 2 for masses at corners
    of a cube. The others are lifted by 1 mm, which tells of r in the third digit, and the substep's way of 0.4 mm."""
    e, v, mass, inertia = 0.6, 4.0, 8.0, 8.0 * 0.2**2 / 2
    scene = cube(e, lift=1e-3)
    state = end_state(scene, start=start(scene, velocity=np.tile([0.0, -v, 0.0], (8, 1))), steps=1)
    arm = np.cross(CORNERS[0], [0.0, 1.0, 0.0])
    impulse = (1 + e) * v / (1 / mass + arm @ arm / inertia)
    assert state.velocity[:, 1].mean() == pytest.approx(impulse / mass - v, rel=0.01)
    assert state.velocity[0, 1] == pytest.approx(e * v, rel=0.01)
    spin = np.cross(CORNERS, state.velocity).sum(axis=0) / inertia
    assert spin == pytest.approx(impulse * arm / inertia, rel=0.02, abs=0.02 * np.abs(spin).max())


@pytest.mark.parametrize("friction", [0.0, 0.4])
@pytest.mark.parametrize("restitution", [0.5, 1.0])
def test_no_impact_gives_energy(restitution: float, friction: float) -> None:
    """Cubes that come down spinning: with e = 1 and nothing that rubs all of the energy stays, for any of their corners that
    touch. The floor's pushes move them by 0.4 mm of 0.1 m, and as much is left open of the arms."""
    scene, random = cube(restitution, friction), np.random.default_rng(5)
    for _ in range(12):
        spin, along = random.normal(0, 5, 3), random.normal(0, 2, 2)
        velocity = np.cross(spin, CORNERS) + np.array([along[0], -4.0, along[1]])
        with opened(scene, initial=start(scene, velocity=velocity)) as simulation:
            simulation.advance(1)
            found = energy(scene, simulation.state().velocity)
        assert found <= energy(scene, velocity) * (1 + 0.01)
        if restitution == 1 and friction == 0:
            assert found == pytest.approx(energy(scene, velocity), rel=0.01)


def test_it_is_bound_by_what_one_particle_could_do() -> None:
    """Under the middle: M over its mass."""
    clusters = clusters_of([*CORNERS, [3.0, 0.0, 0.0]], [np.arange(8), [8]], mass=[1.0] * 7 + [3.0, 1.0])
    assert rebound_limits(clusters).tolist() == [10.0, 0.0]


# ---------------------------------------------------------------------- how high it comes


def test_it_comes_to_rest() -> None:
    """After bounces whose times sum to 3 times the fall: it neither sinks nor trembles."""
    with opened(dropped(0.5, dt=0.005)) as simulation:
        simulation.advance(600)
        state = simulation.state()
    assert np.abs(state.velocity).max() < 2 * G * 0.0025 and state.position[:, 1].min() > -G * 0.0025**2 * 28


# ---------------------------------------------------------------------- bodies that meet


def two_bricks(restitution: float, density: float = 1000.0, **other: Any) -> Scene:
    """One goes at 1 m/s along x and meets the other, which rests, with a seventh of its particles."""
    brick = BRICK | {"origin": [-1.1, 0.0, 0.0], "velocity": [1.0, 0.0, 0.0]}
    contact = {"restitution": restitution, "static_friction": 0.0, "dynamic_friction": 0.0}
    other = BRICK | {"density": density} | other
    return bodies_scene(one=brick, other=other, contact=contact, gravity=0.0, method=method(1, 1, 0.005))


@pytest.mark.parametrize("density", [1000.0, 3000.0])
@pytest.mark.parametrize("restitution", [0.3, 1.0])
def test_two_that_meet_flat_part_at_e_of_their_speed(restitution: float, density: float) -> None:
    """Whatever they weigh, and their momentum stays. 80 substeps that round places of 1 m to 2^-53 of it, over h, each for 28
    particles that what is shared sums up."""
    scene = two_bricks(restitution, density)
    velocity, mass = end_state(scene, kernel="stages", steps=80).velocity, scene.body_set.clusters.mass
    one, other = (np.average(velocity[part], axis=0, weights=mass[part]) for part in (slice(28), slice(28, 56)))
    rounding = 80 * 28 * 2.0**-52 / 0.005
    assert other - one == pytest.approx(np.array([restitution, 0.0, 0.0]), abs=rounding)
    assert mass[:28].sum() * one[0] + mass[28:].sum() * other[0] == pytest.approx(mass[:28].sum(), rel=2 * rounding)


def test_bodies_that_meet_anyhow_gain_no_energy() -> None:
    """With e = 1: tilted and beside each other; angular momentum goes with impulses that lie along pairs."""
    for other in ({"origin": [0.0, 0.2, 0.1]}, {"origin": [0.0, 0.1, 0.0], "angle": 50.0, "axis": [0.3, 0.2, 1.0]}):
        scene, found = two_bricks(1.0, **other), []
        with opened(scene, kernel="stages") as simulation:
            for _ in range(20):
                simulation.advance(5)
                found.append(energy(scene, simulation.state().velocity))
        before = energy(scene, scene.body_set.velocity)
        assert max(found) < before * (1 + 1e-9) and found[-1] > 0.9 * before


# ---------------------------------------------------------------------- scenes


def test_only_rigid_bodies_that_something_stops_need_it() -> None:
    """Whatever is given back: without it particles alone are stopped, and their bodies come back."""
    for scene in (dropped(0.5), dropped(0.0)):
        assert {"rigid-rebound", "rigid-motion"} <= body_parts(scene) and body_plan(scene).has("rebound")
    alone = Scene({name: table for name, table in dropped(0.5).as_dict().items() if name != "plane"})
    assert "rigid-motion" in body_parts(alone) and body_plan(alone).has("keep momenta")
    for none in (alone, bodies_scene(bar=BAR, plane=FLOOR | {"restitution": 0.5})):
        assert "rigid-rebound" not in body_parts(none) and not body_plan(none).has("rebound")
    assert "rigid-motion" not in body_parts(none) and not body_plan(none).has("keep momenta")
