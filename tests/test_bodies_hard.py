"""Hard cases of bodies: squashed, inside out, shot at walls at 100 m/s, hit in flight, begun inside each other.

What holds is held against a bound that follows from the step; what the method cannot do is written where it is met.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bodies_scenes import end_state, opened, same
from hard_bodies import (
    BRICK,
    CHANGED,
    FLOOR,
    RIGID_SPACING,
    SEPARATION,
    SOFT,
    SPACING,
    SPEED,
    TILTED,
    ULP,
    centre,
    changed,
    heap,
    kinetic,
    masses,
    meeting,
    nearest,
    out_of_shape,
    shot,
    stack,
)

from model.scene import Scene
from model.simulation import State

BOTH = pytest.mark.parametrize("precision", ["float64", "float32"])

# ---------------------------------------------------------------------- squashed, and inside out


@pytest.mark.parametrize("how", CHANGED)
def test_a_rigid_body_is_whole_after_one_substep(how: str) -> None:
    """Whatever was done to it: any rotation is one, and the next substep takes the way back out of the velocities. Goals are
    some 30 roundings of half a metre."""
    scene = meeting(body=BRICK)
    with opened(scene, initial=changed(scene, CHANGED[how])) as simulation:
        simulation.advance(1)
        assert out_of_shape(scene, simulation.state().position) < 15 * ULP["float64"]
        simulation.advance(2)
        state = simulation.state()
    assert out_of_shape(scene, state.position) < 15 * ULP["float64"]
    assert np.abs(state.velocity).max() < 3 * 15 * ULP["float64"] / 0.01
    assert np.abs(centre(scene, state.position) - centre(scene, scene.crowd.position)).max() < 6 * 15 * ULP["float64"]


@BOTH
@pytest.mark.parametrize("how", CHANGED)
def test_a_soft_body_finds_its_shape_again(how: str, precision: str) -> None:
    """It swings about it, and what a step takes away brings it there: a body caught in another shape, twisted or inside out,
    would have particles half a spacing off. It never has more energy than was put in, and what overlaps inside it was given,
    a speed of separation a particle; its momentum stays 0, but for rounding of places of 1 m in 1000 steps."""
    scene = meeting(body=SOFT)
    begin = changed(scene, CHANGED[how])
    given = scene.crowd.clusters.energy(begin.position) + masses(scene).sum() * SEPARATION**2 / 2
    with opened(scene, initial=begin, precision=precision) as simulation:
        for _ in range(50):
            simulation.advance(1)
            assert kinetic(scene, simulation.state().velocity) < given
        simulation.advance(950)
        state = simulation.state()
    assert out_of_shape(scene, state.position) < SPACING / 100
    assert np.abs(centre(scene, state.velocity)).max() < 1000 * 8 * ULP[precision] / 0.01


# ---------------------------------------------------------------------- shot at a wall at 100 m/s


@BOTH
@pytest.mark.parametrize("substeps", [1, 16])
@pytest.mark.parametrize("body", [SOFT, BRICK], ids=["soft", "rigid"])
def test_a_plane_stops_it(body: dict[str, Any], substeps: int, precision: str) -> None:
    """A half-space holds at any speed, as nothing is behind it. Its answer takes energy away, and what of a rigid body was
    pushed out of it alone turns and lifts it, from the speed that it had."""
    scene = meeting(
        substeps=substeps, plane=FLOOR, body=body | TILTED | {"velocity": [0.0, -SPEED, 0.0], "origin": [0.0, 1.0, 0.0]}
    )
    energy, peak = kinetic(scene, scene.crowd.velocity), 0.0
    with opened(scene, precision=precision) as simulation:
        for _ in range(20):
            simulation.advance(1)
            state = simulation.state()
            peak = max(peak, kinetic(scene, state.velocity))
            assert state.position[:, 1].min() > -4 * ULP[precision]
        assert peak < energy
        simulation.advance(1000)
        state = simulation.state()
    assert out_of_shape(scene, state.position) < body["particle_spacing"] / 10
    assert (state.position[:, 1] > 0).all()


@pytest.mark.parametrize("substeps,stops", [(4, True), (1, False)])
def test_a_box_stops_what_goes_less_than_half_its_thickness(substeps: int, stops: bool) -> None:
    """It is not swept: what is inside leaves by the nearest face. A box of 1 m stops what goes 0.25 m a substep, and what
    goes 1 m, begun 0.1 m above it, is next below its middle, and leaves downwards."""
    box = {"kind": "box", "center": [0.0, -0.5, 0.0], "half_size": [2.0, 0.5, 2.0]}
    scene = meeting(
        substeps=substeps, box=box, sphere={"kind": "sphere", "center": [0.0, 1e5, 0.0], "radius": 1.0},
        body=BRICK | {"velocity": [0.0, -SPEED, 0.0], "origin": [0.0, 0.2, 0.0]},
    )  # fmt: skip
    state = end_state(scene, steps=20, kernel="stages")
    assert np.isfinite(state.velocity).all() and kinetic(scene, state.velocity) <= kinetic(scene, scene.crowd.velocity)
    assert (state.position[:, 1].min() > -4 * ULP["float64"]) == stops


@pytest.mark.parametrize("angle,aside", [(0.0, 0.0), (0.0, 0.05), (25.0, 0.03), (90.0, -0.04)])
@pytest.mark.parametrize("stiffness", [np.inf, 1e6])
def test_another_body_stops_what_goes_an_eighth_of_a_distance(stiffness: float, angle: float, aside: float) -> None:
    """Two layers, so that half of a body's mass is in a projection, and masses split among up to four contacts: what goes an
    eighth of the distance a substep comes a few of them near for a moment, but neither through nor is it caught. Momentum is
    kept but for roundings of places of 1 m, and energy is only taken away: half of it by a hit in the middle, less beside it.
    (A jelly that is softer than its speed over its thickness, w = 63/s, bends round the other and flies on beside it.)"""
    kind = BRICK if np.isinf(stiffness) else SOFT | {"cluster_stiffness": stiffness}
    scene = shot(0.125, kind, angle, aside)
    steps, h, energy = round(0.04 / scene.method.dt), scene.method.dt, kinetic(scene, scene.crowd.velocity)
    with opened(scene) as simulation:
        for _ in range(20):
            simulation.advance(steps // 20)
            state = simulation.state()
            assert kinetic(scene, state.velocity) < energy * (1 + 1e-9)
            assert centre(scene, state.position, 1)[1] > centre(scene, state.position, 0)[1] + RIGID_SPACING
    assert kinetic(scene, state.velocity) < 0.9 * energy
    assert nearest(scene, state.position) > 0.9 * (kind["particle_spacing"] + RIGID_SPACING) / 2
    change = (masses(scene) * (state.velocity - scene.crowd.velocity)).sum(axis=0)
    assert np.abs(change).max() < steps * 8 * masses(scene).sum() * 4 * ULP["float64"] / h


def test_what_goes_too_far_in_a_substep_passes_and_a_maximum_speed_holds_it() -> None:
    """As model/particle_contact.py says: at eight distances a substep it is on the other side, untouched; slowed to an eighth
    of one it stays on its own."""
    free, held = shot(8.0, BRICK, 0.0, 0.05), shot(8.0, BRICK, 0.0, 0.05, maximum_speed=SPEED / 64)
    state = end_state(free, steps=4)
    assert centre(free, state.position, 1)[1] < centre(free, state.position, 0)[1] - 1
    assert np.abs(state.velocity - free.crowd.velocity).max() < 1e-9
    state = end_state(held, steps=200)
    assert centre(held, state.position, 1)[1] > centre(held, state.position, 0)[1] + RIGID_SPACING


# ---------------------------------------------------------------------- a hit in free flight


def hit(substeps: int, kind: dict[str, Any], **contact: float) -> Scene:
    """One body comes down on another, beside its middle."""
    one = kind | {"velocity": [0.0, -2.0, 0.0], "origin": [0.35, 0.3, 0.02]}
    return meeting(substeps=substeps, one=one, other=kind, contact=contact)


def spin(scene: Scene, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """(3,) [kg m^2/s]: of all about the centre of all."""
    found: np.ndarray = np.cross(position - centre(scene, position), masses(scene) * velocity).sum(axis=0)
    return found


@BOTH
@pytest.mark.parametrize("kind", [SOFT, BRICK], ids=["soft", "rigid"])
def test_a_hit_keeps_linear_momentum(kind: dict[str, Any], precision: str) -> None:
    """With friction. A substep rounds a place of 1 m some eight times, always the same way of a body at rest, and a rounding
    over h is a velocity, which stays."""
    scene, substeps = hit(4, kind), 4 * 30
    state = end_state(scene, steps=30, precision=precision)
    change = centre(scene, state.velocity.astype(float) - scene.crowd.velocity)
    assert np.abs(centre(scene, state.velocity, 0) - [0, -2, 0]).max() > 0.5
    assert np.abs(change).max() < substeps * 8 * ULP[precision] / 0.0025


@pytest.mark.parametrize("kind,order", [(SOFT, 0.5), (BRICK, 0.8)], ids=["soft", "rigid"])
def test_a_hit_keeps_angular_momentum_at_first_order(kind: dict[str, Any], order: float) -> None:
    """Without friction, which acts at the particles' middles. Spin is lost by its law (NUMERICS A8), w^2 h t of it in
    t = 0.3 s; a hit of bodies alike that does not rebound, M v / 2 at the end of a bar of length L, gives w = 3 v / L = 6/s
    at most. So it falls with h: a jelly's swings are lost and gained beside it."""
    lost = []
    for substeps in (2, 8, 32):
        scene = hit(substeps, kind, static_friction=1e-30, dynamic_friction=0.0)
        state, before = end_state(scene, steps=30), spin(scene, scene.crowd.position, scene.crowd.velocity)
        change = spin(scene, state.position, state.velocity) - before
        lost.append(float(np.linalg.norm(change) / np.linalg.norm(before)))
        assert lost[-1] < 6**2 * 0.3 * 0.01 / substeps
    assert lost[0] / lost[2] > 16**order


