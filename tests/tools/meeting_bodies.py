"""Small scenes of bodies that meet, and who the neighbours of particles are by the plain formulas, for the tests of contacts
on the GPU and in its simulator."""

from __future__ import annotations

from typing import Any

import numpy as np
from bodies_scenes import AWAY, SAMPLED, bodies_scene, method

from softlab.model.base.variant import plain_formulas
from softlab.model.contact.particle_parameters import (
    G_DISTANCE,
    G_NEIGHBOURS,
    G_SEARCH_RADIUS,
    G_SELF_DISTANCE,
    H_INVERSE_CELL,
    PAIR_FIELDS,
    PAIRS,
    kinds_of_particles,
    particle_contact_record,
)
from softlab.model.formulas import particle_contact
from softlab.model.scene.scene import Scene

SOFT = {"kind": "soft_body", "particle_spacing": 0.16, **SAMPLED}
BRICK = {"kind": "rigid_body", "particle_spacing": 0.2, **SAMPLED}
CALM = {"sleeping_speed": 0.001, "maximum_speed": 20.0, "sweeps": 2}


def meeting(substeps: int = 2, iterations: int = 2, copies: int = 1, **contact: Any) -> Scene:
    """A sticky soft bar on the ground and a rigid brick that falls on it; 24 particles and 5, times the copies."""
    columns: dict[str, Any] = {"copies": [copies, 1, copies], "apart": [1.1, 1.0, 0.3]}
    soft = SOFT | columns | {"origin": [0.0, 0.16, 0.0], "adhesion": 3.0}
    brick = BRICK | columns | {"origin": [0.02, 0.35, 0.03], "velocity": [0.0, -3.0, 0.4]}
    ground = AWAY | {"point": [0.0, 0.0, 0.0]}
    return bodies_scene(
        soft=soft, brick=brick, plane=ground, contact=CALM | contact, method=method(substeps, iterations)
    )


def smooth(substeps: int = 1, iterations: int = 1) -> Scene:
    """Rigid bricks of one kind without friction, one falling on the other."""
    brick = BRICK | {
        "origin": [0.0, 0.2, 0.0],
        "copies": [1, 2, 1],
        "apart": [0.03, 0.25, 0.02],
        "spin": [0.1, 0.3, 0.2],
    }
    ground, contact = AWAY | {"point": [0.0, 0.0, 0.0]}, {"static_friction": 0.0, "dynamic_friction": 0.0}
    return bodies_scene(brick=brick, plane=ground, contact=contact, method=method(substeps, iterations, 0.02))


def neighbours(scene: Scene, position: np.ndarray, weight: np.ndarray, real: type) -> list[list[int]]:
    """Of each particle whom it may meet, where they are at `position` (particles, 3), by asking all how far apart they are,
    whatever the cells; those found in the order of the cells along z, then y, then x, in each ascending."""
    formulas, record = plain_formulas(particle_contact, real), particle_contact_record(scene, real)
    body_set, kind, rows = scene.body_set, kinds_of_particles(scene), record[PAIRS:].reshape(-1, PAIR_FIELDS)
    rest, kinds = body_set.clusters.position.astype(real), len(scene.bodies)
    there = (weight > 0) & (abs(position) * record[H_INVERSE_CELL] <= 2**30).all(axis=1)
    cells = np.floor(formulas.scaled(np.where(there[:, None], position, 0), record[H_INVERSE_CELL])).astype(int)

    def meet(i: int, j: int) -> bool:
        row, same = rows[kind[i] * kinds + kind[j]], body_set.body[i] == body_set.body[j]
        near = formulas.within(formulas.squared(*(position[i] - position[j])), row[G_SEARCH_RADIUS])
        if same:
            apart = formulas.squared(*(rest[i] - rest[j]))
            return bool(near and row[G_SELF_DISTANCE] > 0 and not formulas.within(apart, row[G_NEIGHBOURS]))
        return bool(near and row[G_DISTANCE] > 0)

    found = []
    for i in range(len(position)):
        others = [j for j in np.nonzero(there & there[i])[0].tolist() if j != i and meet(i, j)]
        found.append(sorted(others, key=lambda j: (*(cells[j] - cells[i])[::-1], j)))
    return found
