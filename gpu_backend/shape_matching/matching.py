"""Shape matching of a grid on CUDA: a thread sums the window around its mass, then one sums the goals of its windows.

model/formulas/shape_matching/grid.py defines the order of sums. No atomics: clusters are in separate memory, a quad
each (centre x, centre y, cosine, sine), and a mass reads those of the windows that contain it.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.device import DeviceArray, Stream
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.sheet import lattice_place
from softlab.model.assets.lattice import matching_axis
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, inlined_routine, real, routine
from softlab.model.formulas.shape_matching.grid import (
    added_goal,
    added_goal_row,
    added_member,
    added_row,
    cluster,
    moved,
    rest_offset,
)
from softlab.model.scene.scene import Scene

WEIGHT, INVERSE, CENTRE, MASS, COUNT = range(5)  # of a table (5, rows or columns), model/shape_matching/matching.py
ONE = np.int32(1)


@inlined_routine
def window(i, count):
    """Return (first, behind the last) of the window of `i`."""
    half_width = np.int32(FEATURE.region)
    return max(np.int32(0), np.int32(i - half_width)), min(count, np.int32(i + half_width + ONE))


@routine
def match(position, clusters, row_table, table, rows, columns):
    """Write the clusters of a grid."""
    i, j = lattice_place()
    rows, columns = np.int32(rows), np.int32(columns)
    if i < rows and j < columns:
        here = load_quad(position, np.int32(i * columns + j))
        sums = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        top, bottom = window(i, rows)
        left, right = window(j, columns)
        for row in range(top, bottom):
            middle = load_quad(position, np.int32(row * columns + j))
            line = 0.0, 0.0, 0.0, 0.0
            for k in range(left, right):
                if k != j:
                    p = load_quad(position, np.int32(row * columns + k))
                    line = added_member(
                        line, p[0], p[1], middle[0], middle[1], table[WEIGHT, k],
                        real(np.int32(k - j)), table[CENTRE, j],
                    )  # fmt: skip
            down = real(np.int32(row - i)) - row_table[CENTRE, i]
            sums = added_row(
                sums, line, middle[0], middle[1], here[0], here[1], table[MASS, j],
                row_table[WEIGHT, row], down,
            )  # fmt: skip
        x, y, cosine, sine = cluster(sums, here[0], here[1], row_table[INVERSE, i], table[INVERSE, j])
        store_quad(clusters, np.int32(i * columns + j), x, y, cosine, sine)


@routine
def move(position, target, clusters, row_table, table, record, rows, columns):
    """Move masses from `position` to `target` (quads) towards their goals; pinned masses, of weight 0, stay."""
    parameters = record[0]
    i, j = lattice_place()
    rows, columns = np.int32(rows), np.int32(columns)
    if i < rows and j < columns:
        k = np.int32(i * columns + j)
        p = load_quad(position, k)
        displacement_x, displacement_y, rest = 0.0, 0.0, parameters.matching_rest
        top, bottom = window(i, rows)
        left, right = window(j, columns)
        for row in range(top, bottom):
            middle = load_quad(clusters, np.int32(row * columns + j))
            along = rest_offset(0.0, table[CENTRE, j], rest)
            sums = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            sums = added_goal(sums, middle[0], middle[1], middle[0], middle[1], middle[2], middle[3], along)
            for column in range(left, right):
                if column != j:
                    c = load_quad(clusters, np.int32(row * columns + column))
                    along = rest_offset(real(np.int32(j - column)), table[CENTRE, column], rest)
                    sums = added_goal(sums, c[0], c[1], middle[0], middle[1], c[2], c[3], along)
            down = rest_offset(real(np.int32(i - row)), row_table[CENTRE, row], rest)
            displacement_x, displacement_y = added_goal_row(
                displacement_x, displacement_y, sums, p[0], p[1], middle[0], middle[1], table[COUNT, j], down
            )
        x, y = p[0], p[1]
        if p[3] != 0.0:
            weight, matching = table[WEIGHT, j], parameters.matching
            x = moved(x, row_table[WEIGHT, i], weight, matching, displacement_x)
            y = moved(y, row_table[WEIGHT, i], weight, matching, displacement_y)
        store_quad(target, k, x, y, p[2], p[3])


@cache
def make_matching(real: Real, math: str, region: int) -> SimpleNamespace:
    """Compile `match(position, clusters, row_table, column_table, rows, columns)` and `move(position, target, clusters,
    row_table, column_table, record, rows, columns)`."""
    variant = device_variant(real, math, {"region": region})
    return kernels_of(variant, math, (match, move), f"matching_{variant_name(real, math, region)}")


class Matching:
    """The clusters of a grid and their tables on the device. `launch`: the configuration of one thread per mass;
    `shape`: (rows, columns); `stream`: of all copies."""

    launches = 2  # of an iteration

    def __init__(self, scene: Scene, real: Real, math: str, launch: tuple, stream: Stream):
        self.kernels = make_matching(real, math, scene.method.region)
        counts = scene.grid.rows, scene.grid.columns
        self.shape = tuple(np.int32(count) for count in counts)
        self.launch = launch
        self.tables = tuple(
            cuda.to_device(matching_axis(count, scene.method.region).table(real), stream=stream) for count in counts
        )
        self.clusters = cuda.to_device(np.zeros(SIZE * scene.grid.particle_count, real), stream=stream)

    def match(self, position: DeviceArray) -> None:
        self.kernels.match[self.launch](position, self.clusters, *self.tables, *self.shape)

    def move(self, position: DeviceArray, target: DeviceArray, record: DeviceArray) -> None:
        self.kernels.move[self.launch](position, target, self.clusters, *self.tables, record, *self.shape)
