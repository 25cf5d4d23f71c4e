"""Collisions of foam points with a scene's colliders, all points at once, on the host; they are drawn, not
simulated."""

from __future__ import annotations

import numpy as np

from softlab.model.geometry.crossings import corners_of, first_crossings
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import Box, Capsule, Collider, Plane, Sphere
from softlab.model.tables.colliders.distance_field import DistanceField
from softlab.model.tables.colliders.mesh_collider import MeshCollider
from softlab.model.tables.colliders.surface_collider import SurfaceCollider

ROUNDS = 4  # corrections of a point to its side of a mesh, before it stays where it was
GAP = 1e-3  # rest distances from a mesh, where it is put: on a triangle rounding would decide the side


def outward(collider: Collider, place: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Return (signed distance (n,) [m], unit normal (n, 3)) of points (n, 3) [m] from a collider at `time` [s].

    For a plane, ball, capsule, box or field; None for a mesh, which has no inside.
    """
    if isinstance(collider, DistanceField):
        distance, normal = _field(collider, _seen(collider, place, time))
        return distance, normal @ collider.turn_at(time).T
    place = place - time * np.asarray(collider.velocity)
    if isinstance(collider, Plane):
        normal = np.asarray(collider.normal) / np.linalg.norm(collider.normal)
        return (place - collider.point) @ normal, np.broadcast_to(normal, place.shape)
    if isinstance(collider, Sphere):
        return _ball(place - collider.center, collider.radius)
    if isinstance(collider, Capsule):
        start, axis = np.asarray(collider.start), np.subtract(collider.end, collider.start)
        fraction = np.clip((place - start) @ axis / max(float(axis @ axis), 1e-30), 0, 1)
        return _ball(place - start - fraction[:, None] * axis, collider.radius)
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


def _seen(collider: SurfaceCollider, place: np.ndarray, time: float) -> np.ndarray:
    """Return positions (n, 3) in the collider's frame."""
    away = place - np.asarray(collider.origin) - time * np.asarray(collider.velocity)
    return np.asarray(away @ collider.turn_at(time))


def _field(collider: DistanceField, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the interpolated distance and its gradient's direction, in the field's frame.

    The gradient is a central difference over a cell; outside the grid the distance is infinite.
    """
    field = collider.field
    last = field.low + field.spacing * (np.array(field.distance.shape) - 1)
    within = ((place >= field.low) & (place <= last)).all(axis=1)
    distance, normal = np.full(len(place), np.inf), np.tile([0.0, 1.0, 0.0], (len(place), 1))
    some, steps = place[within], field.spacing / 2 * np.eye(3)
    distance[within] = field.at(some)
    ends = [[field.at(np.clip(some + side * step, field.low, last)) for step in steps] for side in (-1, 1)]
    normal[within] = _ball((np.array(ends[1]) - ends[0]).T, 0.0)[1]
    return distance, normal


def _before_mesh(
    collider: MeshCollider, place: np.ndarray, displacement: np.ndarray, time: float, passed: float, gap: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (positions (n, 3) [m], normals (n, 3), which paths touched the mesh (n,)) of points stopped by a mesh.

    They lie on the side from which their displacements `displacement`, in `passed` [s], come; normals point to that side. The
    component into the mesh is removed from a displacement, `gap` [m] before it; the rest continues along it.
    """
    begin, end = _seen(collider, place - displacement, time - passed), _seen(collider, place, time)
    corners, normal, crosses = corners_of(collider.tree), np.zeros_like(end), np.ones(len(end), bool)
    touched = np.zeros(len(end), bool)
    for _ in range(ROUNDS):
        some = np.flatnonzero(crosses)
        triangle, side = first_crossings(collider.tree, begin[some], end[some])
        crosses[some] = triangle >= 0
        some, triangle, side = (array[triangle >= 0] for array in (some, triangle, side))
        depth = gap - ((end[some] - corners[triangle, 0]) * side).sum(axis=1)
        end[some] += depth[:, None] * side
        normal[some], touched[some] = side, True
    some = np.flatnonzero(crosses)
    stays = some[first_crossings(collider.tree, begin[some], end[some])[0] >= 0]
    end[stays] = begin[stays]
    turn = collider.turn_at(time)
    led = end @ turn.T + collider.origin + time * np.asarray(collider.velocity)
    return np.where(touched[:, None], led, place), normal @ turn.T, touched


def _wall_velocity(collider: Collider, place: np.ndarray, time: float) -> np.ndarray:
    """Return the collider's velocity at positions (n, 3), (n, 3) [m/s]."""
    velocity = np.asarray(collider.velocity)
    if isinstance(collider, SurfaceCollider):
        return np.asarray(velocity + np.cross(collider.spin, place - collider.origin - time * velocity))
    return velocity


def pushed_out(
    scene: Scene, place: np.ndarray, displacement: np.ndarray, velocity: np.ndarray, time: float, passed: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (positions (n, dimensions) [m], velocities [m/s], which touched a collider (n,)) of points after
    collisions.

    `displacement` [m]: in the time `passed` [s]. They are pushed out along the normal, or back to the side of a mesh
    from which they come; the velocity component into a collider, relative to the collider, is removed.
    """
    axes = place.shape[1]
    where, moving, came = (np.pad(array, ((0, 0), (0, 3 - axes))) for array in (place, velocity, displacement))
    touched, start = np.zeros(len(place), bool), where - came
    for _, collider in scene.colliders:
        if isinstance(collider, MeshCollider):
            gap = GAP * scene.fluid_set.spacing
            where, normal, into = _before_mesh(collider, where, where - start, time, passed, gap)
        else:
            surface = outward(collider, where, time)
            if surface is None:
                continue
            distance, normal = surface
            into = distance < 0
            where = where - np.where(into, distance, 0)[:, None] * normal
        touched |= into
        speed = ((moving - _wall_velocity(collider, where, time)) * normal).sum(axis=1)
        moving = moving - np.where(into & (speed < 0), speed, 0)[:, None] * normal
    return where[:, :axes], moving[:, :axes], touched
