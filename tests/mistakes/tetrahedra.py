"""Mistakes in tetrahedral bodies: rows of XPBD, vertex block descent, Newton's method, attachments, targets, sleep."""

from __future__ import annotations

from .mistake import mistakes_of

STATES = "test_tetrahedra_cpu.py::test_states_are_the_references[damped]"
SIMULATED_VBD = "simulator/test_simulated_bits.py::test_kernels_have_the_bits_of_the_cpu[vbd-everything-float32]"
SIMULATED_NEWTON = "simulator/test_simulated_bits.py::test_kernels_have_the_bits_of_the_cpu[newton-damped-float32]"
RESIDENT = "simulator/test_simulated_bits.py::test_kernels_have_the_bits_of_the_cpu[xpbd-slabs-of-2-float32]"
ORDER_2 = "test_newton_order.py::test_steps_are_the_judges"

XPBD = mistakes_of({
    "model/formulas/constraints/tetrahedron.py": {
        STATES: {
            "a tetrahedron's damper drives": ("((-violation - accumulated) - along) * inverse", "((-violation - accumulated) + along) * inverse"),
            "a tetrahedron forgets its multiplier": ("((-violation - accumulated) - along) * inverse", "(-violation - along) * inverse"),
            "the fourth corner of a tetrahedron weighs as the third": ("+ wd * dot(gd[0], gd[1]", "+ wc * dot(gd[0], gd[1]"),
            "the compliance of a length is not scaled by its square": ("scaled_compliance = scaled(compliance, squared)", "scaled_compliance = scaled(compliance, sqrt(squared))"),
        },
    },
    "model/formulas/constraints/voxel_volume.py": {
        "test_voxel_volumes.py::test_states_are_the_references[voxels]": {
            "the volumes of two of a voxel's tetrahedra are exchanged": ("less_one(te, qe, se, re)", "less_one(te, qe, re, se)"),
        },
    },
    "model/geometry/colouring.py": {
        "test_colouring.py": {"a colour takes constraints that share a corner": ("blocked[at[takes]] = True", "blocked[at[takes][:, 0]] = True")},
    },
    "model/tetrahedra/voxel_order.py": {
        "test_voxel_order.py": {"the third axis of a voxel does not colour it": ("* 4 + 2 * odd[:, 1] + odd[:, 2]", "* 4 + 2 * odd[:, 1] + odd[:, 1]")},
    },
    "gpu_backend/core/constraints.py": {
        "simulator/test_simulated_bits.py::test_kernels_have_the_bits_of_the_cpu[xpbd-voxels-float32]": {
            "a run's corners are read at the place of its first constraint (gpu)": ("np.int32(start // np.int32(FEATURE.run) + thread), place, count)", "np.int32(start + thread), place, count)"),
        },
    },
    "gpu_backend/tetrahedra/resident.py": {
        RESIDENT: {
            "a slab sends its border as it was before the sweep (gpu)": ("send_border(messages, borders + above, now, local_count, others, tag)", "send_border(messages, borders + above, before, local_count, others, tag)"),
            "the upper slab's vertices replace the slab's first ones (gpu)": ("hear(messages, above, now, local_count, others, tag, failed)", "hear(messages, above, now, 0, others, tag, failed)"),
        },
    },
    "cpu_backend/tetrahedra/sleep.py": {
        "simulator/test_simulated_sleep.py": {
            "a vertex sleeps beside one that moves (cpu)": ("still = still and slow[neighbours[n]] == 1", "still = still and slow[k] == 1"),
            "a sleeping vertex keeps its velocity (cpu)": ("position[k, axis], velocity[k, axis] = before[k, axis], 0.0", "position[k, axis] = before[k, axis]"),
        },
    },
    "gpu_backend/tetrahedra/sleep.py": {
        "simulator/test_simulated_sleep.py": {
            "the velocity of the substep before is not stored (gpu)": ("store_quad(earlier, k, v[0], v[1], v[2], 0.0)", "store_quad(earlier, k, 0.0, 0.0, 0.0, 0.0)"),
        },
    },
})  # fmt: skip

