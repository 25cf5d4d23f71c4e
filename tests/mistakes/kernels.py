"""Mistakes in the kernels of both backends: signs, edges, order, axes, threads, precision."""

from __future__ import annotations

from .mistake import mistakes_of

GRID = "test_cpu_reference.py::test_each_kick_takes_the_random_force_of_its_own_step_and_pins_stay_at_rest test_cpu_reference.py::test_odd_grids_free test_cpu_reference.py::test_odd_grids_pinned"
NEAR = "test_near.py::test_states_are_the_references"
BITS = "simulator/test_simulated_bits.py::test_kernels_have_the_bits_of_the_cpu"
SIMULATED_GRID = f"simulator/test_simulated_gpu.py::test_the_first_mass_that_left_the_finite_world_is_found {BITS}[grid-over-blocks-lab-float64] {BITS}[grid-over-blocks-semi-implicit-euler-float64] {BITS}[grid-busy-velocity-verlet-float32] {BITS}[grid-busy-rk4-float64] {BITS}[grid-busy-lab-float32]"
SIMULATED_CLOTH = f"{BITS}[cloth-springs-float64] {BITS}[cloth-random-float64] {BITS}[cloth-1x5-float64]"
SIMULATED_XPBD = (
    f"{BITS}[sheet-rigid-gauss-seidel-float32] {BITS}[sheet-free-jacobi-float32] {BITS}[sheet-gauss-seidel-2x2-float64]"
)

