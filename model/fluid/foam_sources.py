"""Sources of foam: how many points of spray, foam and bubbles each of a fluid's particles makes per second.

M. Ihmsen, N. Akinci, G. Akinci, M. Teschner, "Unified spray, foam and bubbles for particle-based fluids", The Visual
Computer 28 (2012), section 3.1: trapped air (equations 2 and 3), wave crests (4 to 7) and kinetic energy (8), each
clamped (1). Their bounds, which are numbers for one resolution there, are relative here to a full neighbourhood and to
the scene's own speed, so that neither the resolution nor the size of a scene changes the foam.
"""

from __future__ import annotations

from math import pi

import numpy as np

from softlab.model.fluid.measure import differences
from softlab.model.scene.scene import Scene
from softlab.model.tables.fluid import Foam

GRAVITY = 9.81  # m/s^2, for the speed scale of a scene without gravity
TRAPPED = 0.10, 0.40  # of the scene's speed: approach speeds of neighbours that trap air
CREST = 0.05, 0.20  # 1 - the cosine between the normals of neighbours, on average; a block's edge has about 0.1
FAST = 0.30, 1.0  # of the scene's speed; their squares represent kinetic energies
SURFACE = (
    0.12  # of a full neighbourhood: where weights are this uneven there is a surface; a flat one has over a quarter
)
AHEAD = 0.6  # smallest cosine between velocity and normal at which a crest moves outward (equation 7)
WEIGHT = {2: 1 / 3, 3: 1 / 4}  # mean of 1 - r/h over a disc and a ball


def clamped(value: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return equation 1: 0 up to `low`, 1 from `high` on."""
    return np.clip((value - low) / (high - low), 0, 1)


def full_count(scene: Scene) -> float:
    """Return the number of particles within a support inside the fluid."""
    axes, across = scene.dimensions, scene.fluid_set.support / scene.fluid_set.spacing
    return {2: pi, 3: 4 * pi / 3}[axes] * across**axes


def foaming_speed(scene: Scene, foam: Foam) -> float:
    """Return the speed scale [m/s]: the stated one, or that of a wave as deep as the fluids' initial extent."""
    gravity = scene.gravity.acceleration if scene.gravity and scene.gravity.enabled else GRAVITY
    return foam.speed or float(np.sqrt((gravity or GRAVITY) * scene.fluid_set.extent))


def sources(scene: Scene, foam: Foam, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return the source of each particle, 0 to 1, (particles,), from positions (particles, dimensions) [m] and
    velocities [m/s].

    The clamped potential of the energy times the mean of the other two (equation 9).
    """
    speed = foaming_speed(scene, foam)
    energy = clamped((velocity**2).sum(axis=1), (FAST[0] * speed) ** 2, (FAST[1] * speed) ** 2)
    if not energy.any():
        return energy
    (first, second), apart = (pairs := differences(scene, position))[0].T, pairs[1]
    r = np.maximum(np.sqrt((apart**2).sum(axis=1)), 1e-12)
    weight, along = 1 - r / scene.fluid_set.support, apart / r[:, None]
    relative, count = velocity[first] - velocity[second], len(position)
    meeting = (np.sqrt((relative**2).sum(axis=1)) - (relative * along).sum(axis=1)) * weight
    full = full_count(scene) * WEIGHT[scene.dimensions]
    trapped = (np.bincount(first, meeting, count) + np.bincount(second, meeting, count)) / full
    crest = _crests(velocity, first, second, along, weight, full)
    return energy * (clamped(trapped, TRAPPED[0] * speed, TRAPPED[1] * speed) + clamped(crest, *CREST)) / 2


def _crests(
    velocity: np.ndarray, first: np.ndarray, second: np.ndarray, along: np.ndarray, weight: np.ndarray, full: float
) -> np.ndarray:
    """Return equations 4 to 7 over a full neighbourhood, (particles,); 0 for interior particles, which have no
    normal."""
    count, axes = velocity.shape
    pulls = [weight * along[:, k] for k in range(axes)]
    normal = np.stack([np.bincount(first, pull, count) - np.bincount(second, pull, count) for pull in pulls], axis=1)
    length = np.sqrt((normal**2).sum(axis=1))
    outside = length > SURFACE * full
    normal = np.where(outside[:, None], normal / np.maximum(length, 1e-12)[:, None], 0)
    bent = (1 - (normal[first] * normal[second]).sum(axis=1)) * weight * outside[first] * outside[second]
    below_first = (along * normal[first]).sum(axis=1) > 0  # the second lies below the first one's tangent plane
    below_second = (along * normal[second]).sum(axis=1) < 0
    crest = np.bincount(first, bent * below_first, count) + np.bincount(second, bent * below_second, count)
    going = (velocity * normal).sum(axis=1) >= AHEAD * np.sqrt((velocity**2).sum(axis=1))
    return np.asarray(np.where(going, crest / full, 0))
