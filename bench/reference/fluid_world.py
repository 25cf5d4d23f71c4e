"""What a fluid's particles meet, in slow, plain NumPy float64: how far they are from each collider, what stops them, where
they come from and end.

From what model/fluid/plan.py says, without model/formulas. A way that enters a ball or a capsule ends where it enters; one
that enters a box by a face ends before that face, moved along its normal, unless it ends inside and nearer to that face than
to any other, where being led out by the nearest face says the same. A nozzle's layers leave it a rest distance apart at its
speed; who leaves is the waiting particle of its fluid with the lowest number."""

from __future__ import annotations

from functools import partial
from math import ceil
from typing import Any

import numpy as np

from bench.reference import cloth
from bench.reference.contact import distance_field, mesh_collider
from model.contact.mesh_collider import MeshCollider
from model.fluid.fluid_set import PARKED
from model.geometry.distance_field import DistanceField
from model.scene.scene import Scene

TOUCHING = 1e-3  # of half an edge, or of the squared radius: so near a mass is in contact, whatever rounding made of it
FLAT = 1 / 1024  # a slope of a field that leads nowhere


def distances(kind: str, collider: Any, p: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    """(distance (n,) [m], normal (n, 3)) of places (n, 3) from a collider at `time` [s]; inf where it is not known."""
    if not isinstance(collider, MeshCollider | DistanceField):
        distance, normal = cloth.distances(kind, collider, p, time)
        return distance.reshape(-1), normal
    turn = collider.turn_at(time)
    places = (p - collider.origin - np.array(collider.velocity) * time) @ turn
    distance, normal = np.full(len(p), np.inf), np.zeros_like(p)
    for k, place in enumerate(places):
        if isinstance(collider, MeshCollider):
            way = place - mesh_collider.nearest_point(collider.position[collider.triangles], place)
            length = float(np.linalg.norm(way))
            if length > 0:
                distance[k], normal[k] = length, turn @ way / length
        else:
            field = collider.field
            last = field.low + field.spacing * (np.array(field.distance.shape) - 1)
            inside = np.clip(place, field.low + field.spacing / 2, last - field.spacing / 2)
            value, slope = distance_field.sample(field, inside)
            steep = float(np.linalg.norm(slope))
            if steep > FLAT:
                distance[k], normal[k] = value + np.linalg.norm(place - inside), turn @ slope / steep
    return distance, normal


def joined(total: np.ndarray, share: np.ndarray) -> np.ndarray:
    """What walls add to C: `total` of those so far and `share` of one more, less their overlap."""
    larger = np.maximum(total, share)
    return np.where(larger >= 1, larger, total + share - total * share)


def rate(share: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Derivative of `joined` with respect to `share`."""
    return np.where(np.maximum(share, other) >= 1, share >= other, 1 - other)


def collide(
    scene: Scene, before: np.ndarray, position: np.ndarray, velocity: np.ndarray, number: int
) -> tuple[np.ndarray, np.ndarray]:
    """(position, velocity) (n, 3) after the colliders of the substep of that number, which `method.dt` is the length of and
    which it began at `before`: collider by collider, where it is at the substep's end."""
    dt = scene.method.dt
    gravity = scene.gravity.acceleration if scene.gravity and scene.gravity.enabled else 0.0
    slow, times = 2 * gravity * dt, (number * dt, (number + 1) * dt)
    for kind, collider in scene.colliders:
        surface: Any = collider
        if isinstance(surface, MeshCollider | DistanceField):
            meet: Any = mesh_collider.collide if isinstance(surface, MeshCollider) else distance_field.collide
            position, velocity = meet(
                surface, before, position, velocity, *times, partial(cloth.touched, surface, slow)
            )
            continue
        distance, normal = cloth.distances(kind, surface, position, times[1])
        settled = position + np.maximum(surface.thickness - distance, 0) * normal
        touching = distance < surface.thickness
        if kind != "plane":
            found, stopped, way = _caught(kind, surface, before, position, *times)
            settled, normal = np.where(found, stopped, settled), np.where(found, way, normal)
            touching = touching | found
        position = np.where(touching, settled, position)
        velocity = np.where(touching, cloth.touched(surface, slow, velocity, normal), velocity)
    return position, velocity


def _caught(
    kind: str, collider: Any, before: np.ndarray, position: np.ndarray, begin: float, end: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(which masses (n, 1) were stopped, where (n, 3), normals (n, 3)) of those that were at `before` (n, 3) at `begin` [s]
    and come to `position` at `end`, by a ball, a capsule or a box."""
    drift = np.array(collider.velocity)
    start = np.array(collider.start if kind == "capsule" else collider.center)
    found, stopped, normal = np.zeros((len(position), 1), bool), position.copy(), np.zeros_like(position)
    for k in range(len(position)):
        a, b = before[k] - start - drift * begin, position[k] - start - drift * end
        if kind == "box":
            half = np.array(collider.half_size)
            entered = _by_face(a, b, half)
            if entered is not None:
                axis, side = entered
                found[k], normal[k, axis] = True, side
                stopped[k, axis] = (start + drift * end)[axis] + side * (half[axis] + collider.thickness)
            continue
        line = np.array(collider.end) - start if kind == "capsule" else np.zeros(3)
        part = _into_capsule(a, b, line, collider.radius + collider.thickness)
        if part < 1:
            place, square = a + part * (b - a), line @ line
            away = place - (np.clip(place @ line / square, 0, 1) * line if square else 0)
            found[k], stopped[k], normal[k] = True, start + drift * end + place, away / np.linalg.norm(away)
    return found, stopped, normal


def _into_capsule(a: np.ndarray, b: np.ndarray, line: np.ndarray, reach: float) -> float:
    """The part of the way from a to b (3,) after which it comes within `reach` of the segment from the origin to `line`; inf:
    it does not, or ends where being pushed out is right."""
    square = float(line @ line)
    if square:
        u, w = a @ line / square, b @ line / square
        part = _into_ball(a - u * line, b - w * line, reach)
        if part < 1 and 0 <= u + part * (w - u) <= 1:
            return part
    return min(_into_ball(a, b, reach), _into_ball(a - line, b - line, reach))


def _into_ball(a: np.ndarray, b: np.ndarray, reach: float) -> float:
    """The same of the origin alone."""
    way, rest = b - a, float(a @ a) - reach**2
    slope = float(a @ way)
    root = slope**2 - float(way @ way) * rest
    if rest < -TOUCHING * reach**2 or slope >= 0 or root <= 0:
        return np.inf
    if a @ b > 0 and (b @ b < reach**2 or rest < TOUCHING * reach**2):
        return np.inf
    return float(np.clip((-slope - np.sqrt(root)) / (way @ way), 0, 1))


def _by_face(a: np.ndarray, b: np.ndarray, half: np.ndarray) -> tuple[int, float] | None:
    """(axis, side) of the face of a box about the origin by which the way from a to b enters it; None where it does not, or
    is led out by that face anyway."""
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
    """Of a scene whose emitters' speeds stay; `h` [s]: of a substep."""

    def __init__(self, scene: Scene, h: float):
        self.scene, self.h, self.missing = scene, h, 0
        self.nozzles = {
            name: part.nozzle(scene.fluid_set.spacing, scene.dimensions) for name, part in scene.emitters.items()
        }

    def layers(self, name: str, time: float) -> float:
        """How many have passed the nozzle."""
        part = self.scene.emitters[name]
        stop = np.inf if part.stop is None else part.stop
        return part.speed / self.scene.fluid_set.spacing * (min(max(time, part.start), stop) - part.start)

    def emit(self, number: int, position: np.ndarray, velocity: np.ndarray) -> None:
        """Those that leave in a substep, into arrays (particles, 3) in which others are PARKED."""
        found = self.scene.fluid_set
        for name, part in self.scene.emitters.items():
            passed = [self.layers(name, (number + k) * self.h) for k in (0, 1)]
            own = 0 if part.fluid is None else list(self.scene.fluids).index(part.fluid)
            for layer in range(ceil(passed[0]), ceil(passed[1])):
                waiting = np.flatnonzero((found.fluid == own) & ~found.there(position))
                points = self.nozzles[name] + (passed[1] - layer) * found.spacing * part.way
                self.missing += max(0, len(points) - len(waiting))
                position[waiting[: len(points)]] = points[: len(waiting)]
                velocity[waiting[: len(points)]] = part.speed * part.way

    def ended(self, position: np.ndarray) -> np.ndarray:
        """(n,) bool: who is in a sink."""
        found = np.zeros(len(position), bool)
        for sink in self.scene.sinks.values():
            found |= sink.holds(position)
        return found

    @staticmethod
    def park(position: np.ndarray, velocity: np.ndarray, gone: np.ndarray) -> None:
        """Those of that number wait."""
        position[gone], velocity[gone] = PARKED, 0.0
