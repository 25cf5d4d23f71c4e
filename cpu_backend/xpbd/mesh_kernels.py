"""One vertex or one constraint of a mesh at a time, and the loops over many: for CPU threads.

A mass is a row of four numbers: x, y, z and its weight in the positions. Of a colour no two constraints share a mass, so that
threads take any part of it: the state's bits depend on neither their number nor their order.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from cpu_backend.contact.colliders import make_collide_mass
from cpu_backend.core.compile import Compiler
from cpu_backend.core.progress import shares
from cpu_backend.mass_spring.cloth.scratch import cloth_variant
from cpu_backend.mass_spring.cloth.wind import make_air, make_triangle
from cpu_backend.xpbd.mesh_projections import make_projection
from model.formulas import distance, random
from model.mass_spring.cloth_parameters import C_DRAG, C_DT, C_EXTERNAL, C_GRAVITY, C_LIFT, C_POKE_X
from model.scene.cloth import COLLIDER_KINDS
from model.xpbd.parameters import X_DRAG, X_INVERSE_SUBSTEP

AXES = 3


ALONE = 256  # constraints of a colour that one thread does sooner than threads come together: some microseconds
ALWAYS = {"gauss-seidel", "load", "pins"}  # parts that change no code: every mass has its weight, 0 where it is pinned


def make_begin(compiler: Compiler, real: Any, parts: frozenset[str]) -> Any:
    """begin(first, last, step, substep, before, velocity, position, record, integers, wind_lists): predicted positions of the
    masses `first` to before `last`; `wind_lists`: (offsets, triangles at each vertex, corners of triangles)."""
    compiled = compiler.compiled
    formulas = distance.make(real, compiled)
    kicked, kept, predicted, added = formulas.kicked, formulas.kept, formulas.predicted, formulas.added
    philox, add_external = random.make_philox(compiled), random.make(real, compiled).add_external
    triangle, air_now = make_triangle(compiler, real), make_air(compiler, real, parts)
    has_gravity, has_wind, has_external = "gravity" in parts, "wind" in parts, "external" in parts
    has_poke, has_damping = "poke" in parts, "damping" in parts
    zero, one = real(0), real(1)

    @compiled
    def row(array, k):
        return array[k, 0], array[k, 1], array[k, 2]

    @compiled
    def wind_of(k, air, before, velocity, record, wind_lists):
        """Over the sheet's mass, of the triangles at the vertex in their order."""
        offsets, at_vertex, corners = wind_lists
        x, y, z = zero, zero, zero
        for n in range(offsets[k], offsets[k + 1]):
            a, b, c = corners[at_vertex[n], 0], corners[at_vertex[n], 1], corners[at_vertex[n], 2]
            fx, fy, fz = triangle(
                row(before, a), row(before, b), row(before, c), row(velocity, a), row(velocity, b), row(velocity, c), air,
                record[C_DRAG], record[C_LIFT],
            )  # fmt: skip
            x, y, z = x + fx, y + fy, z + fz
        return x, y, z

    @compiled
    def begin(first, last, step, substep, before, velocity, position, record, integers, wind_lists):
        h = record[C_DT]
        air = air_now(record, integers, substep, zero) if has_wind else (zero, zero, zero)
        for k in range(first, last):
            w = before[k, 3]
            if w == zero:
                continue
            ax, ay, az = zero, zero, zero
            if has_gravity:
                ay = ay + record[C_GRAVITY]
            if has_wind:
                fx, fy, fz = wind_of(k, air, before, velocity, record, wind_lists)
                ax, ay, az = added(ax, w, fx), added(ay, w, fy), added(az, w, fz)
            if has_external:
                words, most = philox(integers[0], np.uint64(step), np.uint64(k)), record[C_EXTERNAL]
                ax = added(ax, w, add_external(zero, most, words[0]))
                ay = added(ay, w, add_external(zero, most, words[1]))
                az = added(az, w, add_external(zero, most, words[2]))
            if has_poke and np.int64(integers[1]) == k + 1:
                ax = added(ax, w, record[C_POKE_X])
                ay = added(ay, w, record[C_POKE_X + 1])
                az = added(az, w, record[C_POKE_X + 2])
            keep = kept(record[X_DRAG], w) if has_damping else one
            position[k, 0] = predicted(before[k, 0], h, kicked(velocity[k, 0], keep, h, ax))
            position[k, 1] = predicted(before[k, 1], h, kicked(velocity[k, 1], keep, h, ay))
            position[k, 2] = predicted(before[k, 2], h, kicked(velocity[k, 2], keep, h, az))

    return begin


