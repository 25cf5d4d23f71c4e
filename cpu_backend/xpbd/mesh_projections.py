"""Projections of a mesh's constraints, one after the other: distances, and the two models of bending."""

from __future__ import annotations

from typing import Any

from cpu_backend.core.compile import Compiler
from model.formulas import bending, distance
from model.xpbd.parameters import X_COMPLIANCE, X_CONSTRAINT, X_DAMPING, X_STIFFENING

AXES = 3


def make_projection(compiler: Compiler, real: Any, parts: frozenset[str], kind: str) -> Any:
    """project(first, last, position, before, corners, values, multipliers, fresh, record): constraints `first` to before
    `last` of a family (model/xpbd/mesh_constraints.py). `multipliers` (constraints, 3), of which a scalar constraint has the
    first, count as 0 where `fresh`."""
    if "bending-isometric" in parts and kind == "bending":
        return make_isometric(compiler, real, parts)
    if "bending-dihedral" in parts and kind == "bending":
        return make_dihedral(compiler, real, parts)
    return make_distance(compiler, real, parts, kind)


def make_distance(compiler: Compiler, real: Any, parts: frozenset[str], kind: str) -> Any:
    """As in model/formulas/distance.py."""
    formulas = distance.make(real, compiler.compiled)
    squared_length, reciprocal, moved = formulas.squared_length_3d, formulas.reciprocal, formulas.moved
    rigid_change, soft_change, damped_change = formulas.rigid_change, formulas.soft_change, formulas.damped_change
    along_3d = formulas.along_3d
    is_soft, is_damped = f"{kind}-compliance" in parts, f"{kind}-damping" in parts
    begin = X_CONSTRAINT[kind]
    c_compliance, c_damping, c_stiffening = begin + X_COMPLIANCE, begin + X_DAMPING, begin + X_STIFFENING
    zero = real(0)

    @compiler.compiled
    def project(first, last, position, before, corners, values, multipliers, fresh, record):
        compliance, damping, stiffening = record[c_compliance], record[c_damping], record[c_stiffening]
        for k in range(first, last):
            a, b, rest = corners[k, 0], corners[k, 1], values[k, 0]
            wa, wb = position[a, 3], position[b, 3]
            dx, dy = position[b, 0] - position[a, 0], position[b, 1] - position[a, 1]
            dz = position[b, 2] - position[a, 2]
            squared = squared_length(dx, dy, dz)
            inverse = reciprocal(wa + wb, stiffening, compliance)
            multiplier = multipliers[k, 0] if is_soft and not fresh else zero
            if is_damped:
                along = along_3d(
                    dx, dy, dz, dx - (before[b, 0] - before[a, 0]), dy - (before[b, 1] - before[a, 1]),
                    dz - (before[b, 2] - before[a, 2]),
                )  # fmt: skip
                change, scale = damped_change(squared, rest, inverse, compliance, multiplier, damping, along)
            elif is_soft:
                change, scale = soft_change(squared, rest, inverse, compliance, multiplier)
            else:
                change, scale = rigid_change(squared, rest, inverse)
            if is_soft:
                multipliers[k, 0] = multiplier + change
            position[b, 0] = moved(position[b, 0], wb, scale, dx)
            position[b, 1] = moved(position[b, 1], wb, scale, dy)
            position[b, 2] = moved(position[b, 2], wb, scale, dz)
            position[a, 0] = moved(position[a, 0], wa, -scale, dx)
            position[a, 1] = moved(position[a, 1], wa, -scale, dy)
            position[a, 2] = moved(position[a, 2], wa, -scale, dz)

    return project


