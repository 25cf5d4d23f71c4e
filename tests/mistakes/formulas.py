"""Mistakes in the physics: formulas, and what is made of a scene before it is stepped."""

from __future__ import annotations

from .mistake import Mistake, in_file

FORMULAS: tuple[Mistake, ...] = (
    *in_file(
        "model/formulas/fluid/density.py",
        "test_fluid_kernels.py test_fluid_cpu.py",
        {
            "a fluid pulls as it pushes": (
                "return min(multiplier - factor * c, zero) - multiplier",
                "return (multiplier - factor * c) - multiplier",
            ),
            "the poly6 kernel is squared and not cubed": ("return total + (t * t) * t", "return total + (t * t)"),
            "a wall draws": ("return -(wall_gradient * (square * square))", "return wall_gradient * (square * square)"),
            "walls in a corner are counted twice": (
                "return (total + share) - total * share",
                "return total + share",
            ),
            "a wall's pressure is not mirrored": ("return total + (two * change) * w", "return total + change * w"),
            "factors forget what neighbours move": (
                "return total + weight * ((s * s) * squared_distance)",
                "return total",
            ),
        },
    ),
    *in_file(
        "model/formulas/fluid/divergence.py",
        "test_fluid_divergence.py test_fluid_cpu.py",
        {
            "what comes nearer goes away": (
                "return total - s * ((dx * ex + dy * ey) + dz * ez)",
                "return total + s * ((dx * ex + dy * ey) + dz * ez)",
            ),
            "a surface is pressed as the inside is": ("if c > -sparse else -one", "if c > -one else -one"),
            "what density there is is forgotten": ("return c + dt * approach", "return dt * approach"),
            "the last iteration goes on too": ("if turn + 1 < iterations else zero", "if iterations > 0 else zero"),
            "a fluid draws by velocities": ("return min(ahead - factor * c, zero)", "return ahead - factor * c"),
            "a wall is not gone against": ("return total + ((wx * x + wy * y) + wz * z)", "return total"),
        },
    ),
    *in_file(
        "model/formulas/fluid/motion.py",
        "test_fluid_cpu.py",
        {
            "smoothing drives velocities apart": (
                "return total + share * (other_velocity - velocity)",
                "return total - share * (other_velocity - velocity)",
            ),
            "cohesion drives apart": ("return total - pull * d", "return total + pull * d"),
            "vorticity is confined the other way": (
                "((ra * wb - rb * wa) / rise_length)",
                "((rb * wa - ra * wb) / rise_length)",
            ),
            "a surface has no drag": ("dt * (drag + surface_drag * share)", "dt * drag"),
        },
    ),
    *in_file(
        "model/formulas/springs.py",
        "test_formulas.py",
        {
            "springs of the grid push": (
                "scale = stiffness - stiffness_rest * inverse_length(squared_length(dx, dy))",
                "scale = stiffness_rest * inverse_length(squared_length(dx, dy)) - stiffness",
            ),
            "a damper drives": ("return acceleration - rate * velocity", "return acceleration + rate * velocity"),
        },
    ),
    *in_file(
        "model/formulas/lengths.py",
        "test_formulas.py test_point_formulas.py",
        {"no root in the inverse length": ("return one / sqrt(squared) if", "return one / squared if")},
    ),
    *in_file(
        "model/formulas/integrators.py",
        "test_formulas.py",
        {
            "semi-implicit Euler drifts by the old velocity": (
                "return position + new_velocity * dt, new_velocity",
                "return position + velocity * dt, new_velocity",
            ),
            "a whole kick for velocity Verlet's first half": (
                "half_velocity = velocity + half_dt * acceleration",
                "half_velocity = velocity + dt * acceleration",
            ),
            "velocity Verlet's damper is left out of its second half": (
                "velocity = velocity * inverse_damping",
                "velocity = velocity * (inverse_damping / inverse_damping)",
            ),
            "the hand-out's step takes all of a dt^2": (
                "new_position = position + velocity * dt + acceleration * half_dt_squared",
                "new_position = position + velocity * dt + acceleration * (dt * dt)",
            ),
            "taylor forgets the acceleration's way": (
                "return position + velocity * dt + acceleration * half_dt_squared, velocity",
                "return position + velocity * dt, velocity",
            ),
            "Runge-Kutta's stages start from the last one": (
                "return base + derivative_dt * rate, total + total_dt * rate",
                "return total + derivative_dt * rate, total + total_dt * rate",
            ),
        },
    ),
    *in_file(
        "model/formulas/random.py",
        "test_formulas.py",
        {
            "nine rounds of the generator": ("for _ in range(10):", "for _ in range(9):"),
            "random forces of one sign": ("return odd * scale - one", "return odd * scale"),
        },
    ),
    *in_file(
        "model/formulas/springs.py",
        "test_point_formulas.py",
        {
            "springs of a cloth are dampers that drive": (
                "scale = (stiffness - stiffness_rest * inverse) + damping * speed * inverse",
                "scale = (stiffness - stiffness_rest * inverse) - damping * speed * inverse",
            ),
            "springs of a cloth have no length at rest": (
                "scale = stiffness - stiffness_rest * inverse_length(squared_length(dx, dy, dz))",
                "scale = stiffness",
            ),
            "a damper feels the whole velocity along one axis": (
                "((wx * dx + wy * dy) + wz * dz) * inverse  # at which",
                "((wx * dx + wy * dy) + wz * dx) * inverse  # at which",
            ),
        },
    ),
    *in_file(
        "model/formulas/wind.py",
        "test_point_formulas.py",
        {
            "drag has the sign of the normal": ("drag * abs(through)", "drag * through"),
            "lift leads the other way": (
                "along_normal = lift * through * (squared",
                "along_normal = -lift * through * (squared",
            ),
            "gusts go straight from one to the next": ("part * part * (three - two * part)", "part"),
        },
    ),
    *in_file(
        "model/formulas/bending.py",
        "test_point_formulas.py test_bending.py",
        {
            "a dihedral hinge's slope without its t^2": ("return edge * (one + t * t)", "return edge * one"),
            "a dihedral hinge of a quarter": ("-(four * edge * (t - rest))", "-(edge * (t - rest))"),
            "the gradients by a hinge's ends are exchanged": (
                "return -((one - along_c) * uc) - (one - along_d) * ud, -(along_c * uc) - along_d * ud",
                "return -(along_c * uc) - along_d * ud, -((one - along_c) * uc) - (one - along_d) * ud",
            ),
            "an isometric hinge's compliance pushes": (
                "return (-(part * k) - compliance * multiplier) * reciprocal",
                "return (-(part * k) + compliance * multiplier) * reciprocal",
            ),
            "a bent hinge is held at its length and once more": (
                "return one - rest * inverse_length(squared)",
                "return one + rest * inverse_length(squared)",
            ),
            "a hinge does not see on which side it is bent": ("half * sine / adjacent", "half * abs(sine) / adjacent"),
        },
    ),
    *in_file(
        "model/formulas/colliders.py",
        "test_collider_formulas.py",
        {
            "a capsule without its end": ("((dx * ex + dy * ey) + dz * ez) / squared, zero), one)", "((dx * ex + dy * ey) + dz * ez) / squared, zero), two)"),
            "a capsule whose axis points the other way": (
                "return from_center(dx - part * ex, dy - part * ey, dz - part * ez, radius)",
                "return from_center(dx + part * ex, dy + part * ey, dz + part * ez, radius)",
            ),
            "out of a box by the farthest face": ("if qx >= qy and qx >= qz:", "if qx <= qy and qx <= qz:"),
            "a fast mass meets the far side of a ball": (
                "(-toward - root(discriminant)) / squared",
                "(-toward + root(discriminant)) / squared",
            ),
            "the static cone is as wide as the dynamic one": (
                "if tangential <= -normal * static_friction:",
                "if tangential <= -normal * dynamic_friction:",
            ),
            "the static cone of what bounces ignores what comes back": (
                "if tangential <= taken * static_friction:",
                "if tangential <= -normal * static_friction:",
            ),
            "friction pushes": ("keep = one - dynamic_friction * -normal", "keep = one + dynamic_friction * -normal"),
            "restitution takes the velocity along": ("back = restitution * -normal if", "back = restitution * normal if"),
        },
    ),
    *in_file(
        "model/formulas/distance.py",
        "test_point_formulas.py",
        {
            "compliance has the wrong sign": (
                "change = ((rest - squared * inverse) - compliance * multiplier) * reciprocal",
                "change = ((rest - squared * inverse) + compliance * multiplier) * reciprocal",
            ),
            "a constraint's damper drives": (
                "stretch = (squared * inverse - rest) + damping",
                "stretch = (squared * inverse - rest) - damping",
            ),
            "compliance is left out of the denominator": (
                "return one / (stiffening * weight + compliance) if",
                "return one / (stiffening * weight) if",
            ),
            "averages are sums": ("(weight * total) * (one / valence)", "(weight * total)"),
            "a tether pulls through its anchor": ("return anchor + factor * d if", "return anchor - factor * d if"),
        },
    ),
    *in_file(
        "model/formulas/contact.py",
        "test_contact_formulas.py",
        {
            "neighbours in the sheet are held apart by the thickness": ("min(min(thickness, rest), gap + push)", "min(thickness, gap + push)"),
            "a contact's own load is forgotten": ("return weight * load + ((a", "return weight + ((a"),
            "a contact sticks by the dynamic coefficient": ("if sliding <= static_friction * depth:", "if sliding <= dynamic_friction * depth:"),
        },
    ),
    *in_file(
        "model/formulas/surface_contact.py",
        "test_surface_contacts.py::test_contacts_are_the_references test_surface_contacts.py::test_what_begins_inside_is_led_out_slowly",
        {
            "what lies inside is led farther in": (
                "return True, -(rx / distance), -(ry / distance), -(rz / distance)",
                "return True, rx / distance, ry / distance, rz / distance",
            ),
            "behind is outside": ("if side < -(behind * distance):", "if side < -distance - distance:"),
        },
    ),
    *in_file(
        "model/formulas/particle_contact.py",
        "test_contact_formulas.py",
        {
            "particles are split by the other's contacts": (
                "stiffness = weight * contacts + other_weight * other_contacts",
                "stiffness = weight * other_contacts + other_weight * contacts",
            ),
            "adhesion pushes": ("return max(distance - length, -pull) if", "return min(length - distance, pull) if"),
            "friction is not pressed by adhesion": ("max(depth, zero) + pull", "max(depth, zero)"),
            "what began nearer parts at once": ("+ push)", "+ distance)"),
            "a bounce is added to the speed": (
                "lack = restitution * came - ((bx * nx + by * ny) + bz * nz)",
                "lack = restitution * came + ((bx * nx + by * ny) + bz * nz)",
            ),
        },
    ),
    *in_file(
        "model/formulas/shape_matching/cluster.py",
        "test_cluster_formulas.py",
        {
            "a body leans": ("return moment - way * lean", "return moment"),
            "goals are rotated backwards": (
                "return centre + ((a * x + b * y) + c * z)",
                "return centre - ((a * x + b * y) + c * z)",
            ),
            "a lane is counted twice": ("(((a + i) + (e + m)) + ((c + k)", "(((a + i) + (e + m)) + ((a + k)"),
        },
    ),
    *in_file(
        "model/formulas/rotation.py",
        "test_rotation.py::test_in_two_dimensions test_rotation.py::test_quaternions_turn_as_their_matrices",
        {
            "a rotation's entry with the other sign": ("(ww + xx) - (yy + zz), xy - wz, xz + wy,", "(ww + xx) - (yy + zz), xy + wz, xz + wy,"),
            "a rotation that mirrors": ("s = scale * yx - scale * xy", "s = scale * yx + scale * xy"),
        },
    ),
    *in_file(
        "model/formulas/shape_matching/grid.py",
        "test_cluster_formulas.py",
        {
            "rows of a window count upwards": ("rotation_2d(sums[2], -sums[4], sums[3], -sums[5], one, zero)", "rotation_2d(sums[2], sums[4], sums[3], sums[5], one, zero)"),
            "goals of a window lie below": ("(sums[3] - sums[4] * down)", "(sums[3] + sums[4] * down)"),
        },
    ),
    *in_file(
        "model/formulas/shape_matching/pace.py",
        "test_cluster_formulas.py",
        {"a spin about the first particle": ("return moment - (a * b - c * d) * inverse_mass", "return moment")},
    ),
    *in_file(
        "model/formulas/motion.py",
        "test_motion.py::test_the_velocity_is_the_positions_derivative test_motion.py::test_sine_and_cosine_are_within_two_units_in_the_last_place_of_one",
        {
            "a moving pin turns backwards": ("px = x + ((sine * tx + lifted * nx) + passed * vx)", "px = x + ((lifted * nx - sine * tx) + passed * vx)"),
            "the third quadrant is the first": ("return -sine, -cosine", "return sine, cosine"),
        },
    ),
    *in_file(
        "model/formulas/implicit.py",
        "test_implicit.py::test_the_matrix_of_a_stretched_spring_is_the_forces_derivative",
        {"a stretched spring has no stiffness across": ("across = max(zero, stiffness - stiffness_rest * inverse)", "across = zero * inverse")},
    ),
    *in_file(
        "model/formulas/shape_matching/deformation.py",
        "test_cluster_formulas.py",
        {
            "shear counts half": ("half * (dot(rxx, ryx, rzx, fxy, fyy, fzy)", "(dot(rxx, ryx, rzx, fxy, fyy, fzy)"),
            "a volume's cube root without its last steps": ("y = y * ((cube + two * volume) / (two * cube + volume))", "y = y"),
        },
    ),
    *in_file(
        "model/contact/particle_parameters.py",
        "test_particle_pairs.py",
        {
            "a cell smaller than the search": ('"inverse_cell": 1 / float(rows[:, :, G_REACH].max())', '"inverse_cell": 2 / float(rows[:, :, G_REACH].max())'),
            "groups that avoid each other meet": ("meets = one.group not in other.avoids and", "meets = one.group not in other.avoids or"),
        },
    ),
    *in_file(
        "model/formulas/constraints/attachment.py",
        "test_attachments.py::test_two_free_bodies_that_are_attached_keep_their_momentum test_attachments.py::test_a_body_on_soft_attachments_hangs_as_low_as_they_give",
        {
            "a body is not moved by what is attached to it": ("moved(p, -wp, change), moved(q, -wq, change)", "moved(p, wp, change), moved(q, wq, change)"),
            "a soft attachment forgets what it holds": ("(-violation - compliance * multiplier) * inverse", "-violation"),
        },
    ),
    *in_file(
        "model/formulas/constraints/attachment.py",
        "test_cloth_beside.py::test_states_are_the_references test_cloth_beside.py::test_momentum_goes_from_the_cloth_to_bodies_and_back",
        {"a cloth is not moved by what is attached to it": ("moved(q, -wq, change), moved(r, -wr, change),\n        )", "moved(q, wq, change), moved(r, wr, change),\n        )")},
    ),
    *in_file(
        "model/tetrahedra/attachments.py",
        "test_cloth_beside.py::test_attachments_hold_both_ways_and_contacts_leave_them_alone",
        {"contacts push at what is attached to a cloth": ('if one.model != "world":\n            free', 'if one.model == "bodies":\n            free')},
    ),
    *in_file(
        "model/tetrahedra/masses.py",
        "test_matter.py::test_a_limit_of_masses_keeps_the_total",
        {"a limit of masses is one of their logarithms": ("asked = found[near.indices] / ratio", "asked = found[near.indices] / ratio**2")},
    ),
    *in_file(
        "model/tetrahedra/targets.py",
        "test_kinematic.py::test_pinned_vertices_go_to_their_targets_and_rest_there",
        {"a target is reached in half a step": ("(position - self.held) / dt", "2 * (position - self.held) / dt")},
    ),
    *in_file(
        "model/core/stability/divergence.py",
        "test_physics_diverged.py::test_a_coordinate_beyond_a_million_times_the_size_has_diverged",
        {"diverged beyond 1e9 sizes": ("DIVERGED_SIZE = 1e6", "DIVERGED_SIZE = 1e9")},
    ),
)  # fmt: skip