# ---------------------------------------------------------------------- B17: inside each other at the start


@BOTH
@pytest.mark.parametrize("iterations", [1, 4])
@pytest.mark.parametrize("aside", [(0.0, 0.2, 0.0), (0.02, 0.1, 0.03), (0.0, 0.0, 0.0), (0.3, 0.05, 0.07)])
@pytest.mark.parametrize("kinds", [(SOFT, SOFT), (BRICK, BRICK), (BRICK, BRICK | {"density": 1e5})])
def test_what_begins_inside_another_is_let_go_slowly(
    kinds: tuple[dict[str, Any], ...], aside: tuple[float, ...], iterations: int, precision: str
) -> None:
    """NUMERICS B17. Contacts lead particles apart at v, the speed of separation. The rest of the body follows as a mass on a
    spring whose end moves: y = v t - v sin(w t) / w, at 2 v at most, whatever w. So two bodies part at 2 v at most, with an
    energy of 2 mu v^2, mu = m M / (m + M): of bodies alike m v^2 / 2 a particle. (What lies deeper than half a body may stay
    caught, since particles do not know an inside.)"""
    one, other = kinds
    scene = meeting(iterations=iterations, one=one | {"origin": list(aside)}, other=other)
    m, M = (masses(scene)[scene.crowd.body == body].sum() for body in (0, 1))
    with opened(scene, precision=precision) as simulation:
        for _ in range(60):
            simulation.advance(1)
            velocity = simulation.state().velocity.astype(float)
            assert kinetic(scene, velocity) < 2 * m * M / (m + M) * SEPARATION**2
            parting = centre(scene, velocity, 0) - centre(scene, velocity, 1)
            assert np.linalg.norm(parting) < 2 * SEPARATION
        simulation.advance(40)
        state = simulation.state()
    assert not aside[1] >= 0.2 or nearest(scene, state.position) > (1 - 1e-5) * one["particle_spacing"]
    assert out_of_shape(scene, state.position) < SPACING