CPU = mistakes_of({
    "model/core/sharing/decomposition.py": {
        "test_decomposition.py::test_the_halo_lasts_until_the_next_exchange test_decomposition.py::test_an_exchange_fills_every_halo_with_what_its_neighbour_owns": {
            "the last half kick of a window lacks a row": ("self.rows * self.forces * parts + self.more", "self.rows * self.forces * parts"),
            "a border begins a row late": ("lower.window_first - upper.window_first, 0, down", "lower.window_first - upper.window_first + 1, 0, down"),
        },
    },
    "model/xpbd/reach.py": {
        "test_shared_projections.py::test_how_far_a_substep_reads test_shared_projections.py::test_wind_moves_an_edge_through_the_colours_period": {
            "a window of a cloth in wind lacks a row a substep": ("first - wind, end + wind", "first, end"),
        },
    },
    "gpu_backend/mass_spring/bands.py": {
        "test_bands.py": {"a band does not wait for the one below it (gpu)": ("for other in (k - 1, k + 1):", "for other in (k - 1,):")},
    },
    "model/core/own_forces.py": {
        "test_shares.py::test_shares_have_the_bits_of_one[grid-random-2]": {
            "a window counts its masses from its own first": ("np.int64(k) + np.int64(integers[FIRST])", "np.int64(k)"),
        },
        f"{NEAR}[bodies-float64]": {"a body's poke is along x alone": ("parameters.poke_y if poked else 0.0", "parameters.poke_x if poked else 0.0")},
    },
    "gpu_backend/domains/kernels.py": {
        "simulator/domains/test_simulated_domains.py::test_two_windows_have_the_bits_of_the_cpu": {
            "an inbox gives positions for velocities (gpu)": ("load_fresh_pair(inbox, np.int32(half + count + k))", "load_fresh_pair(inbox, np.int32(half + k))"),
        },
    },
    "cpu_backend/tetrahedra/newton_elements.py": {
        "test_kinematic.py::test_an_end_that_is_driven_takes_the_body_with_it": {
            "dampers work against places and not rates (cpu)": ("return p[0] - q[0], p[1] - q[1], p[2] - q[2]", "return p[0], p[1], p[2]"),
        },
    },
    "cpu_backend/contact/pins.py": {
        "test_kinematic.py::test_pins_are_where_their_motion_has_them_and_as_fast": {
            "pins are where the substep began (cpu)": ("time = instant(number + 1, parameters.dt", "time = instant(number, parameters.dt"),
        },
    },
    "cpu_backend/mass_spring/grid/rows.py": {
        GRID: {
            "the spring above pushes (cpu)": ("return (right - left) + (below - above)", "return (right - left) + (below + above)"),
            "a pinned mass moves along y (cpu)": ("for axis in range(2):\n                target[there + axis * target_plane + j]", "for axis in range(1):\n                target[there + axis * target_plane + j]"),
            "the first column's left neighbour is forgotten (cpu)": ("left_x, left_y = right_x, right_y\n            above_x[j] = below_x", "left_x, left_y = left_x, right_y\n            above_x[j] = below_x"),
        },
        "test_cpu_reference.py::test_each_kick_takes_the_random_force_of_its_own_step_and_pins_stay_at_rest": {
            "both kicks take the random force of one step (cpu)": ("closing = step - 1 if FEATURE.changing and FEATURE.verlet else step", "closing = step"),
        },
    },
    "cpu_backend/mass_spring/grid/row_step.py": {
        GRID: {
            "the spring from the left has lost its sign (cpu)": ("ax = sum_accelerations(right_x, left_x, below_x, above_x[j])\n            ay", "ax = sum_accelerations(right_x, -left_x, below_x, above_x[j])\n            ay"),
            "velocities change axes (cpu)": ("new_vx[j] = qx\n        new_vy[j] = qy", "new_vx[j] = qy\n        new_vy[j] = qx"),
            "the closing pass drifts (cpu)": ("return position, verlet_second_half(velocity, closing, parameters.half_dt, parameters.inverse_damping)", "return position + velocity * parameters.dt, verlet_second_half(velocity, closing, parameters.half_dt, parameters.inverse_damping)"),
        },
    },
    "cpu_backend/mass_spring/grid/rk4.py": {
        "test_cpu_reference.py::test_odd_grids_free[fused-1-7-rk4] " + GRID: {
            "Runge-Kutta's middle stages weigh a sixth (cpu)": ("elif stage == 1:\n        middle_stage(blocks, base, rate, parameters.half_dt, parameters.third_dt", "elif stage == 1:\n        middle_stage(blocks, base, rate, parameters.half_dt, parameters.sixth_dt"),
            "Runge-Kutta's third stage goes half a step (cpu)": ("middle_stage(blocks, base, rate, parameters.dt, parameters.third_dt", "middle_stage(blocks, base, rate, parameters.half_dt, parameters.third_dt * parameters.dt / parameters.dt"),
        },
    },
    "cpu_backend/mass_spring/grid/kernels.py": {
        "test_cpu_reference.py::test_odd_grids_free": {
            "a band ends a row early (cpu)": ("first, last = rows * band // bands, rows * (band + 1) // bands", "first, last = rows * band // bands, rows * (band + 1) // bands - 1"),
            "the states do not change places (cpu)": ("states, (current + k) % 2, sheet", "states, current, sheet"),
        },
    },
    "model/contact/colliders.py": {
        "test_collider_formulas.py": {
            "a capsule stays where it began": ("def touch_capsule(body, begin, end, slow, a, p, v):\n    cx, cy, cz = point(body, end)", "def touch_capsule(body, begin, end, slow, a, p, v):\n    cx, cy, cz = point(body, begin)"),
            "a collider's static coefficient is its dynamic one": ("static, dynamic = body[B_STATIC], body[B_DYNAMIC]\n    u =", "static, dynamic = body[B_DYNAMIC], body[B_DYNAMIC]\n    u ="),
            "a mass is pushed out to the surface, not to the thickness": ("depth = thickness - distance", "depth = -distance"),
            "a plane pushes to its other side": ("return push(body, slow, distance, (nx, ny, nz), p, v)\n\n\n@routine\ndef touch_sphere", "return push(body, slow, -distance, (nx, ny, nz), p, v)\n\n\n@routine\ndef touch_sphere"),
        },
    },
    "cpu_backend/mass_spring/cloth/rows.py": {
        "test_cloth_cpu.py::test_stages_follow_the_reference test_bits.py::test_threads_kernels_and_restarts_give_the_same_bits[cloth-springs-5x7-float32]": {
            "a shear spring leads to the wrong mass (cpu)": ("below_right, below_left = below + 1, below - 1", "below_right, below_left = below, below - 1"),
            "a bending spring is one row too short (cpu)": ("if i + 2 < rows:\n        beyond = here + 2 * stride", "if i + 2 < rows:\n        beyond = here + stride"),
        },
    },
    "cpu_backend/shape_matching/particles.py": {
        f"{NEAR}[bodies-float64]": {
            "bodies move with twice the substep (cpu)": ("inverse = parameters.inverse_substep\n", "inverse = parameters.inverse_substep + parameters.inverse_substep\n"),
        },
    },
    "model/contact/triangle_push.py": {
        "test_contacts.py::test_what_is_found_and_projected_is_the_references": {
            "a triangle's corners are pushed along with the mass": ("taken(x, part, force[0])", "taken(x, -part, force[0])"),
            "every corner weighs as the first": ("return w[0] if corner == 1 else w[1]", "return w[0]"),
        },
    },
    "cpu_backend/contact/self_project.py": {
        "test_surface_contacts.py::test_contacts_are_the_references": {
            "surfaces are rubbed by their last push (cpu)": ("forces[slot, F_PRESS] += scaled(depth, scale)", "forces[slot, F_PRESS] = scaled(depth, scale)"),
        },
    },
    "cpu_backend/contact/particles_cells.py": {
        "test_particle_contacts.py::test_neighbours_are_those_of_asking_all": {
            "a row of cells is looked at too short (cpu)": ("runs[n], runs[n + 1] = starts[cell - 1], starts[cell + 2]", "runs[n], runs[n + 1] = starts[cell - 1], starts[cell + 1]"),
            "cells of negative coordinates are cut towards 0 (cpu)": ("j = np.int32(j - 1) if b < real(j) else j", "j = j"),
        },
    },
    "cpu_backend/core/point_stages.py": {
        "test_xpbd_cpu_reference.py::test_stages_follow_the_reference": {
            "a substep's velocity counts from the prediction (cpu)": ("position[axis, i, j] = predicted(p, record[0].dt, v) if w > 0.0 else p", "position[axis, i, j] = predicted(p, record[0].dt, velocity[axis, i, j]) if w > 0.0 else p"),
        },
    },
})  # fmt: skip

