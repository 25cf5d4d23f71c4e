"""Particles that bounce off each other (`[contact]`, restitution): velocities against the NumPy reference and among kernels
and threads, what a pair, a row and a swarm then do, and scenes without it.

All scenes with bodies of more than a particle have the same parts, and all without, so that kernels are compiled twice.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bodies_scenes import bodies_scene, end_state, lone_points, opened
from meeting_bodies import meeting

from softlab.bench.reference.contact import particle_contacts as judge
from softlab.cpu_backend.contact.particles import ParticleContacts
from softlab.model.base.errors import SceneError
from softlab.model.base.variant import plain_formulas
from softlab.model.contact.particle_parameters import H_RESTITUTION, H_SETTLING, particle_contact_record
from softlab.model.formulas import particle_contact as formulas
from softlab.model.scene.scene import Scene
from softlab.model.shape_matching.plan import body_parts, body_plan

STEPS = 8


def row(count: int, restitution: float, *speeds: float) -> Scene:
    """Points 0.1 m apart, the distance at which they touch, but for the first one, 0.15 m before them; `speeds` along the
    row, 0 of those that are not named."""
    places = [-0.15, *(0.1 * k for k in range(count - 1))]
    velocity = [[speed, 0.0, 0.0] for speed in (*speeds, *[0.0] * (count - len(speeds)))]
    return lone_points([[x, 0.0, 0.0] for x in places], velocity, restitution=restitution)


def swarm(count: int, restitution: float) -> Scene:
    """Points of a lattice, none touching another, that fly to its middle."""
    random = np.random.default_rng(1)
    places = np.stack(np.meshgrid(*[0.16 * np.arange(-3.0, 4.0)] * 3), axis=-1).reshape(-1, 3)
    at = random.permutation(places)[:count] + random.uniform(-0.02, 0.02, (count, 3))
    return lone_points(at, -3 * at + random.normal(0, 0.3, at.shape), restitution=restitution)


def kinetic(velocity: np.ndarray) -> float:
    return 0.5 * float((velocity**2).sum())


# ---------------------------------------------------------------------- against the reference


def test_velocities_are_the_references_and_keep_momenta() -> None:
    """Of a body set whose particles weigh differently, some nothing in the scene's unit, moving anyhow: within the
    roundings of up to 32 contacts of ten operations on 10 m/s. Every impulse lies on the line of its pair, so the angular
    momentum stays, too."""
    scene, random = meeting(restitution=0.6), np.random.default_rng(7)
    place = scene.body_set.position + random.normal(0, 0.03, scene.body_set.position.shape) - [0.0, 0.03, 0.0]
    old, velocity = random.normal(0, 3, place.shape), random.normal(0, 1, place.shape)
    checked = judge.Contacts(scene)
    checked.weight = random.uniform(0.1, 3.0, len(place))
    planes = [np.ascontiguousarray(array.T).reshape(-1) for array in (place, old, velocity)]
    for bands in (1, 3):
        parts, particles = body_parts(scene), len(place)
        contacts = ParticleContacts(scene, np.float64, "exact", parts, np.arange(particles), particles, bands)
        contacts.find(planes[0], checked.weight)
        contacts.old[:], found = planes[1], planes[2].copy()
        contacts.bounce(planes[0], found, checked.weight)
        checked.find(place)
        expected, now = (
            velocity + checked.velocity_changes(place, old, velocity, np.tile([1.0, 0.0, 0.0], (particles, 1))),
            found.reshape(3, -1).T,
        )
        assert (np.abs(expected - velocity).max(axis=1) > 0.5).sum() > 5 and contacts.lost == 0
        np.testing.assert_allclose(now, expected, rtol=0, atol=32 * 10 * 10 * 2.0**-53)
        change = (now - velocity) / checked.weight[:, None]
        assert np.abs(change.sum(axis=0)).max() < 1e-13 and np.abs(np.cross(place, change).sum(axis=0)).max() < 1e-13


def test_the_formula_is_the_papers() -> None:
    """Nothing for what parts, comes slowly, or parts fast enough."""
    lacking = plain_formulas(formulas, np.float64).lacking
    along = (0.6, 0.0, 0.8)
    for came, now, settling, lack in [
        (2.0, 0.0, 0.1, 1.0), (2.0, -0.25, 0.1, 1.25), (2.0, 0.25, 0.1, 0.75), (2.0, 1.5, 0.1, 0.0), (0.1, 0.0, 0.1, 0.0),
        (-1.0, -1.0, 0.0, 0.0),
    ]:  # fmt: skip
        before, after = tuple(-came * axis for axis in along), tuple(now * axis for axis in along)
        assert lacking(before, after, along, 0.5, settling) == pytest.approx(lack, abs=1e-15)


# ---------------------------------------------------------------------- laws


@pytest.mark.parametrize("restitution", [0.25, 0.5, 1.0])
def test_a_pair_parts_with_its_part_of_the_speed(restitution: float) -> None:
    """Head on at 3 m/s: the mean stays, the difference turns round. Velocities are differences of places of 0.5 m over h =
    0.01 s, of 30 substeps: 30 x 0.5 x 2^-52 / 0.01."""
    velocity = end_state(row(2, restitution, 2.0, -1.0), steps=30).velocity
    expected = 0.5 + 1.5 * restitution * np.array([-1.0, 1.0])
    assert velocity[:, 0] == pytest.approx(expected, abs=4e-13) and not velocity[:, 1:].any()


def test_a_row_hands_an_impulse_on() -> None:
    """Newton's cradle: of equal masses in touch the last one leaves with all."""
    velocity = end_state(row(3, 1.0, 1.0), steps=40).velocity[:, 0]
    assert velocity == pytest.approx([0.0, 0.0, 1.0], abs=4e-13)


