"""Tetrahedral bodies that meet, on the CPU: the NumPy reference, laws of conservation and friction, what begins inside."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import pytest
from surface_scenes import FLOOR, METHOD, SIDE, box, crumpled, meeting, three

from softlab.app.driver import open_simulation
from softlab.bench.reference.contact import surface_contacts as reference
from softlab.cpu_backend.contact.surfaces import SurfaceContacts
from softlab.model.base.errors import SceneError
from softlab.model.contact.self_contact_parameters import MAX_CONTACTS
from softlab.model.contact.surface_parameters import contact_distance, contact_surface
from softlab.model.core.build import build
from softlab.model.formulas.contact import FACE
from softlab.model.scene.scene import Scene

EPS = float(np.finfo(np.float64).eps)


def contacts_of(scene: Scene, before: np.ndarray, predicted: np.ndarray) -> tuple[SurfaceContacts, np.ndarray]:
    """The contacts between two states, and the positions after all sweeps, in exact math, float64."""
    weights = build(scene).inverse_mass * scene.grid.mass
    numba.set_num_threads(1)
    contacts = SurfaceContacts(scene, np.float64, "exact", 1, weights)
    position = predicted.copy()
    contacts.find(before, position)
    contacts.project(before, position)
    return contacts, position


# ---------------------------------------------------------------------- what is found


@pytest.mark.parametrize("seed", range(4))
def test_contacts_are_the_references(seed: int) -> None:
    """Brute force over all pairs finds the same vertices, triangles and ways out, and the sweeps take them as far: one,
    or three, which share Coulomb's cone."""
    sweeps = 1 + 2 * (seed % 2)
    scene = three(sweeps=sweeps).replace({"third.self_collision": False})
    before, predicted = crumpled(scene, seed)
    contacts, position = contacts_of(scene, before, predicted)
    expected = reference.find(scene, 0.02, before, predicted)
    vertices, counts = np.unique(expected.mass, return_counts=True)
    assert len(vertices) > 10 and counts.max() <= MAX_CONTACTS
    assert np.array_equal(np.flatnonzero(contacts.contact_counts), vertices)
    assert np.array_equal(contacts.contact_counts[vertices], counts)
    held = (np.arange(MAX_CONTACTS) < contacts.contact_counts[:, None]).ravel()
    assert np.array_equal(contacts.triangles[held], expected.triangle)
    assert np.array_equal(contacts.corners[held], expected.corners)
    values = contacts.values[held]
    np.testing.assert_allclose(values[:, :2], expected.weights[:, 1:], atol=1e-12)
    np.testing.assert_allclose(values[:, 2:5], expected.normal, atol=1e-12)
    np.testing.assert_allclose(values[:, 5], expected.required, atol=1e-15)
    weights = build(scene).inverse_mass * scene.grid.mass
    assert scene.contact is not None
    after = reference.project(scene.contact, expected, before, predicted, weights)
    assert np.abs(after - predicted).max() > 1e-4
    np.testing.assert_allclose(position, after, atol=1e-14)


def test_every_feature_has_one_owner() -> None:
    """Each corner and each side of a closed surface is answered for once, each triangle answers for its face."""
    surface = contact_surface(three().tetrahedra_set)
    sides = len(surface.triangles) * 3 // 2
    bits = sum(int((surface.owned >> feature & 1).sum()) for feature in range(7))
    assert (surface.owned >> FACE & 1).all()
    assert bits == len(surface.triangles) + sides + len(surface.vertices)


def test_a_face_stops_a_vertex_at_its_middle() -> None:
    """A small box above the middle of a face of one voxel's side: no vertex of either is near another, and it is held."""
    scene = meeting(
        below=box((0.4, 0.4, 0.4), 0.4, pinned=["bottom", "top"]),
        above=box((0.05, 0.05, 0.05), 0.05, origin=[0.06, 0.24, 0.02]),
        contact={"distance": 0.01},
        gravity={},
    )
    top = scene.tetrahedra_set.position[: scene.tetrahedra_set.first_particle[1], 1].max()
    with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1) as simulation:
        simulation.advance(60)
        lowest = simulation.read("position")[scene.tetrahedra_set.first_particle[1] :, 1].min()
    assert 0.009 < lowest - top < 0.011


# ---------------------------------------------------------------------- laws


def head_on() -> Scene:
    """Two cubes at 1 m/s each, not quite in line; without friction and gravity."""
    return meeting(
        left=box(origin=[-0.2, 0.0, 0.0], velocity=[1.0, 0.0, 0.0]),
        right=box(origin=[0.2, 0.04, 0.02], velocity=[-1.0, 0.0, 0.0]),
        contact={"static_friction": 0.3, "dynamic_friction": 0.2},
    )


