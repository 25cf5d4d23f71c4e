"""Operations on single particles of bodies on CPU threads: loops over blocks of LANES, in the layout of
shape_matching/kernels.py."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.contact.colliders import make_collide_mass, make_collide_planes
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import block_of, row_at
from softlab.cpu_backend.core.own_forces import make_particle_force
from softlab.cpu_backend.shape_matching.kernels import AXES
from softlab.model.base.types import Real
from softlab.model.formulas import distance
from softlab.model.formulas.shape_matching import rigid
from softlab.model.formulas.shape_matching.cluster import LANES


def make_particles(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make loops over blocks of particles: `begin`, `rate`, `collide`, `begin_rigid`, `store_impulses`.

    `begin`: predictions; `rate`: velocities, for rigid bodies from their travels
    (model/formulas/shape_matching/rigid.py). `travel`: three planes and one of slacks, read if bodies are rigid.
    `begin_rigid`: predictions of a rigid body that only matching moves, and their velocities. `store_impulses`: as `collide`,
    and writes the velocity changes into three planes `impulses`.
    """
    formulas = compiler.formulas(distance, real)
    kicked, damping_factor, predicted, rate_of = (
        formulas.kicked,
        formulas.damping_factor,
        formulas.predicted,
        formulas.rate,
    )
    touch, collide_planes = make_collide_mass(compiler, real, parts), make_collide_planes(compiler, real, parts)
    block = block_of(real)
    particle_force = make_particle_force(compiler, real, AXES, parts | {"load"})  # each particle has its own weight
    has_gravity, has_damping, no_step = "gravity" in parts, "damping" in parts, np.int64(0)
    has_spare, has_rigid, zero, one = "spare" in parts, "rigid-motion" in parts, real(0), real(1)
    keeping, there = compiler.formulas(rigid, real), np.int64(has_rigid)  # 0: an array passed instead of travels
    travelled, rate_over = keeping.travelled, keeping.rate_over

    def make_predict(rates: bool) -> Callable:
        """Make the prediction; with `rates` velocities become those of travels at once, which are then not stored."""

        def predict_rows(
            blocks, first, integers, parameters, weights, x, y, z, vx, vy, vz, to_x, to_y, to_z, over_x, over_y, over_z
        ):  # fmt: skip
            """Predict the blocks of particles; `first`: place of the first particle."""
            h = parameters.dt
            for block in range(blocks):
                for lane in range(LANES):
                    k = block * LANES + lane
                    weight = weights[k]
                    ax, ay, az = zero, zero, zero
                    if has_gravity:
                        ay = ay + parameters.gravity
                    ax, ay, az = particle_force((ax, ay, az), first + k, weight, parameters, integers, no_step)
                    factor = damping_factor(parameters.braking, weight) if has_damping else one
                    u, v, w = kicked(vx[k], factor, h, ax), kicked(vy[k], factor, h, ay), kicked(vz[k], factor, h, az)
                    px, py, pz = predicted(x[k], h, u), predicted(y[k], h, v), predicted(z[k], h, w)
                    if rates:
                        goes = not has_spare or weight > zero
                        vx[k] = rate_over(travelled(h, u), parameters.inverse_substep) if goes else zero
                        vy[k] = rate_over(travelled(h, v), parameters.inverse_substep) if goes else zero
                        vz[k] = rate_over(travelled(h, w), parameters.inverse_substep) if goes else zero
                    elif has_rigid:
                        over_x[k], over_y[k], over_z[k] = travelled(h, u), travelled(h, v), travelled(h, w)
                    to_x[k] = px if not has_spare or weight > zero else x[k]
                    to_y[k] = py if not has_spare or weight > zero else y[k]
                    to_z[k] = pz if not has_spare or weight > zero else z[k]

        predict_rows.__name__ = "predict_rates" if rates else "predict_rows"
        return compiler.row(predict_rows)

    predict_rows, predict_rates = make_predict(False), make_predict(True)

    @compiler.compiled
    def begin(first, last, count, before, after, velocity, weights, parameters, integers, travel):
        """Predict the particles from `first` to before `last`, of `count` of a plane."""
        predict_rows(
            (last - first) // LANES, first, integers, parameters, row_at(weights, first), row_at(before, first),
            row_at(before, count + first), row_at(before, 2 * count + first), row_at(velocity, first),
            row_at(velocity, count + first), row_at(velocity, 2 * count + first), row_at(after, first),
            row_at(after, count + first), row_at(after, 2 * count + first), row_at(travel, there * first),
            row_at(travel, there * (count + first)), row_at(travel, there * (2 * count + first)),
        )  # fmt: skip

    @compiler.compiled
    def begin_rigid(first, last, count, before, after, velocity, weights, parameters, integers):
        unused = row_at(weights, first)
        predict_rates(
            (last - first) // LANES, first, integers, parameters, row_at(weights, first), row_at(before, first),
            row_at(before, count + first), row_at(before, 2 * count + first), row_at(velocity, first),
            row_at(velocity, count + first), row_at(velocity, 2 * count + first), row_at(after, first),
            row_at(after, count + first), row_at(after, 2 * count + first), unused, unused, unused,
        )  # fmt: skip

    @compiler.row
    def rate_rows(
        blocks, parameters, weights, x, y, z, to_x, to_y, to_z, vx, vy, vz, over_x, over_y, over_z, slack
    ):  # fmt: skip
        inverse = parameters.inverse_substep
        for block in range(blocks):
            for lane in range(LANES):
                k = block * LANES + lane
                goes = not has_spare or weights[k] > zero
                vx[k] = rate_of(to_x[k], x[k], inverse) if goes else zero
                vy[k] = rate_of(to_y[k], y[k], inverse) if goes else zero
                vz[k] = rate_of(to_z[k], z[k], inverse) if goes else zero
                if has_rigid:
                    whole = goes and slack[k] > zero
                    vx[k] = rate_over(over_x[k], inverse) if whole else vx[k]
                    vy[k] = rate_over(over_y[k], inverse) if whole else vy[k]
                    vz[k] = rate_over(over_z[k], inverse) if whole else vz[k]

    @compiler.compiled
    def rate(first, last, count, before, after, velocity, weights, parameters, travel):
        rate_rows(
            (last - first) // LANES, parameters, row_at(weights, first), row_at(before, first), row_at(before, count + first),
            row_at(before, 2 * count + first), row_at(after, first), row_at(after, count + first),
            row_at(after, 2 * count + first), row_at(velocity, first), row_at(velocity, count + first),
            row_at(velocity, 2 * count + first), row_at(travel, there * first), row_at(travel, there * (count + first)),
            row_at(travel, there * (2 * count + first)), row_at(travel, there * (3 * count + first)),
        )  # fmt: skip

    @compiler.compiled
    def collide(first, last, number, before, after, velocity, weights, world):
        count = weights.size
        for k in range(first, last):
            if has_spare and weights[k] == zero:
                continue  # also skips ghosts
            (px, py, pz), (vx, vy, vz) = touch(
                world.bodies, world.kinds, number, world.parameters,
                (before[k], before[count + k], before[2 * count + k]), (after[k], after[count + k], after[2 * count + k]),
                (velocity[k], velocity[count + k], velocity[2 * count + k]),
            )  # fmt: skip
            after[k], after[count + k], after[2 * count + k] = px, py, pz
            velocity[k], velocity[count + k], velocity[2 * count + k] = vx, vy, vz

    @compiler.row
    def note_rows(n, vx, vy, vz, had_x, had_y, had_z):
        for k in range(n):
            had_x[k], had_y[k], had_z[k] = vx[k], vy[k], vz[k]

    @compiler.row
    def impulse_rows(n, vx, vy, vz, had_x, had_y, had_z):
        for k in range(n):
            had_x[k], had_y[k], had_z[k] = vx[k] - had_x[k], vy[k] - had_y[k], vz[k] - had_z[k]

    @compiler.compiled
    def store_impulses(first, last, number, before, after, velocity, weights, world, impulses):
        count = weights.size
        x, y, z = first, count + first, 2 * count + first
        vx, vy, vz = row_at(velocity, x), row_at(velocity, y), row_at(velocity, z)
        had_x, had_y, had_z = row_at(impulses, x), row_at(impulses, y), row_at(impulses, z)
        note_rows(last - first, vx, vy, vz, had_x, had_y, had_z)
        if has_spare:
            collide(first, last, number, before, after, velocity, weights, world)
        else:
            collide_planes(
                world.bodies, world.kinds, number, world.parameters, (last - first) // block, row_at(before, x),
                row_at(before, y), row_at(before, z), row_at(after, x), row_at(after, y), row_at(after, z), vx, vy, vz,
            )  # fmt: skip
        impulse_rows(last - first, vx, vy, vz, had_x, had_y, had_z)

    return SimpleNamespace(
        begin=begin, begin_rigid=begin_rigid, rate=rate, collide=collide, store_impulses=store_impulses
    )
