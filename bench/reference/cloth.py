"""Mass-spring cloth in slow, plain NumPy float64, the reference of both backends, written like that of the grid.

From the equations, by array slicing, without model/formulas, model/core/build, model/contact/cloth_parameters or a
backend. Newton's law per mass m (a load has its own mass),

 m p'' = sum over springs (k (|d| - L0) + c_s (w.d) / |d|) d / |d|  -  c v  +  m (0, -g, 0)  +  wind  +  external,

with d the vector to the neighbour and w its velocity minus the mass's own; a spring of length zero exerts no force.
Pinned masses never move, or follow a motion: forces use their prescribed positions at the time. Colliders act once per
step, on the new position.
"""

from __future__ import annotations

from functools import partial
from math import floor, sqrt

import numpy as np

from softlab.bench.reference.contact import distance_field, mesh_collider
from softlab.bench.reference.philox import random_directions
from softlab.bench.reference.steps import Poke, masses, named_mask, pinned_mask
from softlab.model.base.errors import SceneError
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import Box, Capsule, Collider, Plane, Sphere
from softlab.model.tables.colliders.distance_field import DistanceField
from softlab.model.tables.colliders.mesh_collider import MeshCollider

# kind -> (rows, columns) from one end of a spring to the other
OFFSETS = {"structural": ((0, 1), (1, 0)), "shear": ((1, 1), (1, -1)), "bending": ((0, 2), (2, 0))}


def rest(scene: Scene) -> np.ndarray:
    """Return the rest positions (rows, columns, 3) [m], unperturbed, y up: row 0 on top (hanging) or behind (flat)."""
    cloth = scene.cloth
    assert cloth is not None
    if scene.mesh:
        raise SceneError("mesh", scene.name, "has no reference; choose a scene with a grid or a cloth")
    row, column = np.mgrid[: cloth.rows, : cloth.columns]
    zero = np.zeros_like(row)
    flat = cloth.placement == "flat"
    if scene.fold:
        along, across = (a[:, None] + zero for a in _zigzag(cloth.rows, scene.fold.rows - 1, scene.fold.apart))
        plane = (column, across, along) if flat else (column, -along, across)
    else:
        plane = (column, zero, row) if flat else (column, -row, zero)
    return np.array(cloth.origin) + cloth.spacing * np.stack(plane, axis=-1)