def test_cubes_that_collide_keep_their_momentum_and_part() -> None:
    """Every push is split by masses. A substep rounds each particle's position a few times, `visits` of its constraints and
    contacts, and divides by h: a random walk of eps * extent / h * mass would do, the bound is the sum. They never come
    nearer than a tenth of the distance that they keep, and part with no more energy than they brought."""
    scene = head_on()
    found, h, steps = scene.tetrahedra_set, METHOD["dt"] / METHOD["substeps"], 40
    mass, many = found.masses[:, None], int(found.first_particle[1])
    distance = contact_distance(scene)
    with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1) as simulation:
        start = (mass * simulation.state().velocity).sum(axis=0)
        nearest, touched = np.inf, 0
        for _ in range(steps):
            simulation.advance(1)
            position = simulation.read("position")
            nearest = min(nearest, float(position[many:, 0].min() - position[:many, 0].max()))
            touched += int(simulation.contacts.contact_counts.sum())  # type: ignore[attr-defined]
        velocity = simulation.state().velocity
    visits = 30
    bound = visits * EPS * found.extent / h * float(mass.sum()) * steps * METHOD["substeps"] ** 0.5
    assert np.abs((mass * velocity).sum(axis=0) - start).max() < bound
    assert touched > 50 and nearest > 0.1 * distance
    means = [(mass * velocity)[part].sum(axis=0) / mass[part].sum() for part in (slice(many), slice(many, None))]
    assert means[0][0] < -0.1 and means[1][0] > 0.1
    assert 0.5 * (mass * velocity**2).sum() < 0.5 * mass.sum()


def test_a_cube_on_a_cube_comes_to_rest() -> None:
    """After three seconds the lower one stands on the floor and the upper on it: nothing moves faster than gravity makes it
    in two substeps."""
    stiff = {"young_modulus": 1e6, "damping": 0.02}
    below, above = box(origin=[0.0, 0.152, 0.0], **stiff), box(origin=[0.03, 0.49, 0.02], angle=20.0, **stiff)
    scene = meeting(below=below, above=above, floor=FLOOR, gravity={})
    many = int(scene.tetrahedra_set.first_particle[1])
    with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1) as simulation:
        simulation.advance(180)
        state = simulation.state()
    h, speed = METHOD["dt"] / METHOD["substeps"], np.linalg.norm(state.velocity, axis=1).max()
    assert speed < 2 * 9.81 * h, speed
    gap = state.position[many:, 1].min() - state.position[:many, 1].max()
    assert 0.5 * contact_distance(scene) < gap < 1.1 * contact_distance(scene)


def sliding(angle: float, friction: float, sweeps: int, *steps: int) -> np.ndarray:
    """A cube on a body that is held, inclined by an angle [degrees]: (mean place down the slope [m], mean speed [m/s]) after
    each number of steps, of 1/60 s."""
    a = np.radians(angle)
    held = {"pinned": ["left", "right", "top", "bottom"], "angle": -angle, "axis": [0.0, 0.0, 1.0]}
    slope, up = box((0.8, 0.1, 0.3), **held), 0.05 + SIDE / 2 + 0.0255
    cube = box(origin=[up * np.sin(a), up * np.cos(a), 0.0], angle=-angle, axis=[0.0, 0.0, 1.0], young_modulus=1e6)
    contact = {"static_friction": friction, "dynamic_friction": friction, "distance": 0.025, "sweeps": sweeps}
    scene = meeting(slope=slope, cube=cube, contact=contact, gravity={})
    first, down = scene.tetrahedra_set.first_particle[1], np.array([np.cos(a), -np.sin(a), 0.0])
    states = []
    with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1) as simulation:
        for count in np.diff((0, *steps)).tolist():
            simulation.advance(count)
            state = simulation.state()
            states.append([float((values[first:] @ down).mean()) for values in (state.position, state.velocity)])
    return np.array(states)


def test_a_cube_slides_where_the_slope_is_over_the_friction_and_sticks_below() -> None:
    """tan 20 degrees = 0.364. Over it the acceleration is g (sin a - mu cos a); below, it comes to rest and stays: a sweep
    leaves some of a substep's slip over, which creeps."""
    (_, slow), (_, fast) = sliding(20.0, 0.2, 1, 12, 24)
    expected = 9.81 * (np.sin(np.radians(20)) - 0.2 * np.cos(np.radians(20)))
    assert abs((fast - slow) / 0.2 / expected - 1) < 0.1
    ((_, fast),) = sliding(20.0, 0.6, 1, 24)
    assert abs(fast) < 0.005