GPU = mistakes_of({
    "model/core/own_forces.py": {
        "test_cpu_reference.py": {"the poke acts on the next mass": ("poked = np.int64(integers[POKED]) == k + 1", "poked = np.int64(integers[POKED]) == k")},
    },
    "gpu_backend/mass_spring/grid/point.py": {
        SIMULATED_GRID: {
            "the second column has no left neighbour (gpu)": ("left = load_pair(position, k - ONE if j > 0 else k)", "left = load_pair(position, k - ONE if j > 1 else k)"),
            "the kicks take each other's random force (gpu)": ("bx, by = particle_force((bx, by), k, 0.0, parameters, integers, step)", "bx, by = particle_force((bx, by), k, 0.0, parameters, integers, step - 1)"),
            "axes are exchanged in a step (gpu)": ("py, vy = one_force(p.imag, v.imag, ay, dt, half_dt_squared)\n    return px, py, vx, vy", "py, vy = one_force(p.imag, v.imag, ay, dt, half_dt_squared)\n    return py, px, vx, vy"),
        },
    },
    "gpu_backend/mass_spring/grid/kernels.py": {
        SIMULATED_GRID: {
            "threads beyond the last row (gpu)": ("if i < rows and j < columns:\n        k = np.int32(i * columns + j)\n        step =", "if i <= rows and j < columns:\n        k = np.int32(i * columns + j)\n        step ="),
            "blocks overlap (gpu)": ("j = np.int32(cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x)\n    i = np.int32(cuda.blockIdx.y * cuda.blockDim.y + cuda.threadIdx.y)\n    rows = np.int32(rows)\n    columns = np.int32(columns)\n    if i < rows and j < columns:\n        k = np.int32(i * columns + j)\n        step", "j = np.int32(cuda.blockIdx.x * (cuda.blockDim.x - 1) + cuda.threadIdx.x)\n    i = np.int32(cuda.blockIdx.y * (cuda.blockDim.y - 1) + cuda.threadIdx.y)\n    rows = np.int32(rows)\n    columns = np.int32(columns)\n    if i < rows and j < columns:\n        k = np.int32(i * columns + j)\n        step"),
            "Runge-Kutta's offsets are exchanged (gpu)": ("parameters.sixth_dt if FEATURE.stage == 0 or FEATURE.stage == 3 else parameters.third_dt", "parameters.third_dt if FEATURE.stage == 0 or FEATURE.stage == 3 else parameters.sixth_dt"),
            "no mass is called bad for its velocity (gpu)": ("if not (inside and still):", "if not inside and not still:"),
        },
    },
    "gpu_backend/mass_spring/grid/tiles.py": {
        f"simulator/test_simulated_tiles.py::test_every_mass_is_owned_by_one_tile {BITS}[grid-in-tiles-lab-float32] {BITS}[grid-3x7-float32]": {
            "a tile owns its halo (gpu)": ("end = np.int32(start + size - FEATURE.halo)", "end = np.int32(start + size)"),
            "a strip's lower neighbour is its own last mass (gpu)": ("below = np.int32(below + width)", "below = np.int32(below)"),
        },
    },
    "gpu_backend/contact/colliders.py": {
        "simulator/test_simulated_colliders.py": {"a mass begins where it ends (gpu)": ("(before[0], before[1], before[2])", "(px, py, pz)")},
    },
    "gpu_backend/mass_spring/cloth/point.py": {
        SIMULATED_CLOTH: {
            "a cloth's springs read the wrong way (gpu)": ("dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]\n    stiffness", "dx, dy, dz = p[0] - q[0], p[1] - q[1], p[2] - q[2]\n    stiffness"),
            "a cloth's axes are exchanged (gpu)": ("(a[1] + b[1]) + (c[1] + d[1]), (a[2] + b[2]) + (c[2] + d[2])", "(a[2] + b[2]) + (c[2] + d[2]), (a[1] + b[1]) + (c[1] + d[1])"),
        },
    },
    "gpu_backend/core/sheet.py": {
        f"{BITS}[sheet-averaged-jacobi-2x33-float64]": {
            "a launch's threads are turned by a quarter (gpu)": ("np.int32(cuda.blockIdx.y * cuda.blockDim.y + cuda.threadIdx.y),\n        np.int32(cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x),", "np.int32(cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x),\n        np.int32(cuda.blockIdx.y * cuda.blockDim.y + cuda.threadIdx.y),"),
        },
    },
    "gpu_backend/position_based/kernels.py": {
        SIMULATED_XPBD: {
            "a colour projects the other colour's rows (gpu)": ("i % down + down * colour)", "i % down + down * (np.int32(1) - colour))"),
            "rising diagonals fall (gpu)": ("first, second = np.int32(k + along), np.int32(k + down * columns)", "first, second = np.int32(k), np.int32(k + down * columns)"),
            "multipliers are kept from the last substep (gpu)": ("if FEATURE.soft and not fresh:", "if FEATURE.soft:"),
        },
    },
    "model/contact/triangle_search.py": {
        "test_surface_contacts.py::test_contacts_are_the_references": {
            "every triangle at a side answers for it": ("if (owned[triangle] >> feature) & 1 == 0:", "if triangle < 0:"),
        },
        f"{NEAR}[tetrahedra-tied-float64]": {"a cloth has an inside": ("if inside and (owned[triangle] >> SHEET) & 1 != 0:", "if inside and triangle < 0:")},
        "test_contacts.py::test_what_is_found_and_projected_is_the_references": {
            "a cell's box does not grow by its motion": ("min(min(qa[0], qb[0]), min(qc[0], qd[0])) - moved", "min(min(qa[0], qb[0]), min(qc[0], qd[0]))"),
        },
    },
    "cpu_backend/contact/surfaces_find.py": {
        "test_surface_contacts.py::test_contacts_are_the_references": {
            "the triangles of a vertex's last neighbour are left out (cpu)": ("for e in range(entry, entry + np.int64(lists.numbers[n])):", "for e in range(entry, entry + np.int64(lists.numbers[n]) - 1):"),
        },
    },
    "gpu_backend/contact/self_find.py": {
        "simulator/test_simulated_contacts.py::test_what_is_found_and_projected_is_the_references": {
            "a contact's weights are exchanged (gpu)": ("store_quad(contacts.weights, place, at[0], at[1], at[2], at[3])", "store_quad(contacts.weights, place, at[1], at[0], at[2], at[3])"),
        },
    },
    "gpu_backend/contact/particles_find.py": {
        "simulator/test_simulated_particle_contacts.py::test_neighbours_are_those_of_asking_all": {
            "the hash cell of bodies forgets a row of cells (gpu)": ("for row in range(9):", "for row in range(8):"),
            "a hash cell's own row is taken for another (gpu)": ("first, end = starts[bucket], np.int32(bucket + THREE)", "first, end = starts[bucket], np.int32(bucket + THREE - ONE)"),
            "particles below 0 share a cell with those above (gpu)": ("return np.int32(whole - ONE) if place < real(whole) else whole", "return whole"),
        },
    },
    "gpu_backend/contact/pins.py": {
        "simulator/test_simulated_bits.py::test_kernels_have_the_bits_of_the_cpu[xpbd-driven-float32]": {
            "pins are where the substep began (gpu)": ("time = instant(number + 1, parameters.dt", "time = instant(number, parameters.dt"),
        },
    },
    "gpu_backend/contact/particles_project.py": {
        "simulator/test_simulated_particle_contacts.py::test_what_is_projected_is_the_references simulator/test_simulated_particle_contacts.py::test_two_in_one_place_part_upwards_and_downwards": {
            "a contact counts from where the particle was (gpu)": ("d = p[0] - q[0], p[1] - q[1], p[2] - q[2]\n                    active", "d = start[0] - q[0], start[1] - q[1], start[2] - q[2]\n                    active"),
            "who goes down is decided anew (gpu)": ("d, b, i < j, distance", "d, b, True, distance"),
        },
    },
    "gpu_backend/shape_matching/kernels.py": {
        "simulator/test_simulated_bits.py::test_kernels_have_the_bits_of_the_cpu[bodies-float32]": {
            "a lane skips its second entry (gpu)": ("np.int32(starts[c] + lane), starts[c + ONE], LANES_32)", "np.int32(starts[c] + lane), starts[c + ONE], LANES_32 + LANES_32)"),
            "a cluster's moments are read by columns (gpu)": ("xx, xy, xz = added(xx, wx, m[0]), added(xy, wx, m[1]), added(xz, wx, m[2])", "xx, xy, xz = added(xx, wx, m[0]), added(xy, wy, m[0]), added(xz, wz, m[0])"),
        },
    },
    "model/formulas/integrators.py": {
        "test_float32_leaks.py": {
            "a constant of float64 in a float32 step": ("return position + new_velocity * dt, new_velocity", "return position + float(1) * new_velocity * dt, new_velocity"),
        },
    },
    "model/formulas/wind.py": {
        "test_float32_leaks.py": {"a root of float64 in a float32 wind": ("smooth = part * part * (3.0 - 2.0 * part)", "smooth = part * part * (float(3) - 2.0 * part)")},
    },
})  # fmt: skip

KERNELS = (*CPU, *GPU)
