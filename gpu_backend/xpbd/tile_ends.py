"""Transfers of a tile's masses and multipliers to and from a block, as device functions.

A thread processes the same masses of the tile throughout. A block only writes the masses that it owns; it also reads
the halo.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.motion import make_motion
from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.gpu_backend.core.world import Cell
from softlab.gpu_backend.position_based.constraints import KINDS, compliant, dampers
from softlab.gpu_backend.position_based.gather import make_gather
from softlab.gpu_backend.position_based.point import make_accelerations, make_tethers
from softlab.gpu_backend.xpbd.sweep import colour_slots, make_constraint_place, make_lattice, masses_each
from softlab.gpu_backend.xpbd.tile import SheetTile
from softlab.model.base.types import Real
from softlab.model.position_based.plan import colour_order, families


def _make_places(math: str, tile: SheetTile) -> tuple[Callable, Callable]:
    """Make `mass` and `owned`, for number `slot` of a thread's masses."""
    spot, pitch = make_lattice(math, tile.rows.size, tile.columns.size, False), np.int32(tile.pitch)
    masses, threads = np.int32(tile.rows.size * tile.columns.size), np.int32(tile.threads)
    first_row, first_column = np.int32(tile.rows.before), np.int32(tile.columns.before)
    end_row, end_column = np.int32(first_row + tile.rows.owned), np.int32(first_column + tile.columns.owned)
    inline = inlined(math)

    @inline
    def mass(slot, origin, rows, columns):
        """Return (true if it is on the sheet, its index in the tile, its number, i, j) in the sheet."""
        item = np.int32(cuda.threadIdx.x + slot * threads)
        i, j = spot(item)
        row, column = np.int32(origin[0] + i), np.int32(origin[1] + j)
        there = item < masses and row >= 0 and row < rows and column >= 0 and column < columns
        return there, np.int32(i * pitch + j), np.int32(row * columns + column), row, column

    @inline
    def owned(slot, origin, rows, columns):
        """Return (true if the block owns it, its index in the tile, its number)."""
        there, here, k, row, column = mass(slot, origin, rows, columns)
        i, j = np.int32(row - origin[0]), np.int32(column - origin[1])
        inside = i >= first_row and i < end_row and j >= first_column and j < end_column
        return there and inside, here, k

    return mass, owned


class Tethers(NamedTuple):
    """Long-range attachments: positions at the substep's start, with weights; anchors and maximum distances [m] of each
    mass, flat; their number per mass."""

    state: np.ndarray
    anchors: np.ndarray
    reaches: np.ndarray
    count: int


@cache
def make_tile_ends(real: Real, math: str, parts: frozenset[str], axes: int, tile: SheetTile) -> SimpleNamespace:
    """Make the transfers of a tile to and from shared memory; `origin` is the position of its first mass in the sheet.

    - `open_substep`: predicts from the state; `load`: reads the results of the previous launch;
    - `attach`: the long-range attachments; `store`: writes owned masses for the next launch;
    - `close_substep`: velocities and colliders of owned masses, into the new state.
    """
    accelerate = make_accelerations(real, math, parts).accelerate
    motion, tether_mass = make_motion(real, math, parts, axes), make_tethers(real, math)
    predict, settle = motion.predict, motion.settle
    jacobi = make_gather(real, math, parts, axes)
    valence_of, weight_of, has_valences = jacobi.valence_of, jacobi.weight_of, "gauss-seidel" not in parts
    (mass, owned), each = _make_places(math, tile), masses_each(tile)
    damped, tethered, zero, inline = dampers(parts), "attachments" in parts, real(0), inlined(math)

    @inline
    def open_substep(position, velocity, shared, before, origin, world, step, air, rows, columns):
        parameters = world.parameters
        for slot in range(each):
            there, here, k, i, j = mass(slot, origin, rows, columns)
            if there:
                p, v = load_quad(position, k), load_quad(velocity, k)
                ax, ay, az = accelerate(
                    position, velocity, k, Cell(i, j, rows, columns), p, v, parameters, world.integers, step, air
                )
                x, y, z = predict(p, v, ax, ay, az, parameters)
                spare = p[3]
                if has_valences:
                    spare = weight_of(valence_of(Cell(i, j, rows, columns)), spare)
                store_quad(shared, here, x, y, z, spare)
                if damped:
                    store_quad(before, here, p[0], p[1], p[2], p[3])
        cuda.syncthreads()

    @inline
    def load(source, state, shared, before, origin, rows, columns):
        for slot in range(each):
            there, here, k, _, _ = mass(slot, origin, rows, columns)
            if there:
                p = load_quad(source, k)
                store_quad(shared, here, p[0], p[1], p[2], p[3])
                if damped:
                    b = load_quad(state, k)
                    store_quad(before, here, b[0], b[1], b[2], b[3])
        cuda.syncthreads()

    @inline
    def attach(shared, old, tethers, origin, rows, columns):
        if tethered:
            state, anchors, reaches, count = tethers
            for slot in range(each):
                there, here, k, _, _ = mass(slot, origin, rows, columns)
                if there:
                    p = load_quad(shared, old + here)
                    weight = load_quad(state, k)[3]
                    x, y, z = tether_mass(p, weight, state, anchors, reaches, np.int64(k) * count, count)
                    store_quad(shared, old + here, x, y, z, p[3])
            cuda.syncthreads()

    @inline
    def store(shared, old, target, origin, rows, columns):
        for slot in range(each):
            is_owned, here, k = owned(slot, origin, rows, columns)
            if is_owned:
                p = load_quad(shared, old + here)
                store_quad(target, k, p[0], p[1], p[2], p[3])

    @inline
    def close_substep(shared, old, state, target, velocity, origin, world, number, rows, columns):
        for slot in range(each):
            is_owned, here, k = owned(slot, origin, rows, columns)
            if is_owned:
                b = load_quad(state, k)
                px, py, pz, vx, vy, vz = settle(b, load_quad(shared, old + here), world, number)
                store_quad(target, k, px, py, pz, b[3])
                store_quad(velocity, k, vx, vy, vz, zero)

    return SimpleNamespace(
        open_substep=open_substep, load=load, attach=attach, store=store, close_substep=close_substep
    )  # fmt: skip


