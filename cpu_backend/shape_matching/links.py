"""Links of bodies on CPU threads: the constraints of a colour, none of which share a particle."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from cpu_backend.core.compile import Compiler
from model.formulas import distance


def make_link_projection(compiler: Compiler, real: Any) -> Any:
    """project(first, last, position, weights, ends, values, multipliers, fresh): links `first` to before `last`, in three
    planes of positions. `ends` (links, 2): slots of particles; `values` (links, 2): see model/shape_matching/links.py;
    `multipliers` (links,) count as 0 where `fresh`."""
    formulas = distance.make(real, compiler.compiled)
    squared_length, reciprocal = formulas.squared_length_3d, formulas.reciprocal
    soft_change, moved = formulas.soft_change, formulas.moved
    zero, one = real(0), real(1)

    @compiler.compiled
    def project(first, last, position, weights, ends, values, multipliers, fresh):
        count = weights.size
        for n in range(first, last):
            a, b, rest, compliance = ends[n, 0], ends[n, 1], values[n, 0], values[n, 1]
            wa, wb = weights[a], weights[b]
            dx, dy = position[b] - position[a], position[count + b] - position[count + a]
            dz = position[2 * count + b] - position[2 * count + a]
            inverse = reciprocal(wa + wb, one, compliance)
            multiplier = zero if fresh else multipliers[n]
            change, scale = soft_change(squared_length(dx, dy, dz), rest, inverse, compliance, multiplier)
            multipliers[n] = multiplier + change
            position[b] = moved(position[b], wb, scale, dx)
            position[count + b] = moved(position[count + b], wb, scale, dy)
            position[2 * count + b] = moved(position[2 * count + b], wb, scale, dz)
            position[a] = moved(position[a], wa, -scale, dx)
            position[count + a] = moved(position[count + a], wa, -scale, dy)
            position[2 * count + a] = moved(position[2 * count + a], wa, -scale, dz)

    return project


@cache
def make_link_stage(real: Any, math: str) -> Any:
    """project(bands, start, stop, position, weights, ends, values, multipliers, fresh): a colour, by itself."""
    compiler = Compiler(f"bodies_links_{np.dtype(real).name}_{math}", math)
    some = make_link_projection(compiler, real)

    def project(band, bands, start, stop, position, weights, ends, values, multipliers, fresh):
        first, last = start + (stop - start) * band // bands, start + (stop - start) * (band + 1) // bands
        some(first, last, position, weights, ends, values, multipliers, fresh)

    return compiler.banded(project)
