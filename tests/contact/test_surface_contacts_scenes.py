"""Scenes of tetrahedral bodies that meet: a heap that comes to rest, a creature whose voxels are doubled."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from softlab.app.driver import open_simulation
from softlab.cpu_backend.contact.self_find import V_INSIDE
from softlab.model.contact.self_contact_parameters import MAX_CONTACTS
from softlab.model.contact.shortfalls import shortfalls
from softlab.model.contact.surface_parameters import contact_distance, contact_surface
from softlab.model.scene.scene import Scene, load_scene

# Of fem-drop's twenty bodies those along its middle, three layers high, of every material.
MIDDLE = {"star", "ball", "beam", "letter-o", "tile", "short-pipe", "column"}


def test_a_heap_comes_to_rest_and_stays() -> None:
    """Six seconds and one more: half of its particles go slower than 1 mm/s (measured: 0.4 mm/s, the mean square 2 mm/s),
    and no body goes as far as a centimetre; nothing was left out of the contacts, and nothing is inside another body. No
    tetrahedron ends inside out, no vertex caught."""
    tables = load_scene("fem-drop").as_dict()
    others = {name for name, table in tables.items() if isinstance(table, dict) and "young_modulus" in table} - MIDDLE
    scene = Scene({name: table for name, table in tables.items() if name not in others})
    assert scene.tetrahedra.keys() == MIDDLE
    with open_simulation(scene, "cpu", math="exact") as simulation:  # the same heap on every machine
        simulation.advance(360)
        before = simulation.read("position").astype(np.float64)
        simulation.advance(60)
        state, contacts = simulation.state(), simulation.contacts  # type: ignore[attr-defined]
        faults = shortfalls(simulation, state.position, state.inverse_mass)
    assert faults == {"contacts_lost": 0, "inverted": 0, "caught": 0}
    found, speed = scene.tetrahedra_set, np.linalg.norm(state.velocity, axis=1)
    assert np.median(speed) < 0.001 and np.sqrt((speed**2).mean()) < 0.02
    ends = np.append(found.first_particle, found.particle_count)
    shift = state.position - before
    moved = sorted(float(np.linalg.norm(shift[first:last].mean(axis=0))) for first, last in pairwise(ends))
    assert moved[-1] < 0.01, moved
    assert contacts.neighbours_lost == 0 and contacts.lost < 10
    held = (np.arange(MAX_CONTACTS) < contacts.contact_counts[:, None]).ravel()
    values = contacts.values[held]
    assert len(values) > 15 and not (values[:, V_INSIDE] > 0).any()


def test_the_catalogues_heap_has_a_few_dozen_contacts_at_most_where_it_begins() -> None:
    """Voxels reach farther than what is drawn: they may touch, and are moved apart, but do not lie in each other."""
    scene = load_scene("fem-drop")
    assert len(scene.tetrahedra) == 20
    with open_simulation(scene, "cpu", math="exact") as simulation:  # kernels that the heap above has compiled
        simulation.advance(1)
        contacts = simulation.contacts  # type: ignore[attr-defined]
        assert contacts.contact_counts.sum() < 50
        assert np.linalg.norm(simulation.state().velocity, axis=1).max() < 2.0


def test_the_creature_comes_down_the_stairs() -> None:
    """Its fingers and toes share voxels, which are doubled. It never meets itself where it is one piece, and comes to lie on
    the floor."""
    scene: Scene = load_scene("fem-creature")
    (body,) = scene.tetrahedra.values()
    assert body.cooked.report.doubled > 4
    low, edge = float(contact_surface(scene.tetrahedra_set).rest[:, 1].min()), contact_distance(scene)
    with open_simulation(scene, "cpu") as simulation:
        simulation.advance(1)
        assert simulation.contacts.contact_counts.sum() == 0  # type: ignore[attr-defined]
        simulation.advance(179)
        position, contacts = simulation.read("position"), simulation.contacts  # type: ignore[attr-defined]
        assert contacts.neighbours_lost == 0
    assert position[:, 1].min() < low / 2 and position[:, 1].min() > -edge
    assert np.median(position[:, 2]) > 0.3