def _zigzag(rows: int, long: int, apart: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (along, across) (rows,) in spacings: `long` steps forward, `apart` steps across, `long` back, and so on."""
    strides: list[tuple[int, int]] = []
    while len(strides) < rows:
        for turn in (1, -1):
            strides += [(turn, 0)] * long + [(0, 1)] * apart
    along, across = np.cumsum([(0, 0), *strides], axis=0)[:rows].T
    return along, across


def start(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return (position, velocity) at time 0, (particles, 3) float64 each, in builder order."""
    position, free = rest(scene), ~pinned_mask(scene)
    if scene.perturbation:
        i, j = np.mgrid[: scene.grid.rows, : scene.grid.columns]
        waves = np.sin(1.7 * i + 0.9 * j), np.cos(0.6 * i - 1.3 * j), np.sin(0.8 * i - 0.7 * j)
        position[free] += scene.perturbation.amplitude * np.stack(waves, axis=-1)[free]
    position = position.reshape(-1, 3)
    return position, np.zeros_like(position)


def follow(scene: Scene, position: np.ndarray, velocity: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (position, velocity) (rows, columns, 3) with the prescribed values of moving pins at `time` [s].

    By the matrix of a motion, R = cos I + sin [u] + (1 - cos) u u^T, [u] a = u x a, and v + w x R a."""
    if not scene.motions:
        return position, velocity
    position, velocity, at_rest = position.copy(), velocity.copy(), start(scene)[0].reshape(position.shape)
    for motion in scene.motions.values():
        mask = named_mask(motion.pins, scene.grid.rows, scene.grid.columns)
        since = time - motion.start
        passed = min(max(since, 0.0), motion.duration)
        unit = np.array(motion.axis) / sqrt(sum(n * n for n in motion.axis))
        angle = motion.angular_velocity * passed
        cross = np.cross(unit, np.eye(3)).T
        matrix = np.cos(angle) * np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * np.outer(unit, unit)
        rotated = (at_rest[mask] - motion.center) @ matrix.T
        position[mask] = np.array(motion.center) + rotated + np.array(motion.velocity) * passed
        moving = 0 <= since < motion.duration
        speed = np.array(motion.velocity) + np.cross(motion.angular_velocity * unit, rotated)
        velocity[mask] = speed if moving else 0.0
    return position, velocity


def ends(array: np.ndarray, offset: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return views of `array` (rows, columns, ...) at both ends of every spring along `offset` (rows >= 0, columns)."""
    down, across = offset
    rows, columns = array.shape[:2]
    if abs(across) >= columns or down >= rows:
        return array[:0, :0], array[:0, :0]
    left, right = max(0, -across), max(0, across)
    return array[: rows - down, left : columns - right], array[down:, right : columns - left]


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("...k,...k", a, b)[..., None]


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    (ax, ay, az), (bx, by, bz) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def _unit(d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (length (..., 1), d / length); the direction of the zero vector is the zero vector."""
    length = np.sqrt(_dot(d, d))
    return length, d / (length + (length == 0))


def spring_forces(scene: Scene, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return the forces of springs and their dampers by Hooke's law: (rows, columns, 3) [N]."""
    force = np.zeros_like(position)
    for kind, springs in scene.cloth_springs.items():
        for offset in OFFSETS[kind]:
            (p, q), (v, w), (f, g) = (ends(array, offset) for array in (position, velocity, force))
            length, direction = _unit(q - p)
            rest_length = scene.grid.spacing * sqrt(offset[0] ** 2 + offset[1] ** 2)
            lengthening = _dot(w - v, direction)
            pull = (springs.stiffness * (length - rest_length) + springs.damping * lengthening) * direction
            f += pull
            g -= pull
    return force


def air(scene: Scene, time: float) -> np.ndarray:
    """Return the velocity of the wind with its gusts: (3,) [m/s].

    Gusts are random numbers at multiples of gust_time, joined by 3 p^2 - 2 p^3."""
    wind = scene.wind
    assert wind is not None
    interval = floor(time / wind.gust_time)
    part = time / wind.gust_time - interval
    before, after = (random_directions(wind.seed, interval + k, 1)[0, 0] for k in (0, 1))
    gust = before + (3 * part**2 - 2 * part**3) * (after - before)
    return np.array(wind.velocity) * (1 + wind.gust * gust)


def wind_forces(scene: Scene, position: np.ndarray, velocity: np.ndarray, time: float) -> np.ndarray:
    """Return the drag and lift of every cell's two triangles as flat plates: (rows, columns, 3) [N].

    Each corner has a third. With unit normal n, area A and the air's velocity relative to the triangle u: half the
    density times A times drag |u.n| u + lift (u.n) (|u| n - (u.n) u / |u|)."""
    wind = scene.wind
    force = np.zeros_like(position)
    if wind is None:
        return force
    now = air(scene, time)
    first, right, below, opposite = (
        (slice(i, i - 1 or None), slice(j, j - 1 or None)) for i, j in ((0, 0), (0, 1), (1, 0), (1, 1))
    )
    for corners in ((first, below, opposite), (first, opposite, right)):
        (a, b, c), (va, vb, vc) = ([array[corner] for corner in corners] for array in (position, velocity))
        u = now - (va + vb + vc) / 3
        twice_area, normal = _unit(_cross(b - a, c - a))
        speed, along = _unit(u)
        through = _dot(u, normal)
        pressure = wind.drag * np.abs(through) * u + wind.lift * through * (speed * normal - through * along)
        for corner in corners:
            force[corner] += wind.density / 2 * twice_area / 2 * pressure / 3
    return force


def forces(
    scene: Scene, position: np.ndarray, velocity: np.ndarray, time: float, step: int, poke: Poke | None = None
) -> np.ndarray:
    """Return all forces except the damper of the masses: (rows, columns, 3) [N]."""
    position, velocity = follow(scene, position, velocity, time)
    force = spring_forces(scene, position, velocity)
    if scene.gravity and scene.gravity.enabled:
        force[..., 1:2] -= masses(scene) * scene.gravity.acceleration
    force += wind_forces(scene, position, velocity, time)
    if scene.external and scene.external.magnitude > 0:
        directions = random_directions(scene.external.seed, step, scene.grid.particle_count, axes=3)
        force += scene.external.magnitude * directions.reshape(force.shape)
    if poke is not None and poke[0] is not None:
        force[divmod(poke[0], scene.grid.columns)] += poke[1]
    return force


def distances(collider: Collider, position: np.ndarray, time: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return (signed distance (..., 1) [m], unit normal (..., 3)) of `position` (..., 3) at `time` [s].

    The distance is negative inside. At the centre of a ball (and on a capsule's segment) the normal points up."""
    moved = np.asarray(position, dtype=np.float64) - np.array(collider.velocity) * time
    if isinstance(collider, Plane):
        normal = np.array(collider.normal) / sqrt(sum(n * n for n in collider.normal))
        return _dot(moved - collider.point, normal), np.broadcast_to(normal, moved.shape)
    if isinstance(collider, Box):
        return _box_distances(moved - collider.center, np.array(collider.half_size))
    assert isinstance(collider, Sphere | Capsule)
    if isinstance(collider, Sphere):
        away = moved - collider.center
    else:
        axis = np.subtract(collider.end, collider.start)
        squared = float(axis @ axis)
        part = np.clip(_dot(moved - collider.start, axis) / squared, 0, 1) if squared > 0 else 0.0
        away = moved - collider.start - part * axis
    length, normal = _unit(away)
    return length - collider.radius, np.where(length > 0, normal, (0.0, 1.0, 0.0))


def _box_distances(d: np.ndarray, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return distance and normal: outside those of the nearest point, inside those of the nearest face.

    Where faces are equally near, x comes before y before z."""
    outside = d - np.clip(d, -half, half)
    length, normal = _unit(outside)
    depth = np.abs(d) - half
    nearest = np.eye(3)[np.argmax(depth, axis=-1)]
    inside = (depth <= 0).all(axis=-1, keepdims=True)
    face = nearest * np.where(d >= 0, 1.0, -1.0)
    return np.where(inside, depth.max(axis=-1, keepdims=True), length), np.where(inside, face, normal)


def _entries(a: np.ndarray, b: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (mask (..., 1) of masses that a ball around the origin catches between a and b, entry points (..., 3)).

    The entry is the first t in [0, 1) with |a + t (b - a)| = reach, where a is outside and b is not. If b is inside but
    on a's half, the nearest surface is the right one anyway, and the mass is not caught. Nor is a mass that begins in
    contact (within 1e-3 of the radius's square) and ends on that half, so that rounding of its start cannot decide."""
    path = b - a
    square, half, rest_ = _dot(path, path), _dot(a, path), _dot(a, a) - radius**2
    root = half**2 - square * rest_
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.maximum((-half - np.sqrt(root)) / square, 0)
    near_side = (_dot(a, b) > 0) & ((_dot(b, b) < radius**2) | (rest_ < 1e-3 * radius**2))
    caught = (rest_ >= -1e-3 * radius**2) & (half < 0) & (root > 0) & (t < 1) & ~near_side
    return caught, a + np.where(caught, t, 0.0) * path


def touched(
    collider: Collider,
    slow: float,
    velocity: np.ndarray,
    normal: np.ndarray,
    surface: np.ndarray | None = None,
) -> np.ndarray:
    """Return velocities (..., 3) after contact: none into the collider, and Coulomb friction relative to it.

    `surface` [m/s]: velocity of the collider's surface, if it differs from the collider's. Masses that arrive faster
    than `slow` [m/s] bounce by the restitution."""
    surface = np.array(collider.velocity) if surface is None else surface
    relative = velocity - surface
    into = np.maximum(-_dot(relative, normal), 0)
    along = np.where(into > 0, relative + into * normal, relative)
    speed, direction = _unit(along)
    back = np.where(into > slow, collider.restitution * into, 0)
    change = into + back
    slowed = np.where(speed <= collider.static_friction * change, 0, speed - collider.dynamic_friction * change)
    return surface + np.where(into > 0, slowed * direction + back * normal, along)


def reverted_sliding(dt: float, velocity: np.ndarray, answered: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return the displacement that friction reverts in a step, dt times the tangential change of velocity: (..., 3)
    [m]."""
    change = answered - velocity
    return dt * (change - _dot(change, normal) * normal)


def collide(
    scene: Scene, before: np.ndarray, position: np.ndarray, velocity: np.ndarray, step: int, in_place: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Return (position, velocity) (rows, columns, 3) after the colliders of step `step`, which began at `before`.

    The colliders act one after another, at their places at the end of the step. A mass that a ball swept over is moved
    to its entry point, one nearer than the thickness to that distance. Pinned masses do not move. `in_place`: friction
    also reverts the sliding within the step, except of a mass that was swept over."""
    dt = scene.method.dt
    free = ~pinned_mask(scene)[..., None]
    gravity = scene.gravity.acceleration if scene.gravity and scene.gravity.enabled else 0.0
    slow = 2 * gravity * dt
    for _, collider in scene.colliders:
        if isinstance(collider, MeshCollider | DistanceField):
            old, new, speed = (array.reshape(-1, 3) for array in (before, position, velocity))
            times = step * dt, (step + 1) * dt, partial(touched, collider, slow)
            if isinstance(collider, MeshCollider):
                settled, answered = mesh_collider.collide(collider, old, new, speed, *times, in_place)
            else:
                settled, answered = distance_field.collide(collider, old, new, speed, *times, in_place)
            position = np.where(free, settled.reshape(position.shape), position)
            velocity = np.where(free, answered.reshape(position.shape), velocity)
            continue
        distance, normal = distances(collider, position, (step + 1) * dt)
        settled = position + np.maximum(collider.thickness - distance, 0) * normal
        touching, swept = distance < collider.thickness, np.zeros(distance.shape, bool)
        if isinstance(collider, Sphere):
            contact_distance = collider.radius + collider.thickness
            old, new = (np.array(collider.center) + np.array(collider.velocity) * (step + k) * dt for k in (0, 1))
            caught, entered = _entries(before - old, position - new, contact_distance)
            settled = np.where(caught, new + entered, settled)
            normal = np.where(caught, _unit(entered)[1], normal)
            touching, swept = touching | caught, caught
        answered = touched(collider, slow, velocity, normal)
        if in_place:
            settled = settled + np.where(swept, 0.0, reverted_sliding(dt, velocity, answered, normal))
        position = np.where(touching & free, settled, position)
        velocity = np.where(touching & free, answered, velocity)
    return position, velocity
