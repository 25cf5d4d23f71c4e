"""The stages of a cloth's plan as CUDA kernels, one thread per mass, each over the whole sheet.

Each stage has separate input and output arrays: slow, but easy to read, to time and to test against the fused passes.
In all, `a` is the acceleration (quads), and a thread processes one mass.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.colliders import collide as collide_point
from softlab.gpu_backend.contact.pins import pin
from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.forces import bind_forces
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.wind import block_air, wind_sum
from softlab.gpu_backend.core.world import Cell, World
from softlab.gpu_backend.mass_spring.cloth.point import cloth_features, damp, of_scene, spring_sum
from softlab.gpu_backend.mass_spring.passes import QuadPasses
from softlab.model.base.types import Real
from softlab.model.base.variant import routine
from softlab.model.core.plan import Moment, StageRun
from softlab.model.formulas.integrators import one_force, rk4_stage, verlet_first_half, verlet_second_half


@routine
def spring_forces(position, velocity, record, a, rows, columns):
    parameters = record[0]
    k = np.int32(cuda.grid(1))
    if k < a.size // SIZE:
        rows, columns = np.int32(rows), np.int32(columns)
        i, j = np.int32(k // columns), np.int32(k % columns)
        p, v = load_quad(position, k), load_quad(velocity, k)
        ax, ay, az = spring_sum(position, velocity, k, Cell(i, j, rows, columns), p, v, parameters)
        store_quad(a, k, ax, ay, az, 0.0)


@routine
def no_forces(a):
    k = np.int32(cuda.grid(1))
    if k < a.size // SIZE:
        store_quad(a, k, 0.0, 0.0, 0.0, 0.0)


@routine
def wind(position, velocity, record, integers, step, offset, a, rows, columns):
    parameters = record[0]
    air = block_air(parameters, integers, step, offset)
    k = np.int32(cuda.grid(1))
    if k < a.size // SIZE:
        rows, columns = np.int32(rows), np.int32(columns)
        i, j = np.int32(k // columns), np.int32(k % columns)
        p, v, b = load_quad(position, k), load_quad(velocity, k), load_quad(a, k)
        x, y, z = wind_sum(position, velocity, k, Cell(i, j, rows, columns), p, v, parameters, air)
        store_quad(a, k, b[0] + x, b[1] + y, b[2] + z, 0.0)


@routine
def damping(velocity, record, a):
    parameters = record[0]
    k = np.int32(cuda.grid(1))
    if k < a.size // SIZE:
        b = load_quad(a, k)
        ax, ay, az = damp(b[0], b[1], b[2], load_quad(velocity, k), parameters)
        store_quad(a, k, ax, ay, az, 0.0)


@routine
def integrate(position, velocity, a, record):
    parameters = record[0]
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        p, v, b = load_quad(position, k), load_quad(velocity, k), load_quad(a, k)
        dt, half_dt_squared = parameters.dt, parameters.half_dt_squared
        px, vx = one_force(p[0], v[0], b[0], dt, half_dt_squared)
        py, vy = one_force(p[1], v[1], b[1], dt, half_dt_squared)
        pz, vz = one_force(p[2], v[2], b[2], dt, half_dt_squared)
        store_quad(position, k, px, py, pz, p[3])
        store_quad(velocity, k, vx, vy, vz, 0.0)


@routine
def first_kick(position, velocity, a, record):
    parameters = record[0]
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        p, v, b = load_quad(position, k), load_quad(velocity, k), load_quad(a, k)
        dt, half_dt, rate = parameters.dt, parameters.half_dt, parameters.damping
        px, vx = verlet_first_half(p[0], v[0], b[0], dt, half_dt, rate)
        py, vy = verlet_first_half(p[1], v[1], b[1], dt, half_dt, rate)
        pz, vz = verlet_first_half(p[2], v[2], b[2], dt, half_dt, rate)
        store_quad(position, k, px, py, pz, p[3])
        store_quad(velocity, k, vx, vy, vz, 0.0)


@routine
def second_kick(velocity, a, record):
    parameters = record[0]
    k = np.int32(cuda.grid(1))
    if k < velocity.size // SIZE:
        v, b = load_quad(velocity, k), load_quad(a, k)
        half_dt, inverse_damping = parameters.half_dt, parameters.inverse_damping
        vx = verlet_second_half(v[0], b[0], half_dt, inverse_damping)
        vy = verlet_second_half(v[1], b[1], half_dt, inverse_damping)
        vz = verlet_second_half(v[2], b[2], half_dt, inverse_damping)
        store_quad(velocity, k, vx, vy, vz, 0.0)


@routine
def accumulate(stage, base, rate, total, record, out):
    """Do one stage of RK4 on one array of unknowns (positions or velocities); the fourth writes the new state."""
    parameters = record[0]
    k = np.int32(cuda.grid(1))
    if k < base.size // SIZE:
        derivative_dt = parameters.dt if stage == 3 else parameters.half_dt
        total_dt = parameters.sixth_dt if stage == 1 or stage == 4 else parameters.third_dt
        b, r = load_quad(base, k), load_quad(rate, k)
        before = b if stage == 1 else load_quad(total, k)
        x, sum_x = rk4_stage(b[0], r[0], before[0], derivative_dt, total_dt)
        y, sum_y = rk4_stage(b[1], r[1], before[1], derivative_dt, total_dt)
        z, sum_z = rk4_stage(b[2], r[2], before[2], derivative_dt, total_dt)
        store_quad(total, k, sum_x, sum_y, sum_z, 0.0)
        if stage == 4:
            x, y, z = sum_x, sum_y, sum_z
        store_quad(out, k, x, y, z, b[3])


@routine
def collide(before, position, velocity, record, bodies, integers, step):
    world = World(record[0], bodies, integers)
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        old, p, v = load_quad(before, k), load_quad(position, k), load_quad(velocity, k)
        px, py, pz, vx, vy, vz = collide_point(old, p[0], p[1], p[2], v[0], v[1], v[2], world, step)
        store_quad(position, k, px, py, pz, p[3])
        store_quad(velocity, k, vx, vy, vz, 0.0)


@routine
def pins(stored, position, velocity):
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        h = load_quad(stored, k)
        if h[3] != 0.0:
            store_quad(position, k, h[0], h[1], h[2], h[3])
            store_quad(velocity, k, 0.0, 0.0, 0.0, 0.0)


@routine
def moving_pins(position, velocity, record, bodies, step, halfway):
    world = World(record[0], bodies, None)
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        p = load_quad(position, k)
        if p[3] != 0.0:
            x, y, z, vx, vy, vz = pin(p[3], p, step, halfway != 0, world)
            store_quad(position, k, x, y, z, p[3])
            store_quad(velocity, k, vx, vy, vz, 0.0)


def _compiled(real: Real, math: str, integrator: str, parts: frozenset[str], *kernels: Callable) -> SimpleNamespace:
    variant = device_variant(real, math, cloth_features(integrator, parts))
    label = f"cloth_{variant_name(real, math, integrator, parts)}"
    return kernels_of(variant, math, [of_scene(kernel, integrator, parts) for kernel in kernels], label)


@cache
def make_force_stages(real: Real, math: str, integrator: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile the stages that sum the acceleration: springs, wind, damping. core/forces.py has other forces."""
    return _compiled(real, math, integrator, parts, spring_forces, no_forces, wind, damping)


