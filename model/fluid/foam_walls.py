"""Points that are kept out of a scene's colliders, all of them at once, on the host: what is drawn and not simulated."""

from __future__ import annotations

from typing import Any

import numpy as np

from model.scene.cloth import Box, Capsule, Plane, Sphere
from model.scene.scene import Scene


def outward(collider: Any, place: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray] | None:
    """(signed distance (n,) [m], unit normal (n, 3)) of a plane, ball, rod or block, where it is at `time` [s], at places
    (n, 3) [m]; None of meshes and fields."""
    place = place - time * np.asarray(collider.velocity)
    if isinstance(collider, Plane):
        normal = np.asarray(collider.normal) / np.linalg.norm(collider.normal)
        return (place - collider.point) @ normal, np.broadcast_to(normal, place.shape)
    if isinstance(collider, Sphere):
        return _ball(place - collider.center, collider.radius)
    if isinstance(collider, Capsule):
        start, way = np.asarray(collider.start), np.subtract(collider.end, collider.start)
        share = np.clip((place - start) @ way / max(float(way @ way), 1e-30), 0, 1)
        return _ball(place - start - share[:, None] * way, collider.radius)
    if isinstance(collider, Box):
        return _block(place - collider.center, np.asarray(collider.half_size))
    return None


def _ball(away: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    length = np.sqrt((away**2).sum(axis=1))
    normal = np.where(length[:, None] > 0, away / np.maximum(length, 1e-30)[:, None], (0.0, 1.0, 0.0))
    return length - radius, normal


def _block(away: np.ndarray, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    over, side = np.abs(away) - half, np.where(away >= 0, 1.0, -1.0)
    inside = (over <= 0).all(axis=1)
    distance, normal = _ball(side * np.maximum(over, 0), 0.0)
    nearest = over.argmax(axis=1)
    face = np.zeros_like(away)
    face[np.arange(len(away)), nearest] = side[np.arange(len(away)), nearest]
    return np.where(inside, over.max(axis=1), distance), np.where(inside[:, None], face, normal)


def kept_out(
    scene: Scene, place: np.ndarray, velocity: np.ndarray, time: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(places (n, dimensions) [m], velocities [m/s], which met a collider (n,)): out by the nearest way, and with what goes
    into a collider taken from the velocity, relative to its own."""
    axes = place.shape[1]
    where, moving = (np.pad(array, ((0, 0), (0, 3 - axes))) for array in (place, velocity))
    met = np.zeros(len(place), bool)
    for _, collider in scene.colliders:
        found = outward(collider, where, time)
        if found is None:
            continue
        distance, normal = found
        into = distance < 0
        met |= into
        where = where - np.where(into, distance, 0)[:, None] * normal
        speed = ((moving - np.asarray(collider.velocity)) * normal).sum(axis=1)
        moving = moving - np.where(into & (speed < 0), speed, 0)[:, None] * normal
    return where[:, :axes], moving[:, :axes], met
