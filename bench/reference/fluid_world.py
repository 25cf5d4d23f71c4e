"""Colliders, emitters and sinks of a fluid in slow, plain NumPy float64.

From the description in model/fluid/plan.py, without model/formulas. A path that enters a ball or a capsule ends at the
entry point. One that enters a box by a face ends in front of that face, moved along its normal, unless it ends inside
and nearer to that face than to any other, where pushing it out by the nearest face gives the same. A nozzle's layers
leave it a rest distance apart at its speed; of the inactive particles of its fluid the one with the lowest number
leaves first.
"""

from __future__ import annotations

from functools import partial
from math import ceil

import numpy as np

from softlab.bench.reference import cloth
from softlab.bench.reference.contact import distance_field, mesh_collider
from softlab.model.geometry.particle_row import PARKED
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import Box, Capsule, Collider, Sphere
from softlab.model.tables.colliders.distance_field import DistanceField
from softlab.model.tables.colliders.mesh_collider import MeshCollider

TOUCHING = 1e-3  # of half an edge, or of the squared radius: a mass this near is in contact, whatever its rounding
FLAT = 1 / 1024  # a smaller slope of a field has no direction


def distances(collider: Collider, p: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (distance (n,) [m], normal (n, 3)) of positions (n, 3) from a collider at `time` [s]; inf where unknown."""
    if not isinstance(collider, MeshCollider | DistanceField):
        distance, normal = cloth.distances(collider, p, time)
        return distance.reshape(-1), normal
    turn = collider.turn_at(time)
    places = (p - collider.origin - np.array(collider.velocity) * time) @ turn
    distance, normal = np.full(len(p), np.inf), np.zeros_like(p)
    for k, place in enumerate(places):
        if isinstance(collider, MeshCollider):
            offset = place - mesh_collider.nearest_point(collider.position[collider.triangles], place)
            length = float(np.linalg.norm(offset))
            if length > 0:
                distance[k], normal[k] = length, turn @ offset / length
        else:
            field = collider.field
            last = field.low + field.spacing * (np.array(field.distance.shape) - 1)
            inside = np.clip(place, field.low + field.spacing / 2, last - field.spacing / 2)
            value, slope = distance_field.sample(field, inside)
            steep = float(np.linalg.norm(slope))
            if steep > FLAT:
                distance[k], normal[k] = value + np.linalg.norm(place - inside), turn @ slope / steep
    return distance, normal


def joined(total: np.ndarray, contribution: np.ndarray) -> np.ndarray:
    """Return the contribution of walls to C: `total` of those so far plus `contribution` of one more, minus their overlap."""
    larger = np.maximum(total, contribution)
    return np.where(larger >= 1, larger, total + contribution - total * contribution)


def rate(contribution: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the derivative of `joined` with respect to `contribution`."""
    return np.where(np.maximum(contribution, other) >= 1, contribution >= other, 1 - other)


def collide(
    scene: Scene, before: np.ndarray, position: np.ndarray, velocity: np.ndarray, number: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return (position, velocity) (n, 3) after the colliders of substep `number`, which began at `before`.

    `method.dt` is the length of the substep. The colliders act one after another, at their places at the end of it.
    """
    dt = scene.method.dt
    gravity = scene.gravity.acceleration if scene.gravity and scene.gravity.enabled else 0.0
    slow, times = 2 * gravity * dt, (number * dt, (number + 1) * dt)
    for _, collider in scene.colliders:
        touched = partial(cloth.touched, collider, slow)
        if isinstance(collider, MeshCollider):
            position, velocity = mesh_collider.collide(collider, before, position, velocity, *times, touched)
            continue
        if isinstance(collider, DistanceField):
            position, velocity = distance_field.collide(collider, before, position, velocity, *times, touched)
            continue
        distance, normal = cloth.distances(collider, position, times[1])
        settled = position + np.maximum(collider.thickness - distance, 0) * normal
        touching = distance < collider.thickness
        if isinstance(collider, Sphere | Capsule | Box):
            caught, stopped, new_normal = _caught(collider, before, position, *times)
            settled, normal = np.where(caught, stopped, settled), np.where(caught, new_normal, normal)
            touching = touching | caught
        position = np.where(touching, settled, position)
        velocity = np.where(touching, touched(velocity, normal), velocity)
    return position, velocity


def _caught(
    collider: Sphere | Capsule | Box, before: np.ndarray, position: np.ndarray, begin: float, end: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (mask (n, 1) of stopped masses, stopping points (n, 3), normals (n, 3)) at a ball, a capsule or a box.

    The masses move from `before` (n, 3) at `begin` [s] to `position` at `end`.
    """
    drift = np.array(collider.velocity)
    start = np.array(collider.start if isinstance(collider, Capsule) else collider.center)
    caught, stopped, normal = np.zeros((len(position), 1), bool), position.copy(), np.zeros_like(position)
    for k in range(len(position)):
        a, b = before[k] - start - drift * begin, position[k] - start - drift * end
        if isinstance(collider, Box):
            half = np.array(collider.half_size)
            entered = _by_face(a, b, half)
            if entered is not None:
                axis, side = entered
                caught[k], normal[k, axis] = True, side
                stopped[k, axis] = (start + drift * end)[axis] + side * (half[axis] + collider.thickness)
            continue
        line = np.array(collider.end) - start if isinstance(collider, Capsule) else np.zeros(3)
        part = _into_capsule(a, b, line, collider.radius + collider.thickness)
        if part < 1:
            place, square = a + part * (b - a), line @ line
            away = place - (np.clip(place @ line / square, 0, 1) * line if square else 0)
            caught[k], stopped[k], normal[k] = True, start + drift * end + place, away / np.linalg.norm(away)
    return caught, stopped, normal


def _into_capsule(a: np.ndarray, b: np.ndarray, line: np.ndarray, radius: float) -> float:
    """Return the fraction of the path from a to b (3,) at which it enters a capsule; inf if it does not.

    The capsule has this `radius` around the segment from the origin to `line`. Also inf where the path ends so
    that pushing the mass out is right.
    """
    square = float(line @ line)
    if square:
        u, w = a @ line / square, b @ line / square
        part = _into_ball(a - u * line, b - w * line, radius)
        if part < 1 and 0 <= u + part * (w - u) <= 1:
            return part
    return min(_into_ball(a, b, radius), _into_ball(a - line, b - line, radius))


def _into_ball(a: np.ndarray, b: np.ndarray, radius: float) -> float:
    """Return the same fraction for a ball of this `radius` around the origin."""
    path, rest = b - a, float(a @ a) - radius**2
    slope = float(a @ path)
    root = slope**2 - float(path @ path) * rest
    if rest < -TOUCHING * radius**2 or slope >= 0 or root <= 0:
        return np.inf
    if a @ b > 0 and (b @ b < radius**2 or rest < TOUCHING * radius**2):
        return np.inf
    return float(np.clip((-slope - np.sqrt(root)) / (path @ path), 0, 1))


def _by_face(a: np.ndarray, b: np.ndarray, half: np.ndarray) -> tuple[int, float] | None:
    """Return (axis, side) of the face by which the path from a to b enters a box about the origin.

    None if it does not, or if that face is the one that pushes the mass out anyway.
    """
    side = np.where(a >= 0, 1.0, -1.0)
    out, inward = side * a - half, side * (a - b)
    can = (out >= -TOUCHING * half) & (inward > 0)
    if not can.any():
        return None
    part = np.where(can, np.maximum(out, 0) / np.where(can, inward, 1), -1)
    axis = int(np.argmax(part))
    others = np.arange(3) != axis
    if part[axis] > 1 or (np.abs(a + part[axis] * (b - a)) > half)[others].any():
        return None
    depth = np.abs(b) - half
    led = (depth <= 0).all() and int(np.argmax(depth)) == axis and (b[axis] >= 0) == (side[axis] > 0)
    return None if led else (axis, float(side[axis]))


class Flow:
    """Flow of a scene whose emitters have constant speeds; `h` [s]: length of a substep."""

    def __init__(self, scene: Scene, h: float):
        self.scene, self.h, self.missing = scene, h, 0
        self.nozzles = {
            name: part.nozzle(scene.fluid_set.spacing, scene.dimensions) for name, part in scene.emitters.items()
        }

    def layers(self, name: str, time: float) -> float:
        """Return the number of layers that have passed the nozzle."""
        part = self.scene.emitters[name]
        stop = np.inf if part.stop is None else part.stop
        return part.speed / self.scene.fluid_set.spacing * (min(max(time, part.start), stop) - part.start)

    def emit(self, number: int, position: np.ndarray, velocity: np.ndarray) -> None:
        """Write the particles that leave in a substep into arrays (particles, 3) in which inactive ones are PARKED."""
        fluid_set = self.scene.fluid_set
        for name, part in self.scene.emitters.items():
            passed = [self.layers(name, (number + k) * self.h) for k in (0, 1)]
            fluid_number = 0 if part.fluid is None else list(self.scene.fluids).index(part.fluid)
            for layer in range(ceil(passed[0]), ceil(passed[1])):
                waiting = np.flatnonzero((fluid_set.fluid == fluid_number) & ~fluid_set.there(position))
                points = self.nozzles[name] + (passed[1] - layer) * fluid_set.spacing * part.unit_direction
                self.missing += max(0, len(points) - len(waiting))
                position[waiting[: len(points)]] = points[: len(waiting)]
                velocity[waiting[: len(points)]] = part.speed * part.unit_direction

    def ended(self, position: np.ndarray) -> np.ndarray:
        """Return a mask (n,) of the positions inside a sink."""
        inside = np.zeros(len(position), bool)
        for sink in self.scene.sinks.values():
            inside |= sink.holds(position)
        return inside

    @staticmethod
    def park(position: np.ndarray, velocity: np.ndarray, gone: np.ndarray) -> None:
        """Deactivate the particles `gone`."""
        position[gone], velocity[gone] = PARKED, 0.0
