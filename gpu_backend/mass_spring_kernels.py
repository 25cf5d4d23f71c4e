"""CUDA kernels of the mass-spring grid: one thread per mass, one pass over the grid a launch.

A mass is one thread of a two-dimensional block, 32 columns wide so that a warp reads 32 neighbouring masses of a row
in one transaction, 8 rows high so that most vertical neighbours are read by the same block (and found in its cache).
Position and velocity are complex numbers: one 8-byte load (16 in float64, see pairs.py) brings both axes, and indices
are 32-bit.

Each thread gathers the pulls of its four neighbours from the old state and writes its own mass in the new one, so no
two threads write to one place and none reads what another writes in the same launch: no locks, no atomics. The order
between passes is the order of launches in the stream. Sums are taken as on the CPU: (right + left) + (below + above),
then gravity, external, manufactured, poke, damping. A neighbour beyond the edge is replaced by the mass itself, whose
pull on itself is zero: no branch at the edges.

Kernels are compiled for the parts a scene has: flags are closure constants, an absent part leaves no instruction.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from gpu_backend.formulas import device_formulas
from gpu_backend.pairs import load_pair, store_pair
from model.formulas import integrators, manufactured, random, springs
from model.record import (
    K_AMPLITUDE,
    K_DAMPING,
    K_DT,
    K_EXTERNAL,
    K_GRAVITY,
    K_HALF_DT,
    K_HALF_DT_SQUARED,
    K_INERTIA,
    K_INVERSE_DAMPING,
    K_POKE_X,
    K_POKE_Y,
    K_SIXTH_DT,
    K_SPACING,
    K_STIFFNESS,
    K_STIFFNESS_REST,
    K_THIRD_DT,
)  # fmt: skip

BLOCK = (32, 8)  # columns, rows


def kernel_options(math: str) -> dict[str, Any]:
    """Options of cuda.jit for a math."""
    return {"fastmath": math == "fast"}


@cache
def make_point_functions(real: Any, math: str, integrator: str, parts: frozenset[str]) -> SimpleNamespace:
    """Device functions of a variant: `spring_sum`, `add_forces`, `damp`, and the integrator's formulas."""
    device = cuda.jit(device=True, **kernel_options(math))
    spring_pull_2d, damped = device_formulas(springs.make, real, math)
    formulas = device_formulas(integrators.make, real, math)
    external = device_formulas(random.make, real, math).add_external
    philox = random.make_philox(device)
    manufactured_acceleration, stage_time = device_formulas(manufactured.make, real, math)
    has_springs, has_gravity, has_damping = "springs" in parts, "gravity" in parts, "damping" in parts
    has_external, has_manufactured, has_poke = "external" in parts, "manufactured" in parts, "poke" in parts
    explicit_damping = has_damping and integrator != "velocity-verlet"
    zero, one, no_step = real(0), np.int32(1), np.int64(0)

    @device
    def spring_sum(position, k, i, j, rows, columns, record):
        """Sum of the four pulls over mass [m/s^2] on mass k = i * columns + j."""
        here = load_pair(position, k)
        left = load_pair(position, k - one if j > 0 else k)
        right = load_pair(position, k + one if j < columns - 1 else k)
        above = load_pair(position, k - columns if i > 0 else k)
        below = load_pair(position, k + columns if i < rows - 1 else k)
        stiffness, rest = record[K_STIFFNESS], record[K_STIFFNESS_REST]
        right_x, right_y = spring_pull_2d(right.real - here.real, right.imag - here.imag, stiffness, rest)
        left_x, left_y = spring_pull_2d(left.real - here.real, left.imag - here.imag, stiffness, rest)
        below_x, below_y = spring_pull_2d(below.real - here.real, below.imag - here.imag, stiffness, rest)
        above_x, above_y = spring_pull_2d(above.real - here.real, above.imag - here.imag, stiffness, rest)
        return (right_x + left_x) + (below_x + above_x), (right_y + left_y) + (below_y + above_y)

    @device
    def conservative(position, k, i, j, rows, columns, record):
        """Springs and gravity [m/s^2]."""
        ax, ay = zero, zero
        if has_springs:
            ax, ay = spring_sum(position, k, i, j, rows, columns, record)
        if has_gravity:
            ay = ay + record[K_GRAVITY]
        return ax, ay

    @device
    def add_external(ax, ay, k, record, integers, step):
        word_x, word_y, _, _ = philox(integers[0], np.uint64(step), np.uint64(k))
        return external(ax, record[K_EXTERNAL], word_x), external(ay, record[K_EXTERNAL], word_y)

    @device
    def add_driven(ax, ay, k, i, j, rows, columns, record, integers, step, offset):
        """The manufactured force at time (step + offset) dt, and the poke."""
        if has_manufactured:
            time = stage_time(step, offset, record[K_DT])
            fx, fy = manufactured_acceleration(
                i, j, rows, columns, time, record[K_AMPLITUDE], record[K_INERTIA], record[K_SPACING],
                record[K_STIFFNESS], record[K_STIFFNESS_REST], record[K_GRAVITY], record[K_DAMPING],
            )  # fmt: skip
            ax, ay = ax + fx, ay + fy
        if has_poke:
            if np.int64(integers[1]) == k + 1:  # compared as they are, the two kinds of integer would meet as doubles
                ax, ay = ax + record[K_POKE_X], ay + record[K_POKE_Y]
        return ax, ay

    @device
    def acceleration(position, velocity, k, i, j, rows, columns, record, integers, step, offset):
        """All that acts on mass k [m/s^2], with the damper where the integrator takes it explicitly."""
        ax, ay = conservative(position, k, i, j, rows, columns, record)
        if has_external:
            ax, ay = add_external(ax, ay, k, record, integers, step)
        ax, ay = add_driven(ax, ay, k, i, j, rows, columns, record, integers, step, offset)
        if explicit_damping:
            ax = damped(ax, velocity.real, record[K_DAMPING])
            ay = damped(ay, velocity.imag, record[K_DAMPING])
        return ax, ay

    @device
    def current_step(counter, pass_number):
        """The number of the step, where anything depends on it."""
        if has_external or has_manufactured:
            return counter[0] + pass_number
        return no_step

    return SimpleNamespace(
        conservative=conservative, add_external=add_external, add_driven=add_driven, acceleration=acceleration,
        current_step=current_step, formulas=formulas, has_external=has_external, spring_sum=spring_sum, damped=damped,
    )  # fmt: skip


