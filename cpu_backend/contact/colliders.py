"""Collisions of a cloth's masses with all colliders, for the CPU's kernels, one mass or one row at a time. Those with one
collider: model/contact/colliders.py."""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.core.layout import block_of, row_at
from softlab.model.base.variant import FEATURE, Open, filled, routine, row_routine
from softlab.model.contact.cloth_parameters import COLLIDER_FIELDS
from softlab.model.contact.colliders import (
    instants,
    touch_box,
    touch_capsule,
    touch_field,
    touch_mesh,
    touch_plane,
    touch_sphere,
)
from softlab.model.contact.colliders import point as point
from softlab.model.tables.cloth import COLLIDER_KINDS

PLANE, SPHERE, CAPSULE, BOX, MESH, FIELD = range(len(COLLIDER_KINDS))  # numbers of the kinds of colliders in kernels
BLOCK_32, BLOCK_64 = block_of(np.float32), block_of(np.float64)

touch = Open("touch(body, begin, end, slow, a, p, v) -> (p, v)")


# ---------------------------------------------------------------------- all colliders, in their order
# `bodies`: of `collider_numbers`; `kinds`: PLANE and so on.


@routine
def collide_mass(bodies, kinds, step, parameters, a, p, v):
    """Return the position and velocity (vectors) of a mass after all colliders."""
    begin, end, slow = instants(step, parameters)
    for b in range(kinds.size):
        body = row_at(bodies, np.int64(b * COLLIDER_FIELDS))
        if FEATURE.plane and kinds[b] == PLANE:
            p, v = touch_plane(body, begin, end, slow, a, p, v)
        if FEATURE.sphere and kinds[b] == SPHERE:
            p, v = touch_sphere(body, begin, end, slow, a, p, v)
        if FEATURE.capsule and kinds[b] == CAPSULE:
            p, v = touch_capsule(body, begin, end, slow, a, p, v)
        if FEATURE.box and kinds[b] == BOX:
            p, v = touch_box(body, begin, end, slow, a, p, v)
        if FEATURE.mesh_collider and kinds[b] == MESH:
            p, v = touch_mesh(body, begin, end, slow, a, p, v)
        if FEATURE.distance_field and kinds[b] == FIELD:
            p, v = touch_field(body, begin, end, slow, a, p, v)
    return p, v


@row_routine
def touch_row(blocks, body, begin, end, slow, ax, ay, az, x, y, z, vx, vy, vz):
    for j in range(blocks * (BLOCK_32 if FEATURE.single else BLOCK_64)):
        (px, py, pz), (qx, qy, qz) = touch(
            body, begin, end, slow, (ax[j], ay[j], az[j]), (x[j], y[j], z[j]), (vx[j], vy[j], vz[j])
        )
        x[j] = px
        y[j] = py
        z[j] = pz
        vx[j] = qx
        vy[j] = qy
        vz[j] = qz


plane_row, sphere_row = filled(touch_row, {"touch": touch_plane}), filled(touch_row, {"touch": touch_sphere})
capsule_row, box_row = filled(touch_row, {"touch": touch_capsule}), filled(touch_row, {"touch": touch_box})
mesh_row, field_row = filled(touch_row, {"touch": touch_mesh}), filled(touch_row, {"touch": touch_field})


@routine
def collide_planes(bodies, kinds, step, parameters, blocks, ax, ay, az, x, y, z, vx, vy, vz):
    """Apply all colliders to masses stored contiguously in planes."""
    begin, end, slow = instants(step, parameters)
    for b in range(kinds.size):
        body = row_at(bodies, np.int64(b * COLLIDER_FIELDS))
        if FEATURE.plane and kinds[b] == PLANE:
            plane_row(blocks, body, begin, end, slow, ax, ay, az, x, y, z, vx, vy, vz)
        if FEATURE.sphere and kinds[b] == SPHERE:
            sphere_row(blocks, body, begin, end, slow, ax, ay, az, x, y, z, vx, vy, vz)
        if FEATURE.capsule and kinds[b] == CAPSULE:
            capsule_row(blocks, body, begin, end, slow, ax, ay, az, x, y, z, vx, vy, vz)
        if FEATURE.box and kinds[b] == BOX:
            box_row(blocks, body, begin, end, slow, ax, ay, az, x, y, z, vx, vy, vz)
        if FEATURE.mesh_collider and kinds[b] == MESH:
            mesh_row(blocks, body, begin, end, slow, ax, ay, az, x, y, z, vx, vy, vz)
        if FEATURE.distance_field and kinds[b] == FIELD:
            field_row(blocks, body, begin, end, slow, ax, ay, az, x, y, z, vx, vy, vz)


@routine
def collide_row(bodies, kinds, step, parameters, blocks, source, here, plane_size, target, there, target_plane):
    """Apply all colliders to a row of masses, which begins at `here` in `source` (before the step) and at `there` in
    `target` (after it)."""
    collide_planes(
        bodies, kinds, step, parameters, blocks, row_at(source, here), row_at(source, here + plane_size),
        row_at(source, here + 2 * plane_size), row_at(target, there), row_at(target, there + target_plane),
        row_at(target, there + 2 * target_plane), row_at(target, there + 3 * target_plane),
        row_at(target, there + 4 * target_plane), row_at(target, there + 5 * target_plane),
    )  # fmt: skip
