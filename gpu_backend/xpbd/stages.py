"""The stages of a position-based solver's plan as CUDA kernels, each over the whole sheet and with separate arrays:
slow, but easy to read, to time and to test against the fused kernels. In all, `a` is the acceleration (quads)."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.motion import make_motion
from softlab.gpu_backend.core.compile import kernel_options, make_kernels, variant_name
from softlab.gpu_backend.core.forces import bind_forces
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.wind import make_block_air
from softlab.gpu_backend.core.world import Cell, World
from softlab.gpu_backend.xpbd.gather import make_gather
from softlab.gpu_backend.xpbd.point import make_accelerations
from softlab.model.core.plan import Moment, StageRun
from softlab.model.xpbd.plan import JACOBI, colour_order


@cache
def make_xpbd_stages(real: Any, math: str, parts: frozenset[str], axes: int) -> SimpleNamespace:
    """Compile the stages of single masses: wind, prediction, velocity, colliders. core/forces.py has other forces."""
    forces, motion = make_accelerations(real, math, parts), make_motion(real, math, parts, axes)
    add_wind = forces.add_wind
    predict_mass, rate_of, collide_mass = motion.predict, motion.rate_of, motion.collide
    jacobi, block_air = make_gather(real, math, parts, axes), make_block_air(real, math, parts)
    valence_of, share_of, has_shares = jacobi.valence_of, jacobi.share_of, bool(parts & JACOBI)
    zero = real(0)

    def wind(position, velocity, record, integers, number, a, rows, columns):
        parameters = record[0]
        air = block_air(parameters, integers, number, zero)
        k = np.int32(cuda.grid(1))
        if k < a.size // SIZE:
            rows, columns = np.int32(rows), np.int32(columns)
            i, j = np.int32(k // columns), np.int32(k % columns)
            p, v, b = load_quad(position, k), load_quad(velocity, k), load_quad(a, k)
            ax, ay, az = add_wind(
                b[0], b[1], b[2], position, velocity, k, Cell(i, j, rows, columns), p, v, parameters, air
            )  # fmt: skip
            store_quad(a, k, ax, ay, az, zero)

    def predict(before, velocity, a, position, record, rows, columns):
        """Predict positions; `a` is set to 0, for the next substep's forces."""
        parameters = record[0]
        k = np.int32(cuda.grid(1))
        if k < a.size // SIZE:
            rows, columns = np.int32(rows), np.int32(columns)
            p, b = load_quad(before, k), load_quad(a, k)
            x, y, z = predict_mass(p, load_quad(velocity, k), b[0], b[1], b[2], parameters)
            spare = p[3]
            if has_shares:
                spare = share_of(valence_of(Cell(np.int32(k // columns), np.int32(k % columns), rows, columns)), spare)
            store_quad(position, k, x, y, z, spare)
            store_quad(a, k, zero, zero, zero, zero)

    def update_velocity(before, position, velocity, record):
        parameters = record[0]
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            b, p = load_quad(before, k), load_quad(position, k)
            vx, vy, vz = rate_of(p, b, parameters)
            store_quad(position, k, p[0], p[1], p[2], b[3])
            store_quad(velocity, k, vx, vy, vz, zero)

    def collide(before, position, velocity, record, bodies, integers, number):
        world = World(record[0], bodies, integers)
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            b, p, v = load_quad(before, k), load_quad(position, k), load_quad(velocity, k)
            px, py, pz, vx, vy, vz = collide_mass(b, p, v[0], v[1], v[2], world, number)
            store_quad(position, k, px, py, pz, p[3])
            store_quad(velocity, k, vx, vy, vz, zero)

    variant = f"xpbd_{variant_name(real, math, axes, parts)}"
    return make_kernels((wind, predict, update_velocity, collide), variant, **kernel_options(math))


def bind_xpbd_stages(sim: Any) -> dict[str, StageRun]:
    """Return the function of each named stage of `sim`, a gpu_backend.xpbd.solver.PositionBased. The state stays in its
    buffer; the positions at the start of a substep are copied."""
    axes, parts = sim.scene.dimensions, sim.plan.parts
    stage, flat = make_xpbd_stages(sim.real, sim.options.math, parts, axes), sim._flat
    position, velocity, record, integers = sim.position[0], sim.velocity[0], sim.record, sim.integers
    a, before = sim.new_array(), sim.new_array()

    def predict(moment: Moment) -> None:
        before.copy_to_device(position, stream=sim.stream)
        stage.predict[flat](before, velocity, a, position, record, *sim.shape)

    def project(entry: int) -> StageRun:
        return lambda moment: sim.project_colour(entry, before, position, moment.fresh)

    def project_all(moment: Moment) -> None:
        sim.project_all(before, position, sim.scratch, moment.fresh)
        position.copy_to_device(sim.scratch, stream=sim.stream)

    def move(moment: Moment) -> None:
        sim.matching.move(position, sim.scratch, record)
        position.copy_to_device(sim.scratch, stream=sim.stream)

    def wind(moment: Moment) -> None:
        stage.wind[flat](position, velocity, record, integers, np.int64(moment.number), a, *sim.shape)

    def update_velocity(moment: Moment) -> None:
        stage.update_velocity[flat](before, position, velocity, record)

    def collide(moment: Moment) -> None:
        stage.collide[flat](before, position, velocity, record, sim.bodies, integers, np.int64(moment.number))

    colours = {
        f"project {family.name} {colour}": project(entry) for entry, (family, colour) in enumerate(colour_order(parts))
    }
    return (
        colours
        | bind_forces(sim, parts, position, a)
        | {
            "wind": wind,
            "predict": predict,
            "project all": project_all,
            "match clusters": lambda moment: sim.matching.match(position),
            "move to goals": move,
            "find contacts": lambda moment: sim.contacts.find(before, position),
            "project contacts": lambda moment: sim.contacts.project(before, position),
            "attachments": lambda moment: sim.attach(before, position),
            "update velocity": update_velocity,
            "collide": collide,
        }
    )
