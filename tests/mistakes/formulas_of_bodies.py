"""Mistakes in formulas of contacts, clusters, fluids and tetrahedra."""

from __future__ import annotations

from .mistake import mistakes_of

BODIES = mistakes_of({
    "model/formulas/contact.py": {
        "test_contact_formulas.py": {
            "neighbours in the sheet are held apart by the thickness": ("min(min(thickness, rest), gap + push)", "min(thickness, gap + push)"),
            "a contact's own load is forgotten": ("return weight * load + ((a", "return weight + ((a"),
            "a contact sticks by the dynamic coefficient": ("if sliding <= static_friction * depth:", "if sliding <= dynamic_friction * depth:"),
        },
    },
    "model/formulas/surface_contact.py": {
        "test_surface_contacts.py::test_contacts_are_the_references test_surface_contacts.py::test_what_begins_inside_is_led_out_slowly": {
            "what lies inside is led farther in": ("return True, -(rx / distance), -(ry / distance), -(rz / distance)", "return True, rx / distance, ry / distance, rz / distance"),
            "behind is outside": ("if side < -(0.25 * distance):", "if side < -distance - distance:"),
        },
    },
    "model/formulas/particle_contact.py": {
        "test_contact_formulas.py": {
            "particles are split by the other's contacts": ("stiffness = weight * contacts + other_weight * other_contacts", "stiffness = weight * other_contacts + other_weight * contacts"),
            "adhesion pushes": ("return max(distance - length, -pull) if", "return min(length - distance, pull) if"),
            "friction is not pressed by adhesion": ("max(depth, 0.0) + pull", "max(depth, 0.0)"),
            "what began nearer parts at once": ("+ push)", "+ distance)"),
            "a bounce is added to the speed": ("lack = restitution * came - ((b[0] * n[0] + b[1] * n[1]) + b[2] * n[2])", "lack = restitution * came + ((b[0] * n[0] + b[1] * n[1]) + b[2] * n[2])"),
        },
    },
    "model/formulas/shape_matching/cluster.py": {
        "test_cluster_formulas.py": {
            "a body leans": ("return moment - position_sum * rest_offset", "return moment"),
            "goals are rotated backwards": ("return centre + ((a * x + b * y) + c * z)", "return centre - ((a * x + b * y) + c * z)"),
            "a lane is counted twice": ("(((a + i) + (e + m)) + ((c + k)", "(((a + i) + (e + m)) + ((a + k)"),
        },
    },
    "model/formulas/rotation.py": {
        "test_rotation.py::test_in_two_dimensions test_rotation.py::test_quaternions_turn_as_their_matrices": {
            "a rotation's entry with the other sign": ("(ww + xx) - (yy + zz), xy - wz, xz + wy,", "(ww + xx) - (yy + zz), xy + wz, xz + wy,"),
            "a rotation that mirrors": ("s = scale * yx - scale * xy", "s = scale * yx + scale * xy"),
        },
    },
    "model/formulas/shape_matching/grid.py": {
        "test_cluster_formulas.py": {
            "rows of a window count upwards": ("rotation_2d(sums[2], -sums[4], sums[3], -sums[5], 1.0, 0.0)", "rotation_2d(sums[2], sums[4], sums[3], sums[5], 1.0, 0.0)"),
            "goals of a window lie below": ("(sums[3] - sums[4] * down)", "(sums[3] + sums[4] * down)"),
        },
    },
    "model/formulas/shape_matching/pace.py": {
        "test_cluster_formulas.py": {"a spin about the first particle": ("return moment - (a * b - c * d) * inverse_mass", "return moment")},
    },
    "model/formulas/motion.py": {
        "test_motion.py::test_the_velocity_is_the_positions_derivative test_motion.py::test_sine_and_cosine_are_within_two_units_in_the_last_place_of_one": {
            "a moving pin turns backwards": ("px = x + ((sine * tx + lifted * nx) + passed * vx)", "px = x + ((lifted * nx - sine * tx) + passed * vx)"),
            "the third quadrant is the first": ("return -sine, -cosine", "return sine, cosine"),
        },
    },
    "model/formulas/implicit.py": {
        "test_implicit.py::test_the_matrix_of_a_stretched_spring_is_the_forces_derivative": {
            "a stretched spring has no stiffness across": ("across = max(0.0, stiffness - stiffness_rest * inverse)", "across = 0.0 * inverse"),
        },
    },
    "model/formulas/shape_matching/deformation.py": {
        "test_cluster_formulas.py": {
            "shear counts half": ("0.5 * (dot(rxx, ryx, rzx, fxy, fyy, fzy)", "(dot(rxx, ryx, rzx, fxy, fyy, fzy)"),
            "a volume's cube root without its last steps": ("y = y * ((cube + 2.0 * volume) / (2.0 * cube + volume))", "y = y"),
        },
    },
    "model/contact/particle_parameters.py": {
        "test_particle_pairs.py": {
            "a cell smaller than the search": ('"inverse_cell": 1 / float(rows[:, :, G_SEARCH_RADIUS].max())', '"inverse_cell": 2 / float(rows[:, :, G_SEARCH_RADIUS].max())'),
            "groups that avoid each other meet": ("collide = one.group not in other.avoids and", "collide = one.group not in other.avoids or"),
        },
    },
    "model/formulas/constraints/attachment.py": {
        "test_attachments.py::test_two_free_bodies_that_are_attached_keep_their_momentum test_attachments.py::test_a_body_on_soft_attachments_hangs_as_low_as_they_give": {
            "a body is not moved by what is attached to it": ("moved(p, -wp, change), moved(q, -wq, change)", "moved(p, wp, change), moved(q, wq, change)"),
            "a soft attachment forgets what it holds": ("(-violation - compliance * multiplier) * inverse", "-violation"),
        },
        "test_near.py::test_states_are_the_references[tetrahedra-tied-float64] test_cloth_beside.py::test_momentum_goes_from_the_cloth_to_bodies_and_back": {
            "a cloth is not moved by what is attached to it": ("moved(q, -wq, change), moved(r, -wr, change),\n    )", "moved(q, wq, change), moved(r, wr, change),\n    )"),
        },
    },
    "model/contact/attachments.py": {
        "test_cloth_beside.py::test_attachments_hold_both_ways_and_contacts_leave_them_alone": {
            "contacts push at what is attached to a cloth": ('if one.model != "world":\n            free', 'if one.model == "bodies":\n            free'),
        },
    },
    "model/particles/tetrahedra/masses.py": {
        "test_matter.py::test_a_limit_of_masses_keeps_the_total": {
            "a limit of masses is one of their logarithms": ("asked = bounds[near.indices] / ratio", "asked = bounds[near.indices] / ratio**2"),
        },
    },
    "model/tetrahedra/targets.py": {
        "test_kinematic.py::test_pinned_vertices_go_to_their_targets_and_rest_there": {
            "a target is reached in half a step": ("(position - self.resting) / dt", "2 * (position - self.resting) / dt"),
        },
    },
    "model/core/stability/divergence.py": {
        "test_physics_diverged.py::test_a_coordinate_beyond_a_million_times_the_size_has_diverged": {
            "diverged beyond 1e9 sizes": ("DIVERGED_SIZE = 1e6", "DIVERGED_SIZE = 1e9"),
        },
    },
})  # fmt: skip
