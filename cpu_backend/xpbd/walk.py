"""Operations of both orderings' kernels on a row before and after its constraints: prediction, attachments, velocity,
colliders.

All functions pass on `sheet`, a Sheet.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from softlab.cpu_backend.contact.colliders import make_collide_row
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import block_of, row_at
from softlab.cpu_backend.xpbd.forces import has_forces, make_forces
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
from softlab.cpu_backend.xpbd.rows import make_motion_rows
from softlab.model.base.types import Real
from softlab.model.formulas import distance, lengths
from softlab.model.tables.cloth import COLLIDER_KINDS


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


def make_attach_row(compiler: Compiler, real: Real, axes: int, parts: frozenset[str]) -> Callable:
    """Make attach_row(i, position, sheet): the attachments of row `i`."""
    formulas, block = compiler.formulas(distance, real), block_of(real)
    tether, tethered = formulas.tether, formulas.tethered
    squares = compiler.formulas(lengths, real)
    squared_length_2d, squared_length_3d = squares.squared_length, squares.squared_length_3d
    zero, one = real(0), real(1)

    @compiler.row
    def pull_back(blocks, x, y, z, weights, anchor, max_distance, pin_x, pin_y, pin_z):
        for j in range(blocks * block):
            ax, ay = pin_x[anchor[j]], pin_y[anchor[j]]
            az = pin_z[anchor[j]] if axes == 3 else zero
            dx, dy = x[j] - ax, y[j] - ay
            dz = z[j] - az if axes == 3 else zero
            squared = squared_length_2d(dx, dy) if axes == 2 else squared_length_3d(dx, dy, dz)
            factor = tether(squared, max_distance[j]) if weights[j] > zero else one
            x[j] = tethered(x[j], ax, dx, factor)
            y[j] = tethered(y[j], ay, dy, factor)
            if axes == 3:
                z[j] = tethered(z[j], az, dz, factor)

    @compiler.compiled
    def attach_row(i, classes, position, sheet):
        memory, places, row_places, anchors = sheet.memory, sheet.places, sheet.row_places, sheet.anchors
        plane, pins = places[P_PLANE], places[P_PIN_COUNT]
        for c in range(classes):
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

    return attach_row


def make_walk(compiler: Compiler, real: Real, axes: int, parts: frozenset[str], classes: int) -> SimpleNamespace:
    """Make `begin_row`, `end_iteration` and `end_row`.

    `begin_row(i, step, position, sheet)`: the row's prediction, in place; `position`: offset of the planes of
    positions, which with colliders are followed by those of velocities; otherwise velocities have one place for both
    buffers of positions. `end_iteration(i, position, sheet)`: attachments. `end_row(i, substep, position, sheet)`:
    velocity and colliders.
    """
    apart = keeps_velocity(parts)
    forces_differ, has_attachments = has_forces(parts), "attachments" in parts
    rows = make_motion_rows(compiler, real, parts, apart, forces_differ)
    predict, predict_uneven, factor_of = rows.predict, rows.predict_uneven, rows.factor_of
    finish, pin = rows.finish, rows.pin
    add_forces = make_forces(compiler, real, axes, parts, classes)
    attach_row = make_attach_row(compiler, real, axes, parts)
    collide_row = make_collide_row(compiler, real, parts)
    zero, has_gravity = real(0), "gravity" in parts

    @compiler.compiled
    def rows_of(i, axis, c, position, places):
        """Return the offsets of a class of row `i`: its positions, velocities, and positions before."""
        plane = places[P_PLANE]
        row = i * places[P_STRIDE] + c * places[P_CLASS] + axis * plane
        velocity = position + axes * plane if apart else axes * plane
        return position + row, velocity + row, places[P_BEFORE] + row

    @compiler.compiled
    def begin_row(i, step, position, sheet):
        memory, places, parameters, integers = sheet.memory, sheet.places, sheet.parameters, sheet.integers
        row_places, row_uneven = sheet.row_places, sheet.row_uneven
        factor = factor_of(parameters.keep, parameters.braking)
        if forces_differ:
            add_forces(i, step, memory, places, parameters, integers, row_places[0, i])
        for axis in range(axes):
            gravity = parameters.gravity if has_gravity and axis == 1 else zero
            for c in range(classes):
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

    @compiler.compiled
    def end_iteration(i, position, sheet):
        if has_attachments:
            attach_row(i, classes, position, sheet)

    @compiler.compiled
    def touch_row(i, substep, position, sheet):
        memory, places, parameters, bodies = sheet.memory, sheet.places, sheet.parameters, sheet.bodies
        kinds, row_places, row_uneven = sheet.kinds, sheet.row_places, sheet.row_uneven
        for c in range(classes):
            lane = i * places[P_STRIDE] + c * places[P_CLASS]
            collide_row(
                bodies, kinds, substep, parameters, places[P_BLOCKS], memory, places[P_BEFORE] + lane, places[P_PLANE],
                memory, position + lane, places[P_PLANE],
            )  # fmt: skip
            if row_uneven[i]:
                for axis in range(axes):
                    p, v, before = rows_of(i, axis, c, position, places)
                    pin(
                        places[P_BLOCKS], row_at(memory, p), row_at(memory, v), row_at(memory, before),
                        row_at(memory, row_places[0, i] + c * places[P_CLASS]),
                    )  # fmt: skip

    @compiler.compiled
    def end_row(i, substep, position, sheet):
        memory, places, parameters = sheet.memory, sheet.places, sheet.parameters
        for axis in range(axes):
            for c in range(classes):
                p, v, before = rows_of(i, axis, c, position, places)
                finish(
                    places[P_BLOCKS],
                    row_at(memory, p),
                    row_at(memory, v),
                    row_at(memory, before),
                    parameters.inverse_substep,
                )
        if apart:
            touch_row(i, substep, position, sheet)

    return SimpleNamespace(begin_row=begin_row, end_iteration=end_iteration, end_row=end_row)
