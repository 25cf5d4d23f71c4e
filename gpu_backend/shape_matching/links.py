"""Links of bodies on CUDA: a thread for each link of a colour, none of which share a particle."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numba import cuda

from gpu_backend.core.compile import make_kernel, variant_name
from gpu_backend.core.formulas import device_formulas
from gpu_backend.core.quads import load_quad, store_quad
from gpu_backend.mass_spring.grid.point import kernel_options
from model.formulas import distance


@cache
def make_link_projection(real: Any, math: str) -> Any:
    """project(position, ends, values, multipliers, start, stop, count, fresh): links `start` to before `stop` of `count`,
    whose arrays lie column by column: `ends` both particles, `values` (model/shape_matching/links.py). `multipliers` count
    as 0 where
    `fresh`. Positions are quads with the particles' weights."""
    formulas = device_formulas(distance.make, real, math)
    squared_length, reciprocal = formulas.squared_length_3d, formulas.reciprocal
    soft_change, moved = formulas.soft_change, formulas.moved
    zero, one = real(0), real(1)

    def project(position, ends, values, multipliers, start, stop, count, fresh):
        n = np.int32(np.int32(cuda.grid(1)) + start)
        if n < stop:
            first, second, rest, compliance = ends[n], ends[count + n], values[n], values[count + n]
            a, b = load_quad(position, first), load_quad(position, second)
            dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
            multiplier = zero
            if not fresh:
                multiplier = multipliers[n]
            inverse = reciprocal(a[3] + b[3], one, compliance)
            change, scale = soft_change(squared_length(dx, dy, dz), rest, inverse, compliance, multiplier)
            multipliers[n] = multiplier + change
            store_quad(
                position, second, moved(b[0], b[3], scale, dx), moved(b[1], b[3], scale, dy), moved(b[2], b[3], scale, dz),
                b[3],
            )  # fmt: skip
            store_quad(
                position, first, moved(a[0], a[3], -scale, dx), moved(a[1], a[3], -scale, dy), moved(a[2], a[3], -scale, dz),
                a[3],
            )  # fmt: skip

    return make_kernel(project, f"bodies_links_{variant_name(real, math)}", **kernel_options(math))