def test_a_glancing_pair_keeps_its_spin_about_each_other() -> None:
    """Without friction an impulse lies along their line: angular momentum stays, but for places of 1 m that take part of a
    substep's way of a millimetre another way."""
    scene = lone_points(
        [[0.0, 0.0, 0.0], [0.3, 0.06, 0.0]], [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], restitution=0.9, static_friction=1e-30,
        dynamic_friction=0.0,
    )  # fmt: skip
    state = end_state(scene, steps=30)
    before = np.cross(scene.body_set.position, scene.body_set.velocity).sum(axis=0)
    assert np.abs(state.velocity.sum(axis=0)).max() < 1e-12 and abs(state.velocity[0, 1]) > 0.5
    assert np.cross(state.position, state.velocity).sum(axis=0) == pytest.approx(before, abs=0.01)


def test_a_swarm_gains_no_energy() -> None:
    """Nor momentum: of 60 points to the roundings of a pair, each. What is answered for split masses keeps less than e^2,
    yet more of the energy stays with restitution."""
    left = []
    for restitution in (1e-9, 1.0):
        scene, energy = swarm(60, restitution), []
        with opened(scene) as simulation:
            for _ in range(50):
                simulation.advance(1)
                energy.append(kinetic(simulation.state().velocity))
            end, lost = simulation.state().velocity, simulation.contacts_lost
        start = scene.body_set.velocity
        assert np.abs(end.sum(axis=0) - start.sum(axis=0)).max() < 60 * 4e-13 and lost == 0
        assert max(energy) <= kinetic(start) * (1 + 1e-12)
        left.append(energy[-1])
    assert left[1] > 2 * left[0]


def test_what_comes_slowly_does_not_bounce() -> None:
    """By the bits of next to no restitution, where gravity adds half as much in a substep; without it, it bounces."""
    scene = row(2, 0.5, 2.0, -1.0)
    assert particle_contact_record(scene, np.float64)[H_SETTLING] == 0.0
    heavy = bodies_scene(**{name: scene.as_dict()[name] for name in ("contact", "body", "method")}, gravity=150.0)
    record = particle_contact_record(heavy, np.float64)
    assert record[H_SETTLING] == pytest.approx(2 * 150.0 * 0.01) and record[H_RESTITUTION] == 0.5
    off = heavy.replace({"gravity.enabled": False})
    assert particle_contact_record(off, np.float64)[H_SETTLING] == 0.0


# ---------------------------------------------------------------------- scenes


def test_a_scene_without_it_is_as_before() -> None:
    """Its text, its parts and its stages: what was measured of it is kept, and no code is there, where all are soft. Rigid
    bodies would come back without it."""
    plain, bounces = meeting(), meeting(restitution=0.5)
    for none in (plain, meeting(restitution=0.0)):
        assert "restitution" not in none.as_dict()["contact"] and Scene(none.as_dict()).contact == plain.contact
        assert body_parts(none) == body_parts(bounces) >= {"contact-restitution", "rigid-bounce"}
        soft = Scene({name: table for name, table in none.as_dict().items() if name != "brick"})
        assert not {"contact-restitution", "rigid-bounce"} & body_parts(soft) and not body_plan(soft).has("bounce")
    assert Scene(bounces.as_dict()).contact == bounces.contact and body_plan(bounces).has("bounce")


@pytest.mark.parametrize("value", [-0.1, 1.1, float("nan"), True, "high"])
def test_bad_input(value: Any) -> None:
    with pytest.raises(SceneError) as caught:
        meeting(restitution=value)
    assert caught.value.field == "contact.restitution"
