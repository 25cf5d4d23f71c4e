"""Projections of a mesh's constraints as CUDA kernels: a thread for each constraint of a colour, none of which share a
mass."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numba import cuda

from gpu_backend.core.compile import make_kernel, variant_name
from gpu_backend.core.formulas import device_formulas
from gpu_backend.core.quads import load_quad, store_quad
from gpu_backend.mass_spring.grid.point import kernel_options
from gpu_backend.mass_spring.grid.strips import inlined
from model.formulas import bending, distance
from model.xpbd.parameters import X_COMPLIANCE, X_CONSTRAINT, X_DAMPING, X_STIFFENING


@cache
def make_mesh_projection(real: Any, math: str, parts: frozenset[str], kind: str) -> Any:
    """project(position, before, corners, values, multipliers, start, stop, count, fresh, record): constraints `start` to
    before `stop` of a family of `count` (model/xpbd/mesh_constraints.py), whose arrays are flat and lie column by column, so
    that neighbouring threads read neighbouring numbers. `multipliers` count as 0 where `fresh`."""
    matter = frozenset(part for part in parts if part.startswith(kind))
    make = make_distance
    if kind == "bending" and "bending-isometric" in parts:
        make = make_isometric
    if kind == "bending" and "bending-dihedral" in parts:
        make = make_dihedral
    one = make(real, math, matter, kind)

    def project(position, before, corners, values, multipliers, start, stop, count, fresh, record):
        n = np.int32(start + cuda.grid(1))
        if n < stop:
            one(position, before, corners, values, multipliers, n, np.int32(count), fresh, record)

    return make_kernel(project, f"mesh_{variant_name(real, math, kind, matter)}", **kernel_options(math))


def make_distance(real: Any, math: str, parts: frozenset[str], kind: str) -> Any:
    """As in model/formulas/distance.py."""
    formulas, inline = device_formulas(distance.make, real, math), inlined(math)
    squared_length, reciprocal, moved = formulas.squared_length_3d, formulas.reciprocal, formulas.moved
    rigid_change, soft_change, damped_change = formulas.rigid_change, formulas.soft_change, formulas.damped_change
    along_3d = formulas.along_3d
    is_soft, is_damped = f"{kind}-compliance" in parts, f"{kind}-damping" in parts
    begin = X_CONSTRAINT[kind]
    c_compliance, c_damping, c_stiffening = begin + X_COMPLIANCE, begin + X_DAMPING, begin + X_STIFFENING
    zero = real(0)

    @inline
    def along_of(before, first, second, dx, dy, dz):
        a, b = load_quad(before, first), load_quad(before, second)
        return along_3d(dx, dy, dz, dx - (b[0] - a[0]), dy - (b[1] - a[1]), dz - (b[2] - a[2]))

    @inline
    def project(position, before, corners, values, multipliers, n, count, fresh, record):
        first, second, rest = corners[n], corners[count + n], values[n]
        a, b = load_quad(position, first), load_quad(position, second)
        dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        squared = squared_length(dx, dy, dz)
        compliance, stiffening = record[c_compliance], record[c_stiffening]
        inverse = reciprocal(a[3] + b[3], stiffening, compliance)
        multiplier = zero
        if is_soft:
            if not fresh:
                multiplier = multipliers[n]
        if is_damped:
            along = along_of(before, first, second, dx, dy, dz)
            change, scale = damped_change(squared, rest, inverse, compliance, multiplier, record[c_damping], along)
        elif is_soft:
            change, scale = soft_change(squared, rest, inverse, compliance, multiplier)
        else:
            change, scale = rigid_change(squared, rest, inverse)
        if is_soft:
            multipliers[n] = multiplier + change
        store_quad(
            position, second, moved(b[0], b[3], scale, dx), moved(b[1], b[3], scale, dy), moved(b[2], b[3], scale, dz), b[3]
        )  # fmt: skip
        store_quad(
            position, first, moved(a[0], a[3], -scale, dx), moved(a[1], a[3], -scale, dy), moved(a[2], a[3], -scale, dz), a[3]
        )  # fmt: skip

    return project


def make_isometric(real: Any, math: str, parts: frozenset[str], kind: str) -> Any:
    """As in model/formulas/bending.py: three multipliers, one an axis."""
    formulas, inline = device_formulas(bending.make, real, math), inlined(math)
    reciprocal = device_formulas(distance.make, real, math).reciprocal
    softness, curvature, square_sum, kept_part = (
        formulas.softness, formulas.curvature, formulas.square_sum, formulas.kept_part
    )  # fmt: skip
    isometric_change, shifted = formulas.isometric_change, formulas.shifted
    is_soft, begin = "bending-compliance" in parts, X_CONSTRAINT[kind]
    c_compliance, c_stiffening = begin + X_COMPLIANCE, begin + X_STIFFENING
    zero = real(0)

    @inline
    def axis_of(kb, kc, kd, a, b, c, d):
        return curvature(kb, kc, kd, b - a, c - a, d - a)

    @inline
    def change_of(part, k, inverse, compliance, multipliers, place, fresh):
        multiplier = zero
        if is_soft:
            if not fresh:
                multiplier = multipliers[place]
        change = isometric_change(part, k, inverse, compliance, multiplier)
        if is_soft:
            multipliers[place] = multiplier + change
        return change

    @inline
    def shift(position, k, p, coefficient, x, y, z):
        store_quad(
            position, k, shifted(p[0], p[3], coefficient, x), shifted(p[1], p[3], coefficient, y),
            shifted(p[2], p[3], coefficient, z), p[3],
        )  # fmt: skip

    @inline
    def project(position, before, corners, values, multipliers, n, count, fresh, record):
        ia, ib, ic, id_ = corners[n], corners[count + n], corners[2 * count + n], corners[3 * count + n]
        ka, kb, kc, kd = values[n], values[count + n], values[2 * count + n], values[3 * count + n]
        rest, area = values[4 * count + n], values[5 * count + n]
        a, b, c, d = load_quad(position, ia), load_quad(position, ib), load_quad(position, ic), load_quad(position, id_)
        compliance = softness(record[c_compliance], area)
        weight = square_sum(a[3], b[3], c[3], d[3], ka, kb, kc, kd)
        inverse = reciprocal(weight, record[c_stiffening], compliance)
        x, y, z = (
            axis_of(kb, kc, kd, a[0], b[0], c[0], d[0]), axis_of(kb, kc, kd, a[1], b[1], c[1], d[1]),
            axis_of(kb, kc, kd, a[2], b[2], c[2], d[2]),
        )  # fmt: skip
        part = kept_part(x, y, z, rest)
        x = change_of(part, x, inverse, compliance, multipliers, n, fresh)
        y = change_of(part, y, inverse, compliance, multipliers, count + n, fresh)
        z = change_of(part, z, inverse, compliance, multipliers, 2 * count + n, fresh)
        shift(position, ia, a, ka, x, y, z)
        shift(position, ib, b, kb, x, y, z)
        shift(position, ic, c, kc, x, y, z)
        shift(position, id_, d, kd, x, y, z)

    return project


def make_dihedral(real: Any, math: str, parts: frozenset[str], kind: str) -> Any:
    """As in model/formulas/bending.py."""
    formulas, inline = device_formulas(bending.make, real, math), inlined(math)
    reciprocal = device_formulas(distance.make, real, math).reciprocal
    softness, hinge, by_ends, dot = formulas.softness, formulas.hinge, formulas.by_ends, formulas.dot
    steepness, gradient_sum, dihedral_change = formulas.steepness, formulas.gradient_sum, formulas.dihedral_change
    shifted = formulas.shifted
    is_soft, begin = "bending-compliance" in parts, X_CONSTRAINT[kind]
    c_compliance, c_stiffening = begin + X_COMPLIANCE, begin + X_STIFFENING
    zero = real(0)

    @inline
    def shift(position, k, p, gx, gy, gz, change):
        store_quad(
            position, k, shifted(p[0], p[3], gx, change), shifted(p[1], p[3], gy, change), shifted(p[2], p[3], gz, change),
            p[3]
        )  # fmt: skip

    @inline
    def project(position, before, corners, values, multipliers, n, count, fresh, record):
        ia, ib, ic, id_ = corners[n], corners[count + n], corners[2 * count + n], corners[3 * count + n]
        edge, rest, area = values[n], values[count + n], values[2 * count + n]
        a, b, c, d = load_quad(position, ia), load_quad(position, ib), load_quad(position, ic), load_quad(position, id_)
        t, cx, cy, cz, dx, dy, dz, along_c, along_d = hinge(
            b[0] - a[0], b[1] - a[1], b[2] - a[2], c[0] - a[0], c[1] - a[1], c[2] - a[2], d[0] - a[0], d[1] - a[1],
            d[2] - a[2],
        )  # fmt: skip
        ax, bx = by_ends(along_c, along_d, cx, dx)
        ay, by = by_ends(along_c, along_d, cy, dy)
        az, bz = by_ends(along_c, along_d, cz, dz)
        steep = steepness(edge, t)
        weight = gradient_sum(
            steep, a[3], b[3], c[3], d[3], dot(ax, ay, az, ax, ay, az), dot(bx, by, bz, bx, by, bz),
            dot(cx, cy, cz, cx, cy, cz), dot(dx, dy, dz, dx, dy, dz),
        )  # fmt: skip
        compliance = softness(record[c_compliance], area)
        inverse = reciprocal(weight, record[c_stiffening], compliance)
        multiplier = zero
        if is_soft:
            if not fresh:
                multiplier = multipliers[n]
        change, turned = dihedral_change(edge, t, rest, steep, inverse, compliance, multiplier)
        if is_soft:
            multipliers[n] = multiplier + change
        shift(position, ia, a, ax, ay, az, turned)
        shift(position, ib, b, bx, by, bz, turned)
        shift(position, ic, c, cx, cy, cz, turned)
        shift(position, id_, d, dx, dy, dz, turned)

    return project
