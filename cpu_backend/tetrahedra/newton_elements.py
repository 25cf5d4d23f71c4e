"""What Newton's method asks of a tetrahedron, on CPU threads: its energy, forces at its corners, blocks of its tangent."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from cpu_backend.core.compile import Compiler
from model.formulas.constraints.tetrahedron import HOOKEAN
from model.formulas.elastic import deformation, newton, tangent
from model.tetrahedra.block_rows import BLOCKS
from model.tetrahedra.newton import AT_ALPHA, AT_DAMPING, AT_LAME, AT_MU, AT_VOLUME, SUMMED


def make_elements(compiler: Compiler, real: Any) -> SimpleNamespace:
    """`look(first, last, points, elements, forces, sums)`: energies, and forces on the four corners, of the tetrahedra of
    the groups `first` to before `last` of SUMMED; `blocks(first, last, points, elements, damped, safe, found)`: their
    tangents, in rows of BLOCKS blocks, times the damping time where `damped`. `elements`: (corners, materials, values)."""
    compiled = compiler.compiled
    elastic, shape = deformation.make_gradient(real, compiled), tangent.make(real, compiled)
    gradient, at_corners, rotation = elastic.gradient, elastic.corners, deformation.make_rotation(real, compiled)
    stress, frame, moduli, block, seen_in = shape.stress, shape.frame, shape.moduli, shape.block, shape.seen_in
    doubt, zero, one = newton.make(real, compiled).doubt, real(0), real(1)

    @compiled
    def row(points, k):
        return points[k, 0], points[k, 1], points[k, 2]

    @compiled
    def rest_of(values, n):
        return (
            values[n, 0], values[n, 1], values[n, 2], values[n, 3], values[n, 4], values[n, 5], values[n, 6], values[n, 7],
            values[n, 8],
        )  # fmt: skip

    @compiled
    def deformed(points, corners, rest, n):
        a, b, c, d = corners[n, 0], corners[n, 1], corners[n, 2], corners[n, 3]
        return gradient(row(points, a), row(points, b), row(points, c), row(points, d), rest)

    @compiled
    def put(forces, n, corner, volume, g):
        forces[n, 3 * corner] = volume * g[0]
        forces[n, 3 * corner + 1] = volume * g[1]
        forces[n, 3 * corner + 2] = volume * g[2]

    @compiled
    def look(first, last, points, elements, forces, sums):
        corners, materials, values = elements
        for group in range(first, last):
            total, unsure = zero, zero
            for n in range(group * SUMMED, min((group + 1) * SUMMED, len(corners))):
                material, rest, volume = materials[n], rest_of(values, n), values[n, AT_VOLUME]
                f = deformed(points, corners, rest, n)
                r = f if material == HOOKEAN else rotation(f)
                held, p = stress(material, f, r, values[n, AT_MU], values[n, AT_LAME], values[n, AT_ALPHA])
                a, b, c, d = at_corners(p, rest)
                put(forces, n, 0, volume, a)
                put(forces, n, 1, volume, b)
                put(forces, n, 2, volume, c)
                put(forces, n, 3, volume, d)
                total = total + volume * held
                unsure = unsure + doubt(held, volume, values[n, AT_MU], values[n, AT_LAME], material == HOOKEAN)
            sums[0, group], sums[1, group] = total, unsure

    @compiled
    def complete(first, found):
        """The blocks of the first corner: with the others of a row they add up to nothing."""
        for i in range(3):
            for j in range(3):
                m, t = 3 * i + j, 3 * j + i
                b = -((found[first + 4, m] + found[first + 5, t]) + found[first + 6, t])
                c = -((found[first + 5, m] + found[first + 7, m]) + found[first + 8, t])
                d = -((found[first + 6, m] + found[first + 8, m]) + found[first + 9, m])
                found[first, m], found[first + 1, m] = -((b + c) + d), b
                found[first + 2, m], found[first + 3, m] = c, d

    @compiled
    def blocks(first, last, points, elements, damped, safe, found):
        corners, materials, values = elements
        for n in range(first * SUMMED, min(last * SUMMED, len(corners))):
            rest = rest_of(values, n)
            f = deformed(points, corners, rest, n)
            s, u, v = frame(f, rotation(f))
            axial, sums, offs = moduli(materials[n], s, values[n, AT_MU], values[n, AT_LAME], values[n, AT_ALPHA], safe)
            weight = values[n, AT_VOLUME] * (values[n, AT_DAMPING] if damped else one)
            b = seen_in(v, rest[0], rest[1], rest[2])
            c = seen_in(v, rest[3], rest[4], rest[5])
            d = seen_in(v, rest[6], rest[7], rest[8])
            seen, place = (b, c, d), n * BLOCKS + 4
            for p in range(3):  # a loop, so that a block is compiled once
                for q in range(p, 3):
                    h = block(u, axial, sums, offs, seen[p], seen[q])
                    for m in range(9):
                        found[place, m] = weight * h[m]
                    place += 1
            complete(n * BLOCKS, found)

    return SimpleNamespace(look=look, blocks=blocks, row=row)
