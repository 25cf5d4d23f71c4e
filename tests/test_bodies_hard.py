"""Hard cases of bodies: squashed, inside out, shot at walls, begun inside each other, stacked, heaped, left alone.

What holds is held against a bound that follows from the step; what the method cannot do is written where it is met. All
scenes but those with a box and a ball have the same parts, some of them next to nothing, so that kernels are compiled once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from bodies_scenes import AWAY, SAMPLED, bodies_scene, end_state, method, opened, same, start

from model.scene import Scene, load_scene
from model.simulation import State

GRAVITY = 9.81  # m/s^2
SEPARATION = 1.0  # m/s
MEET = {"maximum_speed": 1e3, "sleeping_speed": 1e-30, "adhesion_reach": 0.0, "separation_speed": SEPARATION}
SPACING, RIGID_SPACING = 0.16, 0.125  # m
SOFT = {"kind": "soft_body", "particle_spacing": SPACING, "adhesion": 1e-30, **SAMPLED}  # 24 particles, 3 clusters
BRICK = {"kind": "rigid_body", "particle_spacing": RIGID_SPACING, "adhesion": 1e-30, **SAMPLED}  # 32 in two layers
TILTED = {"angle": 30.0, "axis": [0.3, 0.2, 1.0]}
FLOOR = AWAY | {"point": [0.0, 0.0, 0.0]}
ULP = {"float64": 2.0**-53, "float32": 2.0**-24}
BOTH = pytest.mark.parametrize("precision", ["float64", "float32"])

Change = Callable[[np.ndarray], np.ndarray]
SQUASHED: dict[str, Change] = {
    "into a plane": lambda p: p * [0, 1, 1],
    "into its own plane": lambda p: p * [1, 0, 1],
    "onto its axis": lambda p: p * [1, 0, 0],
    "onto a line across": lambda p: p * [0, 1, 0],
    "into a point": lambda p: p * 0,
}
MIRRORED: dict[str, Change] = {"mirrored": lambda p: p * [-1, 1, 1], "inside out": lambda p: -p}
CHANGED = SQUASHED | MIRRORED


def meeting(gravity: float = 0.0, substeps: int = 1, iterations: int = 1, dt: float = 0.01, **tables: Any) -> Scene:
    contact = MEET | tables.pop("contact", {})
    return bodies_scene(gravity=gravity, contact=contact, method=method(substeps, iterations, dt), **tables)


def masses(scene: Scene) -> np.ndarray:
    m: np.ndarray = scene.crowd.clusters.mass[:, None]
    return m


def centre(scene: Scene, values: np.ndarray, body: int | None = None) -> np.ndarray:
    """(3,): the mean by mass of a body's values, or of all."""
    chosen = scene.crowd.body == body if body is not None else np.ones(len(values), bool)
    m = masses(scene)[chosen]
    found: np.ndarray = (m * values[chosen]).sum(axis=0) / m.sum()
    return found


def kinetic(scene: Scene, velocity: np.ndarray) -> float:
    """[J]"""
    return 0.5 * float((masses(scene) * velocity.astype(float) ** 2).sum())


def changed(scene: Scene, change: Change) -> State:
    """At rest, but squashed about its centre."""
    middle = centre(scene, scene.crowd.position)
    return start(scene, change(scene.crowd.position - middle) + middle)


def out_of_shape(scene: Scene, position: np.ndarray) -> float:
    """How far [m] the worst particle is from its place in its body, each body turned as it fits best (det +1)."""
    worst = 0.0
    for body in range(len(scene.crowd.copies)):
        chosen, m = scene.crowd.body == body, masses(scene)[scene.crowd.body == body]
        now = position[chosen] - centre(scene, position, body)
        rest = scene.crowd.position[chosen] - centre(scene, scene.crowd.position, body)
        u, _, v = np.linalg.svd((m * now).T @ rest)
        turn = u @ np.diag([1, 1, np.linalg.det(u) * np.linalg.det(v)]) @ v
        worst = max(worst, float(np.abs(now - rest @ turn.T).max()))
    return worst


def nearest(scene: Scene, position: np.ndarray) -> float:
    """The least distance [m] between particles of two bodies."""
    body = scene.crowd.body
    apart = np.linalg.norm(position[:, None] - position, axis=2)
    return float(apart[body[:, None] != body].min())


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

SPEED = 100.0  # m/s


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
        assert peak < energy and kinetic(scene, state.velocity) < energy / 10
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