def make_isometric(compiler: Compiler, real: Any, parts: frozenset[str]) -> Any:
    """As in model/formulas/bending.py: three multipliers, one an axis."""
    formulas, reciprocal = bending.make(real, compiler.compiled), distance.make(real, compiler.compiled).reciprocal
    softness, curvature, square_sum, kept_part = (
        formulas.softness, formulas.curvature, formulas.square_sum, formulas.kept_part
    )  # fmt: skip
    isometric_change, shifted = formulas.isometric_change, formulas.shifted
    is_soft, begin = "bending-compliance" in parts, X_CONSTRAINT["bending"]
    c_compliance, c_stiffening = begin + X_COMPLIANCE, begin + X_STIFFENING
    zero = real(0)

    @compiler.compiled
    def axis_of(kb, kc, kd, position, a, b, c, d, axis):
        x = position[a, axis]
        return curvature(kb, kc, kd, position[b, axis] - x, position[c, axis] - x, position[d, axis] - x)

    @compiler.compiled
    def project(first, last, position, before, corners, values, multipliers, fresh, record):
        for n in range(first, last):
            a, b, c, d = corners[n, 0], corners[n, 1], corners[n, 2], corners[n, 3]
            ka, kb, kc, kd = values[n, 0], values[n, 1], values[n, 2], values[n, 3]
            rest, area = values[n, 4], values[n, 5]
            wa, wb, wc, wd = position[a, 3], position[b, 3], position[c, 3], position[d, 3]
            compliance = softness(record[c_compliance], area)
            inverse = reciprocal(square_sum(wa, wb, wc, wd, ka, kb, kc, kd), record[c_stiffening], compliance)
            x = axis_of(kb, kc, kd, position, a, b, c, d, 0)
            y = axis_of(kb, kc, kd, position, a, b, c, d, 1)
            z = axis_of(kb, kc, kd, position, a, b, c, d, 2)
            part = kept_part(x, y, z, rest)
            for axis in range(AXES):
                k = x if axis == 0 else y if axis == 1 else z
                multiplier = multipliers[n, axis] if is_soft and not fresh else zero
                change = isometric_change(part, k, inverse, compliance, multiplier)
                if is_soft:
                    multipliers[n, axis] = multiplier + change
                position[a, axis] = shifted(position[a, axis], wa, ka, change)
                position[b, axis] = shifted(position[b, axis], wb, kb, change)
                position[c, axis] = shifted(position[c, axis], wc, kc, change)
                position[d, axis] = shifted(position[d, axis], wd, kd, change)

    return project


def make_dihedral(compiler: Compiler, real: Any, parts: frozenset[str]) -> Any:
    """As in model/formulas/bending.py."""
    formulas, reciprocal = bending.make(real, compiler.compiled), distance.make(real, compiler.compiled).reciprocal
    softness, hinge, by_ends, dot = formulas.softness, formulas.hinge, formulas.by_ends, formulas.dot
    steepness, gradient_sum, dihedral_change = formulas.steepness, formulas.gradient_sum, formulas.dihedral_change
    shifted = formulas.shifted
    is_soft, begin = "bending-compliance" in parts, X_CONSTRAINT["bending"]
    c_compliance, c_stiffening = begin + X_COMPLIANCE, begin + X_STIFFENING
    zero = real(0)

    @compiler.compiled
    def way(position, a, b):
        return position[b, 0] - position[a, 0], position[b, 1] - position[a, 1], position[b, 2] - position[a, 2]

    @compiler.compiled
    def shift(position, k, weight, gx, gy, gz, change):
        position[k, 0] = shifted(position[k, 0], weight, gx, change)
        position[k, 1] = shifted(position[k, 1], weight, gy, change)
        position[k, 2] = shifted(position[k, 2], weight, gz, change)

    @compiler.compiled
    def project(first, last, position, before, corners, values, multipliers, fresh, record):
        for n in range(first, last):
            a, b, c, d = corners[n, 0], corners[n, 1], corners[n, 2], corners[n, 3]
            edge, rest, area = values[n, 0], values[n, 1], values[n, 2]
            wa, wb, wc, wd = position[a, 3], position[b, 3], position[c, 3], position[d, 3]
            ex, ey, ez = way(position, a, b)
            fx, fy, fz = way(position, a, c)
            gx, gy, gz = way(position, a, d)
            t, cx, cy, cz, dx, dy, dz, along_c, along_d = hinge(ex, ey, ez, fx, fy, fz, gx, gy, gz)
            ax, bx = by_ends(along_c, along_d, cx, dx)
            ay, by = by_ends(along_c, along_d, cy, dy)
            az, bz = by_ends(along_c, along_d, cz, dz)
            steep = steepness(edge, t)
            weight = gradient_sum(
                steep, wa, wb, wc, wd, dot(ax, ay, az, ax, ay, az), dot(bx, by, bz, bx, by, bz),
                dot(cx, cy, cz, cx, cy, cz), dot(dx, dy, dz, dx, dy, dz),
            )  # fmt: skip
            compliance = softness(record[c_compliance], area)
            inverse = reciprocal(weight, record[c_stiffening], compliance)
            multiplier = multipliers[n, 0] if is_soft and not fresh else zero
            change, turned = dihedral_change(edge, t, rest, steep, inverse, compliance, multiplier)
            if is_soft:
                multipliers[n, 0] = multiplier + change
            shift(position, a, wa, ax, ay, az, turned)
            shift(position, b, wb, bx, by, bz, turned)
            shift(position, c, wc, cx, cy, cz, turned)
            shift(position, d, wd, dx, dy, dz, turned)

    return project
