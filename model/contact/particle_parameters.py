"""Constants for the kernels of contacts between particles, and the features of contacts that need code."""

from __future__ import annotations

import numpy as np

from softlab.model.assets.clusters import whole_clusters
from softlab.model.base.types import Real
from softlab.model.core.parameters import rounded_record
from softlab.model.scene.scene import Scene

MAX_NEIGHBOURS = 32  # of one particle; those beyond are counted as lost
MARGIN = 0.2  # of the distance: additional search distance, as iterations may bring particles nearer
FARTHEST = 2**30  # cells from the origin, along an axis: particles beyond have no contacts
REST = 1.25  # distances: particles of a body nearer than that at rest are neighbours and do not collide

PARTICLE_CONTACT_PARAMETERS = (
    "inverse_cell",  # 1/m, of the cells of space
    "push",  # m: how far an overlap is reduced within a substep
    "static_friction",
    "dynamic_friction",
    "fastest",  # m: largest displacement of a particle in a substep
    "asleep",  # m: particles with a smaller displacement in a substep stay in place
    "restitution",
    "settling",  # m/s: slower impacts do not bounce
    "inverse_substep",  # 1/s
)
(
    H_INVERSE_CELL, H_PUSH, H_STATIC, H_DYNAMIC, H_FASTEST, H_ASLEEP, H_RESTITUTION, H_SETTLING,
    H_INVERSE_SUBSTEP,
) = range(len(PARTICLE_CONTACT_PARAMETERS))  # fmt: skip
# Then a row for each pair of kinds of bodies, kind i with kind j at i * kinds + j:
PAIRS = len(PARTICLE_CONTACT_PARAMETERS)  # index of the first row
PAIR_FIELDS = 6
(
    G_DISTANCE,  # m, between two bodies; 0: no contact
    G_SELF_DISTANCE,  # m, within one body; 0: no contact
    G_SEARCH_RADIUS,  # m: search distance of neighbours
    G_ACTIVE,  # m: contact distance, or with adhesion the largest distance at which it pulls
    G_PULL,  # m: displacement of both by adhesion in one projection, a fraction of that of a substep
    G_NEIGHBOURS,  # m: pairs nearer than that at rest are neighbours
) = range(PAIR_FIELDS)


def pair_rows(scene: Scene) -> np.ndarray:
    """Return the rows of all pairs of the scene's bodies, (kinds, kinds, PAIR_FIELDS) float64, symmetric."""
    part, bodies = scene.contact, list(scene.bodies.values())
    assert part is not None
    h = scene.method.dt / scene.method.substeps
    projections = scene.method.iterations * part.sweeps  # per substep
    rows = np.zeros((len(bodies), len(bodies), PAIR_FIELDS))
    for i, one in enumerate(bodies):
        for j, other in enumerate(bodies):
            distance = one.contact_radius + other.contact_radius
            collide = one.group not in other.avoids and other.group not in one.avoids
            adhesion = max(one.adhesion, other.adhesion)
            active = distance * (1 + part.adhesion_reach * (adhesion > 0))
            rows[i, j] = (
                distance * collide, distance * (i == j and one.self_colliding), active * (1 + MARGIN), active,
                adhesion * h * h / projections, REST * distance,
            )  # fmt: skip
    return rows


def particle_contact_record(scene: Scene, real: Real) -> np.ndarray:
    """Return the constants, (PAIRS + kinds^2 * PAIR_FIELDS,), in the arithmetic `real`: computed in float64, rounded
    once.

    Raises SceneError.
    """
    part, rows = scene.contact, pair_rows(scene)
    assert part is not None
    h = scene.method.dt / scene.method.substeps
    values = {
        "inverse_cell": 1 / float(rows[:, :, G_SEARCH_RADIUS].max()),
        "push": part.separation_speed * h,
        "static_friction": part.static_friction,
        "dynamic_friction": part.dynamic_friction,
        "fastest": (part.maximum_speed or 0.0) * h,
        "asleep": part.sleeping_speed * h,
        "restitution": part.restitution,
        "settling": 2 * scene.gravity.acceleration * h if scene.gravity and scene.gravity.enabled else 0.0,
        "inverse_substep": 1 / h,
    }
    assert tuple(values) == PARTICLE_CONTACT_PARAMETERS, (
        f"{set(values) ^ set(PARTICLE_CONTACT_PARAMETERS)} or their order differ"
    )
    fields = {
        "push": "contact.separation_speed",
        "fastest": "contact.maximum_speed",
        "asleep": "contact.sleeping_speed",
        "restitution": "contact.restitution",
        "settling": "gravity.acceleration",
        "inverse_substep": "method.dt",
    }
    head: np.ndarray = np.array(rounded_record(scene, values, fields, real)[0].tolist(), real)
    return np.concatenate([head, rows.reshape(-1).astype(real)])


def kinds_of_particles(scene: Scene) -> np.ndarray:
    """Return the index of each particle's body in the scene, the same for all copies, (particles,) int32.

    `body_set.body` distinguishes copies.
    """
    names = list(scene.bodies)
    kind = np.array([names.index(copy.name) for copy in scene.body_set.copies], np.int32)
    return kind[scene.body_set.body]


def contact_parts(scene: Scene) -> frozenset[str]:
    """Return the features of contacts that need code: `contacts`; `contact-friction`, `contact-adhesion`;
    `speed-limit`; `sleeping`; `contact-restitution`."""
    part = scene.contact
    if part is None:
        return frozenset()
    features = {"contacts"}
    if part.static_friction > 0:
        features.add("contact-friction")
    if any(body.adhesion > 0 for body in scene.bodies.values()):
        features.add("contact-adhesion")
    if part.maximum_speed is not None:
        features.add("speed-limit")
    if part.sleeping_speed > 0:
        features.add("sleeping")
    if part.restitution > 0:
        features.add("contact-restitution")
    return frozenset(features)


def rigid_parts(scene: Scene) -> frozenset[str]:
    """Return the features of rigid bodies that need code.

    `rigid-motion`: conserves their momenta (model/formulas/shape_matching/rigid.py); `rigid-rebound`: from colliders;
    `rigid-bounce` and `contact-restitution`: from each other. They are needed without restitution, too: where only
    single particles are stopped, their goals undo it.
    """
    if not whole_clusters(scene.body_set.alike.loose).any():
        return frozenset()
    features = {"rigid-motion"}
    if scene.colliders:
        features.add("rigid-rebound")
    if scene.contact is not None:
        features |= {"rigid-bounce", "contact-restitution"}
    return frozenset(features)
