"""Collisions of a cloth's mass with all colliders, in the scene's order, as device functions. Those with one collider:
model/contact/colliders.py."""

from __future__ import annotations

import numpy as np

from softlab.gpu_backend.contact.rows import B_VX, B_VY, B_VZ, B_X, B_Y, B_Z, FIRST_ROW, ROW, row_at
from softlab.gpu_backend.core.integers import BOXES, CAPSULES, FIELDS, MESHES, PLANES, SPHERES
from softlab.model.base.variant import FEATURE, inlined_routine
from softlab.model.contact.colliders import (
    instants,
    touch_box,
    touch_capsule,
    touch_field,
    touch_mesh,
    touch_plane,
    touch_sphere,
)
from softlab.model.formulas.cloth import moved


@inlined_routine
def place_of(bodies, at, time):
    """Return the position [m] at `time` [s] of the collider whose row begins at `at`."""
    return (
        moved(bodies[at + B_X], bodies[at + B_VX], time),
        moved(bodies[at + B_Y], bodies[at + B_VY], time),
        moved(bodies[at + B_Z], bodies[at + B_VZ], time),
    )


@inlined_routine
def collide(before, px, py, pz, vx, vy, vz, world, step):
    """Return the state of a mass after all colliders: (px, py, pz, vx, vy, vz).

    `before`: the mass at the step's start (a quad); the rest: its state at the step's end. `world.colliders`: the rows
    of model/contact/cloth_parameters.py one after the other, then trees and fields; `world.integers` has the number of
    each kind.
    """
    if not (
        FEATURE.plane or FEATURE.sphere or FEATURE.capsule or FEATURE.box or FEATURE.mesh_collider
        or FEATURE.distance_field
    ):  # fmt: skip
        return px, py, pz, vx, vy, vz
    parameters, bodies, integers = world.parameters, world.colliders, world.integers
    p, v, at, a = (px, py, pz), (vx, vy, vz), FIRST_ROW, (before[0], before[1], before[2])
    begin, end, slow = instants(step, parameters)
    if FEATURE.plane:
        for _ in range(np.int32(integers[PLANES])):
            p, v = touch_plane(row_at(bodies, at), begin, end, slow, a, p, v)
            at = np.uint64(at + ROW)
    if FEATURE.sphere:
        for _ in range(np.int32(integers[SPHERES])):
            p, v = touch_sphere(row_at(bodies, at), begin, end, slow, a, p, v)
            at = np.uint64(at + ROW)
    if FEATURE.capsule:
        for _ in range(np.int32(integers[CAPSULES])):
            p, v = touch_capsule(row_at(bodies, at), begin, end, slow, a, p, v)
            at = np.uint64(at + ROW)
    if FEATURE.box:
        for _ in range(np.int32(integers[BOXES])):
            p, v = touch_box(row_at(bodies, at), begin, end, slow, a, p, v)
            at = np.uint64(at + ROW)
    if FEATURE.mesh_collider:
        for _ in range(np.int32(integers[MESHES])):
            p, v = touch_mesh(row_at(bodies, at), begin, end, slow, a, p, v)
            at = np.uint64(at + ROW)
    if FEATURE.distance_field:
        for _ in range(np.int32(integers[FIELDS])):
            p, v = touch_field(row_at(bodies, at), begin, end, slow, a, p, v)
            at = np.uint64(at + ROW)
    return p[0], p[1], p[2], v[0], v[1], v[2]