def shot(part: float, kind: dict[str, Any], angle: float, aside: float, **contact: float) -> Scene:
    """At a rigid brick at rest, in substeps of `part` of the distance that particles keep."""
    distance = (kind["particle_spacing"] + RIGID_SPACING) / 2
    bullet = kind | {"velocity": [0.0, -SPEED, 0.0], "origin": [aside, 0.6, -aside / 2], "angle": angle}
    return meeting(dt=part * distance / SPEED, wall=BRICK, bullet=bullet | {"axis": [0.2, -0.5, 1.0]}, contact=contact)


@pytest.mark.parametrize("angle,aside", [(0.0, 0.0), (0.0, 0.05), (25.0, 0.03), (90.0, -0.04)])
@pytest.mark.parametrize("stiffness", [np.inf, 1e6])
def test_another_body_stops_what_goes_an_eighth_of_a_distance(stiffness: float, angle: float, aside: float) -> None:
    """Two layers, so that half of a body's mass is in a projection, and masses split among up to four contacts: what goes an
    eighth of the distance a substep comes a few of them near, less than the distance. Momentum is kept but for roundings of
    places of 1 m, and energy is only taken away. (A jelly that is softer than its speed over its thickness, w = 63/s here,
    is squashed to nothing and comes through in parts.)"""
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
    """Without friction, which acts at the particles' middles. What is lost, is lost by the law of spin (NUMERICS A8): w^2 h t
    of it, w < 7/s and t = 0.3 s; so it falls with h."""
    lost = []
    for substeps in (2, 8, 32):
        scene = hit(substeps, kind, static_friction=1e-30, dynamic_friction=0.0)
        state, before = end_state(scene, steps=30), spin(scene, scene.crowd.position, scene.crowd.velocity)
        change = spin(scene, state.position, state.velocity) - before
        lost.append(float(np.linalg.norm(change) / np.linalg.norm(before)))
        assert lost[-1] < 7**2 * 0.3 * 0.01 / substeps
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
    clusters then hold, is what their ways out have bent them by: w^2 m d^2 / 2 each."""
    ball = {"kind": "sphere", "center": [0.0, -0.16, 0.0], "radius": 0.15}
    scene = meeting(sphere=ball, box={"kind": "box", "center": [0.0, 1e5, 0.0]}, body=SOFT)
    away = np.linalg.norm(scene.crowd.position - ball["center"], axis=1)
    depths = np.maximum(0.15 - away, 0)
    given = 4000.0 / 2 * float((masses(scene)[:, 0] * depths**2).sum())
    assert 0 < depths.max() < 0.1
    with opened(scene, kernel="stages") as simulation:
        for _ in range(100):
            simulation.advance(1)
            state = simulation.state()
            away = np.linalg.norm(state.position - ball["center"], axis=1)
            assert away.min() > 0.15 * (1 - 8 * ULP["float64"])
            assert kinetic(scene, state.velocity) < given


# ---------------------------------------------------------------------- stacks


def stack(substeps: int, iterations: int = 1, bricks: int = 10, **contact: float) -> Scene:
    """Of 32 particles each, sixteen on sixteen."""
    brick = BRICK | {"origin": [0.0, 0.125, 0.0], "copies": [1, bricks, 1], "apart": [1.0, 0.25, 1.0]}
    return meeting(
        GRAVITY, substeps, iterations, brick=brick, plane=FLOOR | {"thickness": RIGID_SPACING / 2}, contact=contact
    )


def sunk(scene: Scene, position: np.ndarray) -> np.ndarray:
    """(bricks,): how much nearer the centre of each has come to what is below it, over g h^2."""
    h = scene.method.dt / scene.method.substeps
    fallen = [centre(scene, scene.crowd.position - position, body)[1] for body in range(len(scene.crowd.copies))]
    return np.diff([0.0, *fallen]) / (GRAVITY * h * h)


@pytest.mark.parametrize("substeps,sweeps", [(4, 1), (4, 3), (8, 1)])
def test_ten_bricks_stand_as_deep_as_the_weight_above_says(substeps: int, sweeps: int) -> None:
    """10 s. A projection of a contact of depth d moves two particles by d / 2 each, so that C of them give C m d / 2 of mass
    times way, and in a substep k bricks of n particles need k n m g h^2: d = 2 k (n / C) g h^2 = 4 k g h^2. The plane moves
    but the lower particles, 2 N g h^2, and the brick's mean lies higher by g h^2 and half of it: (2 N - 1) g h^2. Sweeps add
    nothing where each particle has one contact. The top comes down by 199 g h^2, 5 % of a brick with 4 substeps, 1.2 % with
    8, and nothing leans."""
    scene = stack(substeps, sweeps=sweeps)
    state = end_state(scene, steps=1000)
    expected = [2 * 10 - 1, *(4 * above for above in range(9, 0, -1))]
    assert sunk(scene, state.position) == pytest.approx(np.array(expected), abs=0.02)
    top = centre(scene, scene.crowd.position - state.position, 9)[1]
    assert top < 0.05 * 0.25 * (4 / substeps) ** 2
    assert np.abs(state.position - scene.crowd.position)[:, [0, 2]].max() < 1e-10
    assert kinetic(scene, state.velocity) < 1e-6


def test_iterations_make_a_stack_stiffer() -> None:
    """n of them share the weight: at the top each interface gives 4 k g h^2 / n; all together less than half with two, and
    less than a third with four."""
    scenes = [stack(4, iterations) for iterations in (1, 2, 4)]
    found = [sunk(scene, end_state(scene, steps=1000).position) for scene in scenes]
    for iterations, depths in zip((1, 2, 4), found, strict=True):
        assert depths[:-5:-1] == pytest.approx(np.array([4, 8, 12, 16]) / iterations, abs=0.02)
    total = [depths.sum() for depths in found]
    assert total[1] < total[0] * 0.6 and total[2] < total[0] / 3


def test_a_stack_sleeps_in_float32() -> None:
    """Friction takes back how a body slid in a substep, and forgets: rounding, always the same way, moves a stack that is
    awake by 2 mm in 10 s. Asleep it has no speed at all, and stays."""
    scene = stack(4, sleeping_speed=0.005)
    with opened(scene, precision="float32") as simulation:
        simulation.advance(600)
        early = simulation.state()
        simulation.advance(400)
        late = simulation.state()
    assert not early.velocity.any() and np.array_equal(early.position, late.position)
    assert np.abs(late.position - scene.crowd.position)[:, [0, 2]].max() < 0.001
    assert centre(scene, scene.crowd.position - late.position, 9)[1] < 0.06 * 0.25


def test_the_catalogues_stack_stands_for_ten_seconds() -> None:
    """Five layers of two, across each other: eight contacts of 32 particles to an interface and 2 iterations, 4 k g h^2 each
    as above; under 10 + 40 of them in all, 1 % of a beam, and no lean."""
    scene = load_scene("rigid-stack")
    with opened(scene, precision="float32", live=()) as simulation:
        simulation.advance(600)
        state = simulation.state()
    moved = state.position - scene.crowd.position
    assert -moved[:, 1].min() < 50 * GRAVITY / 480**2 < 0.01 * 0.25
    assert np.abs(moved[:, [0, 2]]).max() < 1e-4 and not state.velocity.any()


# ---------------------------------------------------------------------- rest, and B18: heaps


def heap(copies: int, substeps: int, **contact: float) -> Scene:
    body = SOFT | TILTED | {"origin": [0.0, 0.75, 0.0], "copies": [1, copies, 1], "apart": [1.0, 0.45, 1.0]}
    return meeting(GRAVITY, substeps, soft=body, plane=FLOOR | {"thickness": SPACING / 2}, contact=contact)


@BOTH
@pytest.mark.parametrize("copies,substeps", [(1, 1), (1, 4), (4, 2)])
def test_what_was_dropped_comes_to_rest(copies: int, substeps: int, precision: str) -> None:
    """From half a metre, alone and on each other: a millionth of that energy is left after 10 s."""
    scene = heap(copies, substeps)
    state = end_state(scene, steps=1000, precision=precision)
    assert kinetic(scene, state.velocity) < 1e-6 * masses(scene).sum() * GRAVITY * 0.5
    assert state.position[:, 1].min() > SPACING / 2 - 4 * ULP[precision]


@BOTH
def test_a_heap_of_eight_does_not_sink_into_itself(precision: str) -> None:
    """NUMERICS B18. (With two substeps a corner may be caught between the particles of another body: 0.65 of the distance.)"""
    scene, peak = heap(8, 4), 0.0
    with opened(scene, precision=precision) as simulation:
        for _ in range(100):
            simulation.advance(10)
            state = simulation.state()
            energy = kinetic(scene, state.velocity)
            peak = max(peak, energy)
        assert simulation.contacts_lost == 0
    assert energy < 1e-3 * peak
    assert nearest(scene, state.position) > 0.8 * SPACING and state.position[:, 1].min() > SPACING / 2 - 1e-6
    assert out_of_shape(scene, state.position) < SPACING


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
