"""The stages of the mass-spring plan as CUDA kernels, one thread per mass, each over the whole grid.

Each stage has separate input and output arrays: slow, but easy to read, to time and to test against the fused passes.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import Kernel, kernels_of, variant_name
from softlab.gpu_backend.core.forces import particle_force, with_forces
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.world import Cell
from softlab.gpu_backend.mass_spring.grid.point import grid_features, pair, spring_sum
from softlab.gpu_backend.mass_spring.passes import SheetPasses
from softlab.model.base.types import Real
from softlab.model.base.variant import filled, routine
from softlab.model.core.integrators import step_formula
from softlab.model.core.own_forces import WINDOW, particle_forces
from softlab.model.core.plan import Moment, StageRun
from softlab.model.formulas.integrators import one_force, rk4_stage, verlet_first_half, verlet_second_half
from softlab.model.formulas.springs import damped

STAGE_PARTS = frozenset({"springs", "gravity", "damping"})


@routine
def spring_forces(position, record, a, rows, columns):
    parameters = record[0]
    k = np.int32(cuda.grid(1))
    if k < a.shape[0]:
        i, j = np.int32(k // columns), np.int32(k % columns)
        ax, ay = spring_sum(position, k, Cell(i, j, np.int32(rows), np.int32(columns)), parameters)
        a[k] = pair(complex(ax, ay))


@routine
def no_forces(a):
    k = cuda.grid(1)
    if k < a.shape[0]:
        a[k] = pair(complex(0.0, 0.0))


@routine
def gravity(record, a):
    parameters = record[0]
    k = cuda.grid(1)
    if k < a.shape[0]:
        a[k] = pair(complex(a[k].real, a[k].imag + parameters.gravity))


@routine
def force(record, integers, step, a):
    k = np.int32(cuda.grid(1))
    if k < a.shape[0]:
        ax, ay = particle_force((a[k].real, a[k].imag), k, 0.0, record[0], integers, step)
        a[k] = pair(complex(ax, ay))


@routine
def damping(velocity, record, a):
    parameters = record[0]
    k = cuda.grid(1)
    if k < a.shape[0]:
        ax = damped(a[k].real, velocity[k].real, parameters.damping)
        ay = damped(a[k].imag, velocity[k].imag, parameters.damping)
        a[k] = pair(complex(ax, ay))


@routine
def integrate(position, velocity, a, record):
    parameters = record[0]
    k = cuda.grid(1)
    if k < a.shape[0]:
        p, v, dt, half_dt_squared = position[k], velocity[k], parameters.dt, parameters.half_dt_squared
        px, vx = one_force(p.real, v.real, a[k].real, dt, half_dt_squared)
        py, vy = one_force(p.imag, v.imag, a[k].imag, dt, half_dt_squared)
        position[k] = pair(complex(px, py))
        velocity[k] = pair(complex(vx, vy))


@routine
def first_kick(position, velocity, a, record):
    parameters = record[0]
    k = cuda.grid(1)
    if k < a.shape[0]:
        p, v, dt, half_dt, rate = position[k], velocity[k], parameters.dt, parameters.half_dt, parameters.damping
        px, vx = verlet_first_half(p.real, v.real, a[k].real, dt, half_dt, rate)
        py, vy = verlet_first_half(p.imag, v.imag, a[k].imag, dt, half_dt, rate)
        position[k] = pair(complex(px, py))
        velocity[k] = pair(complex(vx, vy))


@routine
def second_kick(velocity, a, record):
    parameters = record[0]
    k = cuda.grid(1)
    if k < a.shape[0]:
        v, half_dt, inverse_damping = velocity[k], parameters.half_dt, parameters.inverse_damping
        vx = verlet_second_half(v.real, a[k].real, half_dt, inverse_damping)
        vy = verlet_second_half(v.imag, a[k].imag, half_dt, inverse_damping)
        velocity[k] = pair(complex(vx, vy))


@routine
def accumulate(stage, base, rate, total, record, out):
    """Do one stage of RK4 on one array of unknowns (positions or velocities); the fourth writes the new state."""
    parameters = record[0]
    k = cuda.grid(1)
    if k < base.shape[0]:
        derivative_dt = parameters.dt if stage == 3 else parameters.half_dt
        total_dt = parameters.sixth_dt if stage == 1 or stage == 4 else parameters.third_dt
        before = base[k] if stage == 1 else total[k]
        x, sum_x = rk4_stage(base[k].real, rate[k].real, before.real, derivative_dt, total_dt)
        y, sum_y = rk4_stage(base[k].imag, rate[k].imag, before.imag, derivative_dt, total_dt)
        total[k] = pair(complex(sum_x, sum_y))
        out[k] = total[k] if stage == 4 else pair(complex(x, y))


@routine
def pins(pinned, stored, position, velocity):
    k = cuda.grid(1)
    if k < position.shape[0] and pinned[k] != 0:
        position[k] = stored[k]
        velocity[k] = pair(complex(0.0, 0.0))


@cache
def make_force_stages(real: Real, math: str, integrator: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile the stages that sum the acceleration. State and acceleration are complex (particles,)."""
    variant = device_variant(real, math, grid_features(integrator, parts | STAGE_PARTS))

    def stage_of(part: str) -> Kernel:
        stage = with_forces(force, parts & {WINDOW} | {part})
        return kernels_of(variant, math, (stage,), variant_name(real, math, parts)).force

    kernels = (spring_forces, no_forces, gravity, damping)
    stages = kernels_of(variant, math, kernels, variant_name(real, math, integrator, parts))
    stages.particle_forces = {one.stage: stage_of(one.part) for one in particle_forces(parts)}
    return stages