def make_attach(compiler: Compiler, real: Any) -> Any:
    """attach(first, last, position, anchors, reaches): the long-range attachments of masses, `anchors` and `reaches`
    (vertices, count)."""
    formulas = distance.make(real, compiler.compiled)
    tether, tethered, squared_length = formulas.tether, formulas.tethered, formulas.squared_length_3d
    zero = real(0)

    @compiler.compiled
    def attach(first, last, position, anchors, reaches):
        for k in range(first, last):
            if position[k, 3] == zero:
                continue
            for n in range(anchors.shape[1]):
                a = anchors[k, n]
                dx, dy = position[k, 0] - position[a, 0], position[k, 1] - position[a, 1]
                dz = position[k, 2] - position[a, 2]
                factor = tether(squared_length(dx, dy, dz), reaches[k, n])
                position[k, 0] = tethered(position[k, 0], position[a, 0], dx, factor)
                position[k, 1] = tethered(position[k, 1], position[a, 1], dy, factor)
                position[k, 2] = tethered(position[k, 2], position[a, 2], dz, factor)

    return attach


def make_end(compiler: Compiler, real: Any, parts: frozenset[str]) -> SimpleNamespace:
    """`update(first, last, before, position, velocity, record)`: velocities of the substep;
    `collide(first, last, substep, before, position, velocity, record, bodies, kinds)`: what masses meet."""
    rate = distance.make(real, compiler.compiled).rate
    touch = make_collide_mass(compiler, real, parts)
    zero = real(0)

    @compiler.compiled
    def update(first, last, before, position, velocity, record):
        for k in range(first, last):
            for axis in range(AXES):
                v = rate(position[k, axis], before[k, axis], record[X_INVERSE_SUBSTEP])
                velocity[k, axis] = v if before[k, 3] > zero else zero

    @compiler.compiled
    def collide(first, last, substep, before, position, velocity, record, bodies, kinds):
        for k in range(first, last):
            if before[k, 3] == zero:
                continue
            px, py, pz, vx, vy, vz = touch(
                bodies, kinds, substep, record, before[k, 0], before[k, 1], before[k, 2], position[k, 0],
                position[k, 1], position[k, 2], velocity[k, 0], velocity[k, 1], velocity[k, 2],
            )  # fmt: skip
            position[k, 0] = px
            position[k, 1] = py
            position[k, 2] = pz
            velocity[k, 0] = vx
            velocity[k, 1] = vy
            velocity[k, 2] = vz

    return SimpleNamespace(update=update, collide=collide)


def make_functions(compiler: Compiler, real: Any, parts: frozenset[str]) -> SimpleNamespace:
    """All loops over a part of the masses or of a colour."""
    ends = make_end(compiler, real, parts)
    return SimpleNamespace(
        begin=make_begin(compiler, real, parts), attach=make_attach(compiler, real), update=ends.update,
        collide=ends.collide, edges=make_projection(compiler, real, parts, "structural"),
        bends=make_projection(compiler, real, parts, "bending"),
    )  # fmt: skip