def test_a_ball_inside_a_body_pushes_it_out_in_place() -> None:
    """NUMERICS B17: a collider puts particles on its surface within a step, and no speed comes from the depth d. What the
    clusters then hold, is what their ways out have bent them by, w^2 m d^2 / 2 each, and there never is more than that."""
    middle, reach = np.array([0.0, -0.16, 0.0]), 0.16
    ball = {"kind": "sphere", "center": middle.tolist(), "radius": 0.15, "thickness": 0.01}
    scene = meeting(sphere=ball, box={"kind": "box", "center": [0.0, 1e5, 0.0]}, body=SOFT, substeps=4)
    clusters = scene.crowd.clusters
    depths = np.maximum(reach - np.linalg.norm(scene.crowd.position - middle, axis=1), 0)
    given = 4000.0 / 2 * float((clusters.mass * depths**2).sum())
    assert 0.02 < depths.max() < 0.03
    with opened(scene, kernel="stages") as simulation:
        for _ in range(100):
            simulation.advance(1)
            state = simulation.state()
            assert np.linalg.norm(state.position - middle, axis=1).min() > reach - 8 * ULP["float64"]
            assert kinetic(scene, state.velocity) + clusters.energy(state.position) < given
    assert kinetic(scene, state.velocity) > given / 10


# ---------------------------------------------------------------------- the same on a GPU


def cases() -> dict[str, tuple[Scene, State | None, int]]:
    """(scene, where it begins, steps) of the worst ones."""
    soft = meeting(body=SOFT)
    return {
        "a point": (soft, changed(soft, CHANGED["into a point"]), 200),
        "mirrored": (soft, changed(soft, CHANGED["mirrored"]), 200),
        "shot": (shot(0.125, BRICK, 25.0, 0.03), None, 200),
        "inside": (meeting(one=SOFT | {"origin": [0.02, 0.1, 0.03]}, other=BRICK), None, 100),
        "stack": (stack(4), None, 100),
        "heap": (heap(8, 4), None, 200),
    }


@pytest.mark.gpu
@BOTH
@pytest.mark.parametrize("case", ["a point", "mirrored", "shot", "inside", "stack", "heap"])
def test_a_gpu_has_the_cpus_bits(case: str, precision: str) -> None:
    from gpu_backend.device import gpu_available, simulated

    works, reason = gpu_available()
    if not works or simulated():
        pytest.skip(reason if not works else "the CUDA simulator is no GPU")
    scene, begin, steps = cases()[case]
    expected = end_state(scene, start=begin, steps=steps, precision=precision)
    for kernel in ("graph", "launch"):
        found = end_state(scene, "gpu", start=begin, steps=steps, precision=precision, kernel=kernel)
        assert same(found, expected), kernel