@cache
def make_passes(real: Any, math: str, integrator: str, parts: frozenset[str]) -> dict[str, Any]:
    """The kernels of one-force integrators (`step`) or of velocity Verlet (`opening`, `middle`, `closing`).

    Each is kernel(position, velocity, new_position, new_velocity, record, integers, counter, pass_number, pinned_row,
    pinned, rows, columns): complex (particles,) arrays, the constants, the step counter and the pass's place after it,
    which rows hold pins and which masses are pinned.
    """
    point = make_point_functions(real, math, integrator, parts)
    conservative, add_external, add_driven = point.conservative, point.add_external, point.add_driven
    acceleration, current_step, formulas = point.acceleration, point.current_step, point.formulas
    first_half, second_half = formulas.verlet_first_half, formulas.verlet_second_half
    verlet = integrator == "velocity-verlet"
    one_force = formulas.semi_implicit_euler if verlet else getattr(formulas, integrator.replace("-", "_"))
    has_pins, has_external = "pins" in parts, point.has_external
    two_sums = has_external
    zero = real(0)
    jit = cuda.jit(**kernel_options(math))
    device = cuda.jit(device=True, **kernel_options(math))

    @device
    def step_mass(k, i, j, position, velocity, record, integers, step, rows, columns):
        p, v = load_pair(position, k), load_pair(velocity, k)
        ax, ay = acceleration(position, v, k, i, j, rows, columns, record, integers, step, zero)
        dt, half_dt_squared = record[K_DT], record[K_HALF_DT_SQUARED]
        px, vx = one_force(p.real, v.real, ax, dt, half_dt_squared)
        py, vy = one_force(p.imag, v.imag, ay, dt, half_dt_squared)
        return px, py, vx, vy

    @device
    def opening_mass(k, i, j, position, velocity, record, integers, step, rows, columns):
        p, v = load_pair(position, k), load_pair(velocity, k)
        ax, ay = acceleration(position, v, k, i, j, rows, columns, record, integers, step, zero)
        dt, half_dt, rate = record[K_DT], record[K_HALF_DT], record[K_DAMPING]
        px, vx = first_half(p.real, v.real, ax, dt, half_dt, rate)
        py, vy = first_half(p.imag, v.imag, ay, dt, half_dt, rate)
        return px, py, vx, vy

    @device
    def closing_mass(k, i, j, position, velocity, record, integers, step, rows, columns):
        p, v = load_pair(position, k), load_pair(velocity, k)
        ax, ay = conservative(position, k, i, j, rows, columns, record)
        if has_external:
            ax, ay = add_external(ax, ay, k, record, integers, step - 1)
        ax, ay = add_driven(ax, ay, k, i, j, rows, columns, record, integers, step, zero)
        half_dt, inverse_damping = record[K_HALF_DT], record[K_INVERSE_DAMPING]
        vx = second_half(v.real, ax, half_dt, inverse_damping)
        vy = second_half(v.imag, ay, half_dt, inverse_damping)
        return p.real, p.imag, vx, vy

    @device
    def middle_mass(k, i, j, position, velocity, record, integers, step, rows, columns):
        """The second half kick of one step and the first of the next: both need the force here, computed once."""
        p, v = load_pair(position, k), load_pair(velocity, k)
        ax, ay = conservative(position, k, i, j, rows, columns, record)
        bx, by = ax, ay
        if two_sums:
            ax, ay = add_external(ax, ay, k, record, integers, step - 1)
            bx, by = add_external(bx, by, k, record, integers, step)
        ax, ay = add_driven(ax, ay, k, i, j, rows, columns, record, integers, step, zero)
        if two_sums:
            bx, by = add_driven(bx, by, k, i, j, rows, columns, record, integers, step, zero)
        else:
            bx, by = ax, ay
        half_dt, inverse_damping = record[K_HALF_DT], record[K_INVERSE_DAMPING]
        whole_x = second_half(v.real, ax, half_dt, inverse_damping)
        whole_y = second_half(v.imag, ay, half_dt, inverse_damping)
        dt, rate = record[K_DT], record[K_DAMPING]
        px, vx = first_half(p.real, whole_x, bx, dt, half_dt, rate)
        py, vy = first_half(p.imag, whole_y, by, dt, half_dt, rate)
        return px, py, vx, vy

    def make_kernel(move: Any) -> Any:
        @jit
        def grid_pass(
            position, velocity, new_position, new_velocity, record, integers, counter, pass_number, pinned_row, pinned,
            rows, columns,
        ):  # fmt: skip
            j = np.int32(cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x)
            i = np.int32(cuda.blockIdx.y * cuda.blockDim.y + cuda.threadIdx.y)
            rows = np.int32(rows)
            columns = np.int32(columns)
            if i < rows and j < columns:
                k = np.int32(i * columns + j)
                step = current_step(counter, pass_number)
                px, py, vx, vy = move(k, i, j, position, velocity, record, integers, step, rows, columns)
                if has_pins:
                    if pinned_row[i] != 0:
                        if pinned[k] != 0:
                            here = load_pair(position, k)
                            px, py, vx, vy = here.real, here.imag, zero, zero
                store_pair(new_position, k, px, py)
                store_pair(new_velocity, k, vx, vy)

        return grid_pass

    if verlet:
        moves = {"opening": opening_mass, "middle": middle_mass, "closing": closing_mass}
    else:
        moves = {"step": step_mass}
    return {name: make_kernel(move) for name, move in moves.items()}