DESCENT = mistakes_of({
    "model/formulas/elastic/descent.py": {
        "test_elastic_formulas.py::test_a_visit_solves_its_system": {
            "a vertex's block loses an entry beside its diagonal": ("bx = (gx * first - yx * by) - zx * bz", "bx = gx * first - yx * by"),
        },
    },
    "cpu_backend/tetrahedra/descent_kernels.py": {
        "test_vbd_cpu.py::test_one_vertex_is_where_backward_euler_has_it test_vbd_reference.py": {
            "a visit takes its vertex for the tetrahedron's first corner (cpu)": ("element(points, numbers, old, entries[n] & 3, rate)", "element(points, numbers, old, entries[n] & 1, rate)"),
            "the last colour of vertices is left out (cpu)": ("for colour in range(starts.size - 1):", "for colour in range(starts.size - 2):"),
        },
        "test_vbd_cpu.py::test_at_rest_no_number_of_iterations_moves_it": {
            "bodies with pins begin from where inertia takes them (cpu)": ("if falls[k] == 0:", "if falls[k] < 0:"),
        },
    },
    "gpu_backend/tetrahedra/descent_kernels.py": {
        SIMULATED_VBD: {
            "every colour visits the first one's vertices (gpu)": ("k, count = np.int32(first + cuda.grid(1)), np.int32(arrays.number)", "k, count = np.int32(cuda.grid(1)), np.int32(arrays.number)"),
            "strains of a damper are read by rows (gpu)": ("tuple(strains[np.uint32(np.int32(n * count) + t)]", "tuple(strains[np.uint32(np.int32(n + STRAINS * t))]"),
        },
        "simulator/test_simulated_bits.py::test_kernels_have_the_bits_of_the_cpu[vbd-meeting-float32]": {
            "acceleration goes on from the last sweep, not the one before it (gpu)": ("older = load_quad(iterates, count + k)", "older = load_quad(iterates, k)"),
        },
    },
    "model/tetrahedra/descent.py": {
        "test_descent_lists.py": {
            "a vertex takes the colour of all neighbours but the last": ("taken |= bits[other]", "taken = bits[other]"),
            "vertices keep the order of particles, not of colours": ('free = free[np.argsort(rank[colours[free]], kind="stable")]', "free = free[np.argsort(free)]"),
            "bodies with pins fall and free ones do not": ("falls = (~supported_particles(body_set)[order])", "falls = supported_particles(body_set)[order]"),
        },
        "test_shares.py::test_shares_have_the_bits_of_one[bar-by-vertices-3]": {
            "a part's vertices name tetrahedra of the whole": ("CORNERS * np.searchsorted(inside, entries // CORNERS) + entries % CORNERS", "entries"),
        },
    },
})  # fmt: skip

NEWTON = mistakes_of({
    "model/formulas/elastic/stages.py": {
        ORDER_2: {
            "the second stage begins behind the first one's end": ("return x + (SCALE * h) * v, v + SCALE * (v - start)", "return x + (SCALE * h) * v, v - SCALE * (v - start)"),
        },
    },
    "model/formulas/elastic/damper.py": {
        ORDER_2: {"a damper of the second stage counts the first one's strain back": ("e[0] - AHEAD * first[0], e[1]", "e[0] + AHEAD * first[0], e[1]")},
    },
    "cpu_backend/tetrahedra/newton_steps.py": {
        ORDER_2: {
            "dampers of the first stage count from the last one's (cpu)": ("vectors.first_start, vectors.first_end, number % 2 == 1)", "vectors.first_start, vectors.first_end, number % 2 == 0)"),
            "the first stage's end is stored as its start (cpu)": ("origin = vectors.first_end if number % 2 else vectors.first_start", "origin = vectors.first_start"),
        },
    },
    "cpu_backend/tetrahedra/newton_rows.py": {
        "test_newton.py::test_steps_are_the_judges test_newton_coarse.py::test_a_step_needs_few_products_whatever_the_stiffness": {
            "every direction is the steepest descent's (cpu)": ("direction[k, axis] = preconditioned[k, axis] + beta * direction[k, axis]", "direction[k, axis] = preconditioned[k, axis]"),
            "the residual is left where it was (cpu)": ("residual[k, axis] = residual[k, axis] - alpha * applied[k, axis]", "residual[k, axis] = residual[k, axis]"),
        },
    },
    "cpu_backend/tetrahedra/newton_coarse.py": {
        "test_newton_coarse.py": {
            "a row of the coarse matrix is subtracted from its first column on (cpu)": ("band[i, j] = band[i, j] - factor * band[k, i - k + j]", "band[i, j] = band[i, j] - factor * band[k, j]"),
        },
    },
    "gpu_backend/tetrahedra/newton_rows.py": {
        SIMULATED_NEWTON: {
            "a block of the matrix is not transposed below its diagonal (gpu)": ("if item & 1:", "if item < 0:"),
            "the residual begins uphill (gpu)": ("store_quad(v.residual, k, -g[0], -g[1], -g[2], 0.0)", "store_quad(v.residual, k, g[0], g[1], g[2], 0.0)"),
        },
    },
})  # fmt: skip

HOLDING = mistakes_of({
    "model/tetrahedra/springs.py": {
        "test_attachments.py::test_who_hangs_from_a_body_with_pins_does_not_fall": {
            "a body that hangs from another one is free": ("supported[joined[either]] = True", "supported[joined[either, 1]] = True"),
        },
        "test_attachments.py::test_a_step_is_backward_eulers[newton-0.001]": {
            "the place in the world of an attachment is not read": ("rows[:, AT_POINT : AT_POINT + 3] = one.values[:, :3]", "rows[:, AT_POINT : AT_POINT + 3] = 0"),
        },
    },
    "gpu_backend/tetrahedra/springs.py": {
        "simulator/test_simulated_bits.py::test_kernels_have_the_bits_of_the_cpu[newton-attached-float32]": {
            "the fifth corner of a spring is its first (gpu)": ("pull(points, numbers, (entry >> 1) & 7)", "pull(points, numbers, (entry >> 1) & 3)"),
        },
    },
    "model/tetrahedra/targets.py": {
        "test_kinematic.py::test_pinned_vertices_go_to_their_targets_and_rest_there test_kinematic.py": {
            "a loaded state's pins keep the targets of before": ("self._goals.rest_at(np.asarray(state.position, np.float64)[self.body.pinned])", "self._goals.rest()"),
            "pins go on past their targets": ("elf._goals is not None and -1 < self._goals.step != self.step", "elf._goals is not None and -1 < self._goals.step == self.step"),
        },
    },
})  # fmt: skip

TETRAHEDRA = (*XPBD, *DESCENT, *NEWTON, *HOLDING)