@pytest.mark.parametrize("ratio", [0.9, 1.1])
def test_four_sweeps_tell_sticking_from_sliding_at_a_tenth_of_coulombs_limit(ratio: float) -> None:
    """On a slope of tan a = 0.9 mu the cube creeps by less than 0.1 mm/s (before friction was summed over sweeps, 6 mm/s);
    at 1.1 mu its path has the curvature g (sin a - mu cos a), after the first contact, which shears it."""
    a = np.radians(20.0)
    friction = float(np.tan(a)) / ratio
    early, middle, late = sliding(20.0, friction, 4, 30, 45, 60)[:, 0]
    if ratio < 1:
        assert abs(late - early) / 0.5 < 1e-4
    else:
        expected = 9.81 * (np.sin(a) - friction * np.cos(a))
        assert abs((late - 2 * middle + early) / 0.25**2 / expected - 1) < 0.02


def test_what_begins_inside_is_led_out_slowly() -> None:
    """A cube that begins a fifth of a voxel inside a larger one leaves it the short way, and the two part no faster than
    twice the separation speed."""
    scene = meeting(
        left=box((0.4, 0.4, 0.4), origin=[-0.2, 0.0, 0.0]),
        right=box((0.2, 0.2, 0.2), origin=[0.08, 0.01, 0.02]),
        contact={"separation_speed": 0.5, "static_friction": 0.0, "dynamic_friction": 0.0},
    )
    many, fastest = int(scene.tetrahedra_set.first_particle[1]), 0.0
    with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1) as simulation:
        for _ in range(30):
            simulation.advance(1)
            velocity = simulation.state().velocity
            apart = velocity[many:].mean(axis=0) - velocity[:many].mean(axis=0)
            fastest = max(fastest, float(np.linalg.norm(apart)))
        position = simulation.read("position")
    assert fastest < 2 * 0.5
    assert position[many:, 0].min() - position[:many, 0].max() > 0


def test_a_body_meets_itself_where_it_says_so() -> None:
    """The lower arm of a C bends up to the upper one, or through it."""

    def least(meets: bool) -> float:
        shape = {"name": "letters", "text": "S", "resolution": 16}
        body = {"kind": "tetrahedral_body", "shape": shape, "edge": 0.11, "young_modulus": 3e3, "self_collision": meets}
        scene = meeting(letter=body, contact={"distance": 0.02}, floor=FLOOR | {"point": [0.0, -0.55, 0.0]}, gravity={})
        start = scene.tetrahedra_set.position
        low = np.flatnonzero(start[:, 1] < -0.15)
        high = np.flatnonzero(start[:, 1] > 0.15)
        with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1) as simulation:
            simulation.advance(30)
            now = simulation.read("position")
        return float(np.linalg.norm(now[low][:, None] - now[high][None], axis=2).min())

    assert least(True) > least(False)


# ---------------------------------------------------------------------- bits


def test_bodies_that_are_far_apart_move_as_without_contacts() -> None:
    far = {
        "left": box(origin=[-1.0, 0.5, 0.0], spin=[1.0, 2.0, 0.0]),
        "right": box(origin=[1.0, 0.5, 0.0]),
        "gravity": {},
    }
    states = []
    for scene in (meeting(**far), Scene(far | {"method": METHOD}, "apart")):
        with open_simulation(scene, "cpu", math="exact", threads=1) as simulation:
            simulation.advance(4)
            states.append(simulation.state())
    assert np.array_equal(states[0].position, states[1].position)


def test_a_step_that_changes_while_it_runs_changes_the_push() -> None:
    """`separation_speed` times a substep."""
    with open_simulation(three(), "cpu", live=("dt",), math="exact", threads=1) as simulation:
        simulation.advance(1)
        contacts: SurfaceContacts = simulation.contacts  # type: ignore[attr-defined]
        before = float(contacts.record[0]["push"])
        simulation.set("method.dt", simulation.scene.method.dt / 2)
        simulation.advance(1)
        assert float(contacts.record[0]["push"]) == pytest.approx(before / 2, rel=1e-6)


# ---------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"method": {"solver": "newton"}}, "contact.kind"),
        ({"contact": {"restitution": 0.5}}, "contact.restitution"),
        ({"contact": {"sleeping_speed": 0.1}}, "contact.sleeping_speed"),
        ({"contact": {"maximum_speed": 3.0}}, "contact.maximum_speed"),
    ],
)
def test_what_surfaces_do_not_know_is_refused(changes: dict[str, Any], field: str) -> None:
    with pytest.raises(SceneError) as error:
        meeting(one=box(), **changes)
    assert error.value.field == field