@cache
def make_motion_stages(real: Real, math: str, integrator: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile the stages that move masses."""
    return _compiled(real, math, integrator, parts, integrate, first_kick, second_kick, accumulate)


@cache
def make_bound_stages(real: Real, math: str, integrator: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile the stages that constrain masses: colliders and pins."""
    return _compiled(real, math, integrator, parts, collide, pins, moving_pins)


def bind_cloth_stages(sim: QuadPasses) -> dict[str, StageRun]:
    """Return the function of each named stage of `sim`, a gpu_backend.mass_spring.cloth.solver.ClothMassSpring."""
    integrator = sim.scene.method.integrator
    variant = sim.real, sim.options.math, integrator, sim.plan.parts
    force, motion, bound = make_force_stages(*variant), make_motion_stages(*variant), make_bound_stages(*variant)
    position, velocity, record, integers = sim.position[0], sim.velocity[0], sim.record, sim.integers
    flat, a, before = sim._flat, sim.new_array(), sim.new_array()
    at = {"position": position, "velocity": velocity}  # input of the forces: the state, or a stage of RK4
    totals = [sim.new_array(), sim.new_array()] if integrator == "rk4" else []
    stage_state = [sim.new_array() for _ in range(4)] if integrator == "rk4" else []
    verlet = integrator == "velocity-verlet"

    def spring_forces(moment: Moment) -> None:
        force.spring_forces[flat](at["position"], at["velocity"], record, a, *sim.shape)

    def wind(moment: Moment) -> None:
        step, offset = moment.step, moment.argument
        if verlet:  # the end of a step is the start of the next, to the bit
            step, offset = step + int(offset), 0.0
        force.wind[flat](
            at["position"], at["velocity"], record, integers, np.int64(step), sim.real(offset), a, *sim.shape
        )  # fmt: skip

    def store_before() -> None:
        """Save the positions at the step's start, for the swept test of a ball."""
        if sim.plan.has("collide"):
            before.copy_to_device(position, stream=sim.stream)

    def integrate(moment: Moment) -> None:
        store_before()
        motion.integrate[flat](position, velocity, a, record)

    def first_kick(moment: Moment) -> None:
        store_before()
        motion.first_kick[flat](position, velocity, a, record)

    def accumulate(stage: int) -> StageRun:
        def run(moment: Moment) -> None:
            if stage == 1:
                store_before()
            turn = 2 * (stage % 2)
            out_p, out_v = (position, velocity) if stage == 4 else (stage_state[turn], stage_state[turn + 1])
            rate_p = at["velocity"]
            motion.accumulate[flat](np.int32(stage), position, rate_p, totals[0], record, out_p)
            motion.accumulate[flat](np.int32(stage), velocity, a, totals[1], record, out_v)
            at["position"], at["velocity"] = out_p, out_v

        return run

    def pins(moment: Moment) -> None:
        bound.pins[flat](sim.stored_position, at["position"], at["velocity"])
        if "motion" in sim.plan.parts:
            bound.moving_pins[flat](
                at["position"],
                at["velocity"],
                record,
                sim.bodies,
                np.int64(moment.step),
                np.int32(moment.argument < 1),
            )

    return bind_forces(sim, sim.plan.parts, position, a) | {
        "spring forces": spring_forces,
        "no forces": lambda moment: force.no_forces[flat](a),
        "wind": wind,
        "damping": lambda moment: force.damping[flat](at["velocity"], record, a),
        f"integrate ({integrator})": integrate,
        "first half kick and drift": first_kick,
        "second half kick": lambda moment: motion.second_kick[flat](velocity, a, record),
        **{f"accumulate (rk4 {stage})": accumulate(stage) for stage in range(1, 5)},
        "collide": lambda moment: bound.collide[flat](
            before, at["position"], at["velocity"], record, sim.bodies, integers, np.int64(moment.step)
        ),
        "pins": pins,
    }