@cache
def make_mesh_stages(real: Any, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """The stages, a parallel loop each; all but `predict` as in the functions that they call, with the number of `bands`
    that a loop falls into instead of its bounds (and a colour's bounds before)."""
    compiler = Compiler(cloth_variant("mesh_stages", real, math, parts), math)
    made = make_functions(compiler, real, parts)
    begin, attach_some, update_some, collide_some = made.begin, made.attach, made.update, made.collide
    edges_some, bends_some = made.edges, made.bends

    def predict(team, member, bands, step, substep, position, velocity, before, record, integers, wind_lists):
        count = len(position)
        for band in shares(team, member, bands):
            for k in range(count * band // bands, count * (band + 1) // bands):
                for axis in range(position.shape[1]):
                    before[k, axis] = position[k, axis]
        for band in shares(team, member, bands):
            first, last = count * band // bands, count * (band + 1) // bands
            begin(first, last, step, substep, before, velocity, position, record, integers, wind_lists)

    def edges(band, bands, start, stop, position, before, corners, values, multipliers, fresh, record):
        first, last = start + (stop - start) * band // bands, start + (stop - start) * (band + 1) // bands
        edges_some(first, last, position, before, corners, values, multipliers, fresh, record)

    def bends(band, bands, start, stop, position, before, corners, values, multipliers, fresh, record):
        first, last = start + (stop - start) * band // bands, start + (stop - start) * (band + 1) // bands
        bends_some(first, last, position, before, corners, values, multipliers, fresh, record)

    def attach(band, bands, position, anchors, reaches):
        count = len(position)
        attach_some(count * band // bands, count * (band + 1) // bands, position, anchors, reaches)

    def update(band, bands, before, position, velocity, record):
        count = len(position)
        update_some(count * band // bands, count * (band + 1) // bands, before, position, velocity, record)

    def collide(band, bands, substep, before, position, velocity, record, bodies, kinds):
        count = len(position)
        first, last = count * band // bands, count * (band + 1) // bands
        collide_some(first, last, substep, before, position, velocity, record, bodies, kinds)

    found = {f.__name__: compiler.banded(f) for f in (edges, bends, attach, update, collide)}
    return SimpleNamespace(predict=compiler.team(predict), **found)


@cache
def make_mesh_advance(real: Any, math: str, parts: frozenset[str]) -> Any:
    """advance(bands, steps, step, substeps, iterations, position, velocity, before, record, integers, wind_lists,
    edge_family, bend_family, anchors, reaches, bodies, kinds): many steps in one call; a family: (corners, values,
    multipliers, starts)."""
    compiler = Compiler(cloth_variant("mesh", real, math, parts), math)
    made = make_functions(compiler, real, parts)
    begin, attach, update, collide = made.begin, made.attach, made.update, made.collide
    edges, bends = made.edges, made.bends
    has_edges, has_bends = "structural" in parts, "bending" in parts
    has_attachments, has_bodies = "attachments" in parts, bool(parts & set(COLLIDER_KINDS))

    def advance(
        team, member, bands, steps, step, substeps, iterations, position, velocity, before, record, integers, wind_lists,
        edge_family, bend_family, anchors, reaches, bodies, kinds,
    ):  # fmt: skip
        count = len(position)
        edge_corners, edge_values, edge_multipliers, edge_starts = edge_family
        bend_corners, bend_values, bend_multipliers, bend_starts = bend_family
        for pass_number in range(steps * substeps):
            number = step * substeps + pass_number
            frame = step + pass_number // substeps
            for band in shares(team, member, bands):
                for k in range(count * band // bands, count * (band + 1) // bands):
                    for axis in range(position.shape[1]):
                        before[k, axis] = position[k, axis]
            for band in shares(team, member, bands):
                first, last = count * band // bands, count * (band + 1) // bands
                begin(first, last, frame, number, before, velocity, position, record, integers, wind_lists)
            for iteration in range(iterations):
                fresh = iteration == 0
                if has_edges:
                    for colour in range(len(edge_starts) - 1):
                        start, many = np.int64(edge_starts[colour]), edge_starts[colour + 1] - edge_starts[colour]
                        parts = bands if many >= ALONE else 1
                        for band in shares(team, member, parts):
                            edges(
                                start + many * band // parts, start + many * (band + 1) // parts, position, before,
                                edge_corners, edge_values, edge_multipliers, fresh, record,
                            )  # fmt: skip
                if has_bends:
                    for colour in range(len(bend_starts) - 1):
                        start, many = np.int64(bend_starts[colour]), bend_starts[colour + 1] - bend_starts[colour]
                        parts = bands if many >= ALONE else 1
                        for band in shares(team, member, parts):
                            bends(
                                start + many * band // parts, start + many * (band + 1) // parts, position, before,
                                bend_corners, bend_values, bend_multipliers, fresh, record,
                            )  # fmt: skip
                if has_attachments:
                    for band in shares(team, member, bands):
                        attach(count * band // bands, count * (band + 1) // bands, position, anchors, reaches)
            for band in shares(team, member, bands):
                first, last = count * band // bands, count * (band + 1) // bands
                update(first, last, before, position, velocity, record)
                if has_bodies:
                    collide(first, last, number, before, position, velocity, record, bodies, kinds)

    return compiler.team(advance)