@cache
def make_multiplier_moves(real: Real, math: str, parts: frozenset[str], axes: int, tile: SheetTile) -> SimpleNamespace:
    """Make `fetch(multipliers, planes, origin, rows, columns)` and `leave(...)`.

    `fetch`: a thread's multipliers from the planes of the previous launch, including the halo; `leave`: those of owned
    constraints, by their first mass, into the planes.
    """
    inline = inlined(math)
    if "gauss-seidel" not in parts:
        return _jacobi_moves(math, parts, tile)
    moves: list[tuple[Any, Any]] = []
    slot = 0
    plane_of = {family: n for n, family in enumerate(f for f in families(parts) if compliant(parts, f))}
    for family, colour in colour_order(parts):
        if family in plane_of:
            moves.append(_colour_moves(math, tile, family, colour, slot, plane_of[family]))
            slot += colour_slots(tile, family)

    def run_all(functions: list[Any]) -> Callable:
        if not functions:

            @inline
            def nothing(multipliers, planes, origin, rows, columns):
                pass

            return nothing
        head, rest = functions[0], run_all(functions[1:])

        @inline
        def both(multipliers, planes, origin, rows, columns):
            head(multipliers, planes, origin, rows, columns)
            rest(multipliers, planes, origin, rows, columns)

        return both

    return SimpleNamespace(fetch=run_all([f for f, _ in moves]), leave=run_all([s for _, s in moves]))


def _colour_moves(
    math: str, tile: SheetTile, family: Any, colour: int, first_slot: int, plane: int
) -> tuple[Callable, Callable]:
    """Make fetch and leave of one colour."""
    constraint_place, slots = make_constraint_place(math, tile, family, colour), colour_slots(tile, family)
    down, along = np.int32(family.rows), np.int32(abs(family.columns))
    lead = np.int32(1 if family.columns < 0 else 0)  # on a rising diagonal the first mass is to the right of (i, j)
    most_rows, most_columns = np.int32(tile.rows.size), np.int32(tile.columns.size)
    first_row, first_column = np.int32(tile.rows.before), np.int32(tile.columns.before)
    end_row, end_column = np.int32(first_row + tile.rows.owned), np.int32(first_column + tile.columns.owned)
    inline = inlined(math)

    @inline
    def place_of(slot, origin, rows, columns):
        """Return (true if it is in sheet and tile, true if the block owns it, its number in the planes)."""
        there, i, j = constraint_place(slot)
        row, column = np.int32(origin[0] + i), np.int32(origin[1] + j)
        there = there and row >= 0 and column >= 0 and row + down < rows and column + along < columns
        there = there and i + down < most_rows and j + along < most_columns
        is_owned = i >= first_row and i < end_row and j + lead >= first_column and j + lead < end_column
        return there, there and is_owned, np.int64(plane) * rows * columns + np.int32(row * columns + column)

    @inline
    def fetch(multipliers, planes, origin, rows, columns):
        for slot in range(slots):
            there, _, at = place_of(slot, origin, rows, columns)
            if there:
                multipliers[first_slot + slot] = planes[at]

    @inline
    def leave(multipliers, planes, origin, rows, columns):
        for slot in range(slots):
            _, is_owned, at = place_of(slot, origin, rows, columns)
            if is_owned:
                planes[at] = multipliers[first_slot + slot]

    return fetch, leave


def _jacobi_moves(math: str, parts: frozenset[str], tile: SheetTile) -> SimpleNamespace:
    (mass, owned), each = _make_places(math, tile), masses_each(tile)
    slots = 4 * sum(f"{kind}-compliance" in parts for kind in KINDS)
    inline = inlined(math)

    @inline
    def fetch(multipliers, planes, origin, rows, columns):
        for slot in range(each):
            there, _, k, _, _ = mass(slot, origin, rows, columns)
            if there:
                for n in range(slots):
                    multipliers[slot * slots + n] = planes[np.int64(n) * rows * columns + k]

    @inline
    def leave(multipliers, planes, origin, rows, columns):
        for slot in range(each):
            is_owned, _, k = owned(slot, origin, rows, columns)
            if is_owned:
                for n in range(slots):
                    planes[np.int64(n) * rows * columns + k] = multipliers[slot * slots + n]

    return SimpleNamespace(fetch=fetch, leave=leave)