@cache
def make_motion_stages(real: Real, math: str, integrator: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile the stages that move masses."""
    variant = device_variant(real, math, grid_features(integrator, parts | STAGE_PARTS))
    kernels = (filled(integrate, {"one_force": step_formula(integrator)}), first_kick, second_kick, accumulate, pins)
    return kernels_of(variant, math, kernels, variant_name(real, math, integrator, parts))


def bind_stages(sim: SheetPasses) -> dict[str, StageRun]:
    """Return the function of each named stage of `sim`, a gpu_backend.mass_spring.grid.solver.MassSpring."""
    integrator = sim.scene.method.integrator
    variant = sim.real, sim.options.math, integrator, sim.plan.parts
    force, motion = make_force_stages(*variant), make_motion_stages(*variant)
    flat = ((sim.particle_count + 255) // 256, 256, sim.stream)
    position, velocity, a = sim.position[0], sim.velocity[0], sim.new_array()
    at = {"position": position, "velocity": velocity}  # input of the forces: the state, or a stage of RK4
    totals = [sim.new_array(), sim.new_array()] if integrator == "rk4" else []
    stage_state = [sim.new_array() for _ in range(4)] if integrator == "rk4" else []
    shape = (np.int32(sim.body.rows), np.int32(sim.body.columns))

    def bound(kernel: Kernel) -> StageRun:
        return lambda moment: kernel[flat](sim.record, sim.integers, np.int64(moment.step), a)

    def accumulate(stage: int) -> StageRun:
        def run(moment: Moment) -> None:
            turn = 2 * (stage % 2)
            out_p, out_v = (position, velocity) if stage == 4 else (stage_state[turn], stage_state[turn + 1])
            rate_p = at["velocity"]
            motion.accumulate[flat](stage, position, rate_p, totals[0], sim.record, out_p)
            motion.accumulate[flat](stage, velocity, a, totals[1], sim.record, out_v)
            at["position"], at["velocity"] = out_p, out_v

        return run

    return {
        "spring forces": lambda moment: force.spring_forces[flat](at["position"], sim.record, a, *shape),
        "no forces": lambda moment: force.no_forces[flat](a),
        "gravity": lambda moment: force.gravity[flat](sim.record, a),
        **{name: bound(kernel) for name, kernel in force.particle_forces.items()},
        "damping": lambda moment: force.damping[flat](at["velocity"], sim.record, a),
        f"integrate ({integrator})": lambda moment: motion.integrate[flat](position, velocity, a, sim.record),
        "first half kick and drift": lambda moment: motion.first_kick[flat](position, velocity, a, sim.record),
        "second half kick": lambda moment: motion.second_kick[flat](velocity, a, sim.record),
        **{f"accumulate (rk4 {stage})": accumulate(stage) for stage in range(1, 5)},
        "pins": lambda moment: motion.pins[flat](sim.pinned, sim.stored_position, at["position"], at["velocity"]),
    }
