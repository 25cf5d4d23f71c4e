"""Operations of both orderings' kernels on a row before and after its constraints: prediction, attachments, velocity,
colliders.

All routines pass on `sheet`, a Sheet.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from softlab.cpu_backend.contact.colliders import collide_row
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import BLOCK, row_at
from softlab.cpu_backend.xpbd.forces import add_forces, force_features, has_forces
from softlab.cpu_backend.xpbd.layout import (
    P_ACCELERATION,
    P_ANCHORS,
    P_BEFORE,
    P_BLOCKS,
    P_CLASS,
    P_MAX_DISTANCE,
    P_PIN_COUNT,
    P_PINS,
    P_PLANE,
    P_STRIDE,
)
from softlab.cpu_backend.xpbd.rows import factor_of, finish, pin, predict
from softlab.model.base.types import Feature, Real
from softlab.model.base.variant import FEATURE, Open, routine, row_routine
from softlab.model.formulas.distance import tether, tethered
from softlab.model.formulas.lengths import squared_length, squared_length_3d
from softlab.model.tables.cloth import COLLIDER_KINDS

predict_uneven = Open("predict_uneven(...): `predict` of masses with weights")


class Sheet(NamedTuple):
    """Memory and places: xpbd/layout.py; constants; integers of random forces; `bodies`, `kinds`: the colliders;
    `row_places` (2 + families, rows): offsets of a row's weights, its valences, and the reciprocals of each family;
    `row_uneven` (rows,): true if a weight is not 1; `anchors`: flat, of each mass, by their index among the pins."""

    memory: np.ndarray
    places: np.ndarray
    parameters: np.record
    integers: np.ndarray
    bodies: np.ndarray
    kinds: np.ndarray
    row_places: np.ndarray
    row_uneven: np.ndarray
    anchors: np.ndarray


def keeps_velocity(parts: frozenset[str]) -> bool:
    """Return True if the position at the start of the substep needs its own planes.

    Colliders change velocities. In the Jacobi orderings a band computes the constraints that lead down to it when the
    band above may already have written velocities of its rows, which dampers along them must not read as positions.
    """
    dampers = any(part.endswith("-damping") for part in parts)
    return not parts.isdisjoint(COLLIDER_KINDS) or ("gauss-seidel" not in parts and dampers)


@row_routine
def pull_back(blocks, x, y, z, weights, anchor, max_distance, pin_x, pin_y, pin_z):
    for j in range(blocks * BLOCK):
        ax, ay = pin_x[anchor[j]], pin_y[anchor[j]]
        az = pin_z[anchor[j]] if FEATURE.axes == 3 else 0.0
        dx, dy = x[j] - ax, y[j] - ay
        dz = z[j] - az if FEATURE.axes == 3 else 0.0
        squared = squared_length(dx, dy) if FEATURE.axes == 2 else squared_length_3d(dx, dy, dz)
        factor = tether(squared, max_distance[j]) if weights[j] > 0.0 else 1.0
        x[j] = tethered(x[j], ax, dx, factor)
        y[j] = tethered(y[j], ay, dy, factor)
        if FEATURE.axes == 3:
            z[j] = tethered(z[j], az, dz, factor)


@routine
def attach_row(i, position, sheet):
    """Apply the attachments of row `i`."""
    memory, places, row_places, anchors = sheet.memory, sheet.places, sheet.row_places, sheet.anchors
    plane, pins = places[P_PLANE], places[P_PIN_COUNT]
    for c in range(FEATURE.classes):
        lane = c * places[P_CLASS]
        here = i * places[P_STRIDE] + lane
        for k in range(places[P_ANCHORS]):
            pull_back(
                places[P_BLOCKS], row_at(memory, position + here), row_at(memory, position + here + plane),
                row_at(memory, position + here + 2 * plane), row_at(memory, row_places[0, i] + lane),
                row_at(anchors, k * plane + here), row_at(memory, places[P_MAX_DISTANCE] + k * plane + here),
                row_at(memory, places[P_PINS]), row_at(memory, places[P_PINS] + pins),
                row_at(memory, places[P_PINS] + 2 * pins),
            )  # fmt: skip


@routine
def rows_of(i, axis, c, position, places):
    """Return the offsets of a class of row `i`: its positions, velocities, and positions before."""
    plane = places[P_PLANE]
    row = i * places[P_STRIDE] + c * places[P_CLASS] + axis * plane
    velocity = position + FEATURE.axes * plane if FEATURE.separate_before else FEATURE.axes * plane
    return position + row, velocity + row, places[P_BEFORE] + row


@routine
def begin_row(i, step, position, sheet):
    """Predict a row, in place.

    `position`: offset of the planes of positions, which with colliders are followed by those of velocities; otherwise
    both buffers of positions use one set of velocities.
    """
    memory, places, parameters, integers = sheet.memory, sheet.places, sheet.parameters, sheet.integers
    row_places, row_uneven = sheet.row_places, sheet.row_uneven
    factor = factor_of(parameters.keep, parameters.braking)
    if FEATURE.mass_forces:
        add_forces(i, step, memory, places, parameters, integers, row_places[0, i])
    for axis in range(FEATURE.axes):
        gravity = parameters.gravity if FEATURE.gravity and axis == 1 else 0.0
        for c in range(FEATURE.classes):
            p, v, before = rows_of(i, axis, c, position, places)
            acceleration = places[P_ACCELERATION] + p - position
            arguments = (
                places[P_BLOCKS], row_at(memory, p), row_at(memory, v), row_at(memory, before),
                row_at(memory, acceleration), gravity, row_at(memory, row_places[0, i] + c * places[P_CLASS]), factor,
                parameters.braking, parameters.dt,
            )  # fmt: skip
            if row_uneven[i]:
                predict_uneven(*arguments)
            else:
                predict(*arguments)


@routine
def end_iteration(i, position, sheet):
    if FEATURE.attachments:
        attach_row(i, position, sheet)


@routine
def touch_row(i, substep, position, sheet):
    """Apply the colliders to row `i`."""
    memory, places, parameters, bodies = sheet.memory, sheet.places, sheet.parameters, sheet.bodies
    kinds, row_places, row_uneven = sheet.kinds, sheet.row_places, sheet.row_uneven
    for c in range(FEATURE.classes):
        lane = i * places[P_STRIDE] + c * places[P_CLASS]
        collide_row(
            bodies, kinds, substep, parameters, places[P_BLOCKS], memory, places[P_BEFORE] + lane, places[P_PLANE],
            memory, position + lane, places[P_PLANE],
        )  # fmt: skip
        if row_uneven[i]:
            for axis in range(FEATURE.axes):
                p, v, before = rows_of(i, axis, c, position, places)
                pin(
                    places[P_BLOCKS], row_at(memory, p), row_at(memory, v), row_at(memory, before),
                    row_at(memory, row_places[0, i] + c * places[P_CLASS]),
                )  # fmt: skip


@routine
def end_row(i, substep, position, sheet):
    """Compute the velocity of row `i` and apply the colliders."""
    memory, places, parameters = sheet.memory, sheet.places, sheet.parameters
    for axis in range(FEATURE.axes):
        for c in range(FEATURE.classes):
            p, v, before = rows_of(i, axis, c, position, places)
            finish(
                places[P_BLOCKS],
                row_at(memory, p),
                row_at(memory, v),
                row_at(memory, before),
                parameters.inverse_substep,
            )
    if FEATURE.separate_before:
        touch_row(i, substep, position, sheet)


def sheet_features(parts: frozenset[str], axes: int, classes: int) -> dict[str, Feature]:
    """Return the features of the routines of a sheet's rows."""
    return force_features(parts, axes, classes) | {
        "separate_before": keeps_velocity(parts), "mass_forces": has_forces(parts), "uneven": False
    }  # fmt: skip


def walk_of(compiler: Compiler, real: Real, axes: int, parts: frozenset[str], classes: int) -> dict[str, Callable]:
    """Return what is open in `begin_row`."""
    uneven = compiler.variant_of(real, sheet_features(parts, axes, classes) | {"uneven": True})
    return {"predict_uneven": uneven(predict)}