@cache
def make_rk4_stages(real: Any, math: str, parts: frozenset[str]) -> list[Any]:
    """The four stage kernels of RK4.

    kernel(position, velocity, base_position, base_velocity, total_position, total_velocity, new_position, new_velocity,
    record, integers, counter, pass_number, pinned_row, pinned, rows, columns): neighbours are read in (position,
    velocity), the state of the stage; each stage adds to the total, the last one writes the new state to `new`.
    """
    point = make_point_functions(real, math, "rk4", parts)
    acceleration, current_step, rk4_stage = point.acceleration, point.current_step, point.formulas.rk4_stage
    has_pins = "pins" in parts
    zero = real(0)
    jit = cuda.jit(**kernel_options(math))

    def make_stage(stage: int) -> Any:
        offset = real((0.0, 0.5, 0.5, 1.0)[stage])
        k_derivative = (K_HALF_DT, K_HALF_DT, K_DT, K_DT)[stage]
        k_total = (K_SIXTH_DT, K_THIRD_DT, K_THIRD_DT, K_SIXTH_DT)[stage]
        first, last = stage == 0, stage == 3

        @jit
        def rk4_pass(
            position, velocity, base_position, base_velocity, total_position, total_velocity, new_position, new_velocity,
            record, integers, counter, pass_number, pinned_row, pinned, rows, columns,
        ):  # fmt: skip
            j = np.int32(cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x)
            i = np.int32(cuda.blockIdx.y * cuda.blockDim.y + cuda.threadIdx.y)
            rows = np.int32(rows)
            columns = np.int32(columns)
            if i < rows and j < columns:
                k = np.int32(i * columns + j)
                p, v = load_pair(position, k), load_pair(velocity, k)
                step = current_step(counter, pass_number)
                ax, ay = acceleration(position, v, k, i, j, rows, columns, record, integers, step, offset)
                base_p, base_v = load_pair(base_position, k), load_pair(base_velocity, k)
                if first:
                    total_p, total_v = base_p, base_v
                else:
                    total_p, total_v = load_pair(total_position, k), load_pair(total_velocity, k)
                derivative_dt, total_dt = record[k_derivative], record[k_total]
                px, sum_px = rk4_stage(base_p.real, v.real, total_p.real, derivative_dt, total_dt)
                py, sum_py = rk4_stage(base_p.imag, v.imag, total_p.imag, derivative_dt, total_dt)
                vx, sum_vx = rk4_stage(base_v.real, ax, total_v.real, derivative_dt, total_dt)
                vy, sum_vy = rk4_stage(base_v.imag, ay, total_v.imag, derivative_dt, total_dt)
                if last:
                    px, py, vx, vy = sum_px, sum_py, sum_vx, sum_vy
                else:
                    store_pair(total_position, k, sum_px, sum_py)
                    store_pair(total_velocity, k, sum_vx, sum_vy)
                if has_pins:
                    if pinned_row[i] != 0:
                        if pinned[k] != 0:
                            px, py, vx, vy = p.real, p.imag, zero, zero
                store_pair(new_position, k, px, py)
                store_pair(new_velocity, k, vx, vy)

        return rk4_pass

    return [make_stage(stage) for stage in range(4)]


@cache
def make_tools(real: Any) -> SimpleNamespace:
    """Small kernels around the passes: count steps, look for bad masses, write positions for drawing."""

    @cuda.jit
    def count(counter, steps):
        if cuda.grid(1) == 0:
            counter[0] += steps

    @cuda.jit
    def first_bad(position, velocity, bound, result):
        """The lowest index of a mass that left the finite world, by an atomic minimum of integers."""
        k = cuda.grid(1)
        if k < position.shape[0]:
            p, v = load_pair(position, k), load_pair(velocity, k)
            inside = abs(p.real) <= bound and abs(p.imag) <= bound  # false for NaN
            still = v.real - v.real == v.imag - v.imag  # false for NaN and infinity
            if not (inside and still):
                cuda.atomic.min(result, 0, k)

    @cuda.jit
    def write_position(position, out):
        k = cuda.grid(1)
        if k < position.shape[0]:
            p = position[k]
            out[k, 0] = p.real
            out[k, 1] = p.imag

    return SimpleNamespace(count=count, first_bad=first_bad, write_position=write_position)
