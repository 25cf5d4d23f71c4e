"""Mistakes in the physics: formulas, and what is made of a scene before it is stepped."""

from __future__ import annotations

from .mistake import mistakes_of

FORMULAS = mistakes_of({
    "model/formulas/fluid/density.py": {
        "test_fluid_kernels.py test_fluid_cpu.py": {
            "a fluid pulls as it pushes": ("return min(multiplier - factor * c, 0.0) - multiplier", "return (multiplier - factor * c) - multiplier"),
            "the kernel is squared and not cubed": ("return total + (t * t) * t", "return total + (t * t)"),
            "a wall draws": ("return -(wall_gradient * (t * t))", "return wall_gradient * (t * t)"),
            "walls in a corner are counted twice": ("return larger + min(total, density) * max(1.0 - larger, 0.0)", "return total + density"),
            "a wall does not push": ("return total + change * w", "return total"),
            "factors forget what neighbours move": ("return total + weight * ((s * s) * squared_distance)", "return total"),
        },
    },
    "model/formulas/fluid/divergence.py": {
        "test_fluid_divergence.py test_fluid_cpu.py": {
            "what comes nearer goes away": ("return total - s * ((dx * ex + dy * ey) + dz * ez)", "return total + s * ((dx * ex + dy * ey) + dz * ez)"),
            "a surface is pressed as the inside is": ("if c > -SPARSE else -1.0", "if c > -1.0 else -1.0"),
            "what density there is is forgotten": ("return c + dt * approach", "return dt * approach"),
            "the last iteration goes on too": ("if turn + 1 < iterations else 0.0", "if iterations > 0 else 0.0"),
            "a fluid draws by velocities": ("return min(ahead - factor * c, 0.0)", "return ahead - factor * c"),
            "a wall is not gone against": ("return total + ((wx * x + wy * y) + wz * z)", "return total"),
        },
    },
    "model/formulas/fluid/motion.py": {
        "test_fluid_cpu.py": {
            "smoothing drives velocities apart": ("return total + weight * (other_velocity - velocity)", "return total - weight * (other_velocity - velocity)"),
            "cohesion drives apart": ("return total - pull * d", "return total + pull * d"),
            "vorticity is confined the other way": ("((ra * wb - rb * wa) / rise_length)", "((rb * wa - ra * wb) / rise_length)"),
            "a surface has no drag": ("dt * (drag + surface_drag * fraction)", "dt * drag"),
        },
    },
    "model/formulas/springs.py": {
        "test_formulas.py": {
            "springs of the grid push": ("scale = stiffness - stiffness_rest * inverse_length(squared_length(dx, dy))", "scale = stiffness_rest * inverse_length(squared_length(dx, dy)) - stiffness"),
            "a damper drives": ("return acceleration - rate * velocity", "return acceleration + rate * velocity"),
        },
        "test_point_formulas.py": {
            "springs of a cloth are dampers that drive": ("scale = (stiffness - stiffness_rest * inverse) + damping * speed * inverse", "scale = (stiffness - stiffness_rest * inverse) - damping * speed * inverse"),
            "springs of a cloth have no length at rest": ("scale = stiffness - stiffness_rest * inverse_length(squared_length_3d(dx, dy, dz))", "scale = stiffness"),
            "a damper feels the whole velocity along one axis": ("((wx * dx + wy * dy) + wz * dz) * inverse  # at which", "((wx * dx + wy * dy) + wz * dx) * inverse  # at which"),
        },
    },
    "model/formulas/lengths.py": {
        "test_formulas.py test_point_formulas.py": {"no root in the inverse length": ("return 1.0 / sqrt(squared) if", "return 1.0 / squared if")},
    },
    "model/formulas/integrators.py": {
        "test_formulas.py": {
            "semi-implicit Euler drifts by the old velocity": ("return position + new_velocity * dt, new_velocity", "return position + velocity * dt, new_velocity"),
            "a whole kick for velocity Verlet's first half": ("half_velocity = velocity + half_dt * acceleration", "half_velocity = velocity + dt * acceleration"),
            "velocity Verlet's damper is left out of its second half": ("velocity = velocity * inverse_damping", "velocity = velocity * (inverse_damping / inverse_damping)"),
            "the hand-out's step takes all of a dt^2": ("new_position = position + velocity * dt + acceleration * half_dt_squared", "new_position = position + velocity * dt + acceleration * (dt * dt)"),
            "taylor forgets the acceleration's way": ("return position + velocity * dt + acceleration * half_dt_squared, velocity", "return position + velocity * dt, velocity"),
            "Runge-Kutta's stages start from the last one": ("return base + derivative_dt * rate, total + total_dt * rate", "return total + derivative_dt * rate, total + total_dt * rate"),
        },
    },
    "model/formulas/random.py": {
        "test_formulas.py": {
            "nine rounds of the generator": ("for _ in range(10):", "for _ in range(9):"),
            "random forces of one sign": ("return odd * SCALE - 1.0", "return odd * SCALE"),
        },
    },
    "model/formulas/wind.py": {
        "test_point_formulas.py": {
            "drag has the sign of the normal": ("drag * abs(through)", "drag * through"),
            "lift leads the other way": ("along_normal = lift * through * (squared", "along_normal = -lift * through * (squared"),
            "gusts go straight from one to the next": ("part * part * (3.0 - 2.0 * part)", "part"),
        },
    },
    "model/formulas/bending.py": {
        "test_point_formulas.py test_bending.py": {
            "a dihedral hinge's slope without its t^2": ("return edge * (1.0 + t * t)", "return edge * 1.0"),
            "a dihedral hinge of a quarter": ("-(4.0 * edge * (t - rest))", "-(edge * (t - rest))"),
            "the gradients by a hinge's ends are exchanged": ("return -((1.0 - along_c) * uc) - (1.0 - along_d) * ud, -(along_c * uc) - along_d * ud", "return -(along_c * uc) - along_d * ud, -((1.0 - along_c) * uc) - (1.0 - along_d) * ud"),
            "an isometric hinge's compliance pushes": ("return (-(part * k) - compliance * multiplier) * reciprocal", "return (-(part * k) + compliance * multiplier) * reciprocal"),
            "a bent hinge is held at its length and once more": ("return 1.0 - rest * inverse_length(squared)", "return 1.0 + rest * inverse_length(squared)"),
            "a hinge does not see on which side it is bent": ("0.5 * sine / adjacent", "0.5 * abs(sine) / adjacent"),
        },
    },
    "model/formulas/colliders.py": {
        "test_collider_formulas.py": {
            "a capsule without its end": ("((dx * ex + dy * ey) + dz * ez) / squared, 0.0), 1.0)", "((dx * ex + dy * ey) + dz * ez) / squared, 0.0), 2.0)"),
            "a capsule whose axis points the other way": ("return sphere(dx - part * ex, dy - part * ey, dz - part * ez, radius)", "return sphere(dx + part * ex, dy + part * ey, dz + part * ez, radius)"),
            "out of a box by the farthest face": ("if qx >= qy and qx >= qz:", "if qx <= qy and qx <= qz:"),
            "a fast mass meets the far side of a ball": ("(-toward - sqrt(discriminant)) / squared", "(-toward + sqrt(discriminant)) / squared"),
            "the static cone is as wide as the dynamic one": ("if tangential <= -normal * static_friction:", "if tangential <= -normal * dynamic_friction:"),
            "the static cone of what bounces ignores what comes back": ("if tangential <= taken * static_friction:", "if tangential <= -normal * static_friction:"),
            "friction pushes": ("remaining = 1.0 - dynamic_friction * -normal", "remaining = 1.0 + dynamic_friction * -normal"),
            "restitution takes the velocity along": ("back = restitution * -normal if", "back = restitution * normal if"),
        },
    },
    "model/formulas/distance.py": {
        "test_point_formulas.py": {
            "compliance has the wrong sign": ("change = ((rest - squared * inverse) - compliance * multiplier) * reciprocal", "change = ((rest - squared * inverse) + compliance * multiplier) * reciprocal"),
            "a constraint's damper drives": ("stretch = (length - rest) + damping", "stretch = (length - rest) - damping"),
            "compliance is left out of the denominator": ("return 1.0 / (stiffening * weight + compliance) if", "return 1.0 / (stiffening * weight) if"),
            "averages are sums": ("(weight * total) * (1.0 / valence)", "(weight * total)"),
            "a tether pulls through its anchor": ("return anchor + factor * d if", "return anchor - factor * d if"),
        },
    },
})  # fmt: skip
