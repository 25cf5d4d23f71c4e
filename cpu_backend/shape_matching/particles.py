"""Operations on single particles of bodies on CPU threads: loops over blocks of LANES, in the layout of
shape_matching/kernels.py.

`travel`: three planes of inertial displacements and one of slacks, read if bodies are rigid.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.cpu_backend.contact.colliders import collide_mass, collide_planes
from softlab.cpu_backend.contact.particles_project import PACES
from softlab.cpu_backend.core.layout import block_of, row_at
from softlab.cpu_backend.core.own_forces import particle_force
from softlab.cpu_backend.shape_matching.kernels import AXES
from softlab.model.base.variant import FEATURE, features_of, filled, open_constant, routine, row_routine
from softlab.model.formulas.distance import damping_factor, kicked, predicted
from softlab.model.formulas.distance import rate as rate_of
from softlab.model.formulas.shape_matching.cluster import LANES
from softlab.model.formulas.shape_matching.rigid import rate_over, travelled
from softlab.model.tables.cloth import COLLIDER_KINDS

BLOCK_32, BLOCK_64 = block_of(np.float32), block_of(np.float64)
NO_STEP = np.int64(0)  # no force on bodies depends on it

RATES = open_constant("RATES: a prediction writes velocities at the substep's end")


def body_features(parts: frozenset[str]) -> dict[str, Any]:
    """Return the features of kernels of bodies with `parts`. Every particle has its weight."""
    return features_of(parts | {"load"}) | {
        "axes": AXES, "colliders": bool(parts & set(COLLIDER_KINDS)), "calmed": bool(parts & PACES),
        "pairs": False,
    }  # fmt: skip


@routine
def travel_place(k):
    """Return place `k` of the travels; without rigid bodies 0, of an array that is not read."""
    return k if FEATURE.rigid_motion else np.int64(0)


@row_routine
def predict_rows(
    blocks, first, integers, parameters, weights, x, y, z, vx, vy, vz, to_x, to_y, to_z, over_x, over_y, over_z
):  # fmt: skip
    """Predict blocks of particles; `first`: place of the first one.

    With RATES the travels are converted to velocities at once and not stored.
    """
    h = parameters.dt
    for block in range(blocks):
        for lane in range(LANES):
            k = block * LANES + lane
            weight = weights[k]
            ax, ay, az = 0.0, 0.0, 0.0
            if FEATURE.gravity:
                ay = ay + parameters.gravity
            ax, ay, az = particle_force((ax, ay, az), first + k, weight, parameters, integers, NO_STEP)
            factor = damping_factor(parameters.braking, weight) if FEATURE.damping else 1.0
            u, v, w = kicked(vx[k], factor, h, ax), kicked(vy[k], factor, h, ay), kicked(vz[k], factor, h, az)
            px, py, pz = predicted(x[k], h, u), predicted(y[k], h, v), predicted(z[k], h, w)
            if RATES:
                goes = not FEATURE.spare or weight > 0.0
                vx[k] = rate_over(travelled(h, u), parameters.inverse_substep) if goes else 0.0
                vy[k] = rate_over(travelled(h, v), parameters.inverse_substep) if goes else 0.0
                vz[k] = rate_over(travelled(h, w), parameters.inverse_substep) if goes else 0.0
            elif FEATURE.rigid_motion:
                over_x[k], over_y[k], over_z[k] = travelled(h, u), travelled(h, v), travelled(h, w)
            to_x[k] = px if not FEATURE.spare or weight > 0.0 else x[k]
            to_y[k] = py if not FEATURE.spare or weight > 0.0 else y[k]
            to_z[k] = pz if not FEATURE.spare or weight > 0.0 else z[k]


predict_velocities = filled(predict_rows, {"RATES": False})
predict_rates = filled(predict_rows, {"RATES": True})


@routine
def begin(first, last, count, before, after, velocity, weights, parameters, integers, travel):
    """Predict the particles from `first` to before `last`, of `count` of a plane."""
    predict_velocities(
        (last - first) // LANES, first, integers, parameters, row_at(weights, first), row_at(before, first),
        row_at(before, count + first), row_at(before, 2 * count + first), row_at(velocity, first),
        row_at(velocity, count + first), row_at(velocity, 2 * count + first), row_at(after, first),
        row_at(after, count + first), row_at(after, 2 * count + first), row_at(travel, travel_place(first)),
        row_at(travel, travel_place(count + first)), row_at(travel, travel_place(2 * count + first)),
    )  # fmt: skip


@routine
def begin_rigid(first, last, count, before, after, velocity, weights, parameters, integers):
    """Predict the particles of a rigid body that only matching moves, and their velocities."""
    unused = row_at(weights, first)
    predict_rates(
        (last - first) // LANES, first, integers, parameters, row_at(weights, first), row_at(before, first),
        row_at(before, count + first), row_at(before, 2 * count + first), row_at(velocity, first),
        row_at(velocity, count + first), row_at(velocity, 2 * count + first), row_at(after, first),
        row_at(after, count + first), row_at(after, 2 * count + first), unused, unused, unused,
    )  # fmt: skip


@row_routine
def rate_rows(
    blocks, parameters, weights, x, y, z, to_x, to_y, to_z, vx, vy, vz, over_x, over_y, over_z, slack
):  # fmt: skip
    inverse = parameters.inverse_substep
    for block in range(blocks):
        for lane in range(LANES):
            k = block * LANES + lane
            goes = not FEATURE.spare or weights[k] > 0.0
            vx[k] = rate_of(to_x[k], x[k], inverse) if goes else 0.0
            vy[k] = rate_of(to_y[k], y[k], inverse) if goes else 0.0
            vz[k] = rate_of(to_z[k], z[k], inverse) if goes else 0.0
            if FEATURE.rigid_motion:
                whole = goes and slack[k] > 0.0
                vx[k] = rate_over(over_x[k], inverse) if whole else vx[k]
                vy[k] = rate_over(over_y[k], inverse) if whole else vy[k]
                vz[k] = rate_over(over_z[k], inverse) if whole else vz[k]


@routine
def rate(first, last, count, before, after, velocity, weights, parameters, travel):
    """Write the velocities of a substep, of rigid bodies from their travels (model/formulas/shape_matching/rigid.py)."""
    rate_rows(
        (last - first) // LANES, parameters, row_at(weights, first), row_at(before, first), row_at(before, count + first),
        row_at(before, 2 * count + first), row_at(after, first), row_at(after, count + first),
        row_at(after, 2 * count + first), row_at(velocity, first), row_at(velocity, count + first),
        row_at(velocity, 2 * count + first), row_at(travel, travel_place(first)), row_at(travel, travel_place(count + first)),
        row_at(travel, travel_place(2 * count + first)), row_at(travel, travel_place(3 * count + first)),
    )  # fmt: skip


@routine
def collide_particles(first, last, number, before, after, velocity, weights, world):
    """Apply all colliders to particles."""
    count = weights.size
    for k in range(first, last):
        if FEATURE.spare and weights[k] == 0.0:
            continue  # also skips ghosts
        (px, py, pz), (vx, vy, vz) = collide_mass(
            world.bodies, world.kinds, number, world.parameters,
            (before[k], before[count + k], before[2 * count + k]), (after[k], after[count + k], after[2 * count + k]),
            (velocity[k], velocity[count + k], velocity[2 * count + k]),
        )  # fmt: skip
        after[k], after[count + k], after[2 * count + k] = px, py, pz
        velocity[k], velocity[count + k], velocity[2 * count + k] = vx, vy, vz


@row_routine
def note_rows(n, vx, vy, vz, had_x, had_y, had_z):
    for k in range(n):
        had_x[k], had_y[k], had_z[k] = vx[k], vy[k], vz[k]


@row_routine
def impulse_rows(n, vx, vy, vz, had_x, had_y, had_z):
    for k in range(n):
        had_x[k], had_y[k], had_z[k] = vx[k] - had_x[k], vy[k] - had_y[k], vz[k] - had_z[k]


@routine
def store_impulses(first, last, number, before, after, velocity, weights, world, impulses):
    """Apply all colliders to particles, and write the changes of their velocities into three planes `impulses`."""
    count = weights.size
    x, y, z = first, count + first, 2 * count + first
    vx, vy, vz = row_at(velocity, x), row_at(velocity, y), row_at(velocity, z)
    had_x, had_y, had_z = row_at(impulses, x), row_at(impulses, y), row_at(impulses, z)
    note_rows(last - first, vx, vy, vz, had_x, had_y, had_z)
    blocks = (last - first) // (BLOCK_32 if FEATURE.single else BLOCK_64)
    if FEATURE.spare:
        collide_particles(first, last, number, before, after, velocity, weights, world)
    else:
        collide_planes(
            world.bodies, world.kinds, number, world.parameters, blocks, row_at(before, x), row_at(before, y),
            row_at(before, z), row_at(after, x), row_at(after, y), row_at(after, z), vx, vy, vz,
        )  # fmt: skip
    impulse_rows(last - first, vx, vy, vz, had_x, had_y, had_z)
