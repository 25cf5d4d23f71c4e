"""Choice of the default kernel of a simulation, and the sizes that kernels run with.

The states do not depend on either. Measured on 2 cores of an AMD EPYC (Zen 4, 1 MiB second-level cache per core, 32 MiB
third-level), libgomp, lab-grid in `fast` math; time of a step relative to `fused`, interleaved, median of 9, machine
not idle:

  grid       bytes of both states    threads 1          2              4              8
                                  team  tiled    team  tiled    team  tiled    team  tiled
  32^2       0.04 MB  float32     0.55   0.69    0.37   0.48    0.07   0.11    0.09   0.12
  256^2      2.2 MB               0.95   0.98    0.93   0.95    0.40   0.43    0.37   0.46
  512^2      8.7 MB               1.00   1.06    0.97   1.16
  724^2      17 MB                0.99   0.97    0.99   0.97
  1024^2     34 MB                0.96   0.68    0.96   0.69    0.92   0.66    0.81   0.66
  2048^2     135 MB               1.02   0.59    1.07   0.52    0.96   0.46    0.98   0.45
  256^2      4.4 MB   float64                    0.99   1.00
  2048^2     269 MB   float64                    0.73   0.58

On 100 000 x 3 masses `tiled` took 1.4, on 100 000 x 16 0.6. On the layer `workqueue`, where `team` cannot run, it took
0.09, 0.22 and 0.48 at 32^2, 256^2 and 512^2: it has one region for LEVELS steps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softlab.cpu_backend.core.layout import block_of, padded
from softlab.cpu_backend.core.threads import threading_layer
from softlab.cpu_backend.mass_spring.grid.tiled import halo, tile_buffer
from softlab.model.base.errors import SceneError
from softlab.model.base.memory import readable
from softlab.model.base.types import Real
from softlab.model.core.options import unknown_kernel
from softlab.model.scene.scene import Scene

KERNELS = ("fused", "team", "tiled", "stages")
TEAM_LAYER = "omp"  # gives each band its own thread; tbb does not, workqueue has regions of 0.1 ms
TILED_BYTES = 24e6  # both states: from this size on, every step reads them from memory, not from a cache
LEVELS = 12  # passes in flight in `tiled`: 8 took 1.1 times as long, 4 1.3 times, 16 the same
TILE_BYTES = 4032  # of a tile's row: 2 KiB took 1.2 times as long, 8 KiB the same with twice the cache


class Tiling(NamedTuple):
    """Sizes: `levels` passes in flight, `tile` columns and `halo` more on each side; `width`, `scratch`: see
    tile_buffer."""

    levels: int
    tile: int
    halo: int
    width: int
    scratch: int


def tiling(real: Real, columns: int, levels: int = LEVELS, tile_bytes: int = TILE_BYTES) -> Tiling:
    """Return the sizes of the kernel `tiled` for rows of `columns` masses."""
    block = block_of(real)
    tile = min(tile_bytes // np.dtype(real).itemsize // block, -(-columns // block)) * block
    width, scratch = tile_buffer(levels, tile, real)
    return Tiling(levels, tile, halo(levels, real), width, scratch)


def choose_kernel(scene: Scene, real: Real, wanted: str | None) -> str:
    """Return the kernel `wanted`, or the fastest for the scene. Raises SceneError if the one wanted cannot run."""
    if wanted is not None and wanted not in KERNELS:
        raise unknown_kernel(wanted, KERNELS, "on the cpu")
    if scene.method.integrator == "rk4":
        if wanted in ("team", "tiled"):
            raise SceneError("--kernel", wanted, "must be fused or stages for the integrator rk4, which has stages")
        return wanted or "fused"
    if wanted == "team" and threading_layer() != TEAM_LAYER:
        raise SceneError(
            "--kernel", wanted,
            f"needs numba's threading layer {TEAM_LAYER}, here it is {threading_layer()} (NUMBA_THREADING_LAYER, set "
            "before Python starts); tiled runs on every layer",
        )  # fmt: skip
    return wanted or default_kernel(scene, real)[0]


def default_kernel(scene: Scene, real: Real) -> tuple[str, str]:
    """Return (kernel, reason) for a scene without a choice."""
    if scene.method.integrator == "rk4":
        return "fused", "the others evaluate forces once per step, rk4 four times"
    rows, columns = scene.grid.rows, scene.grid.columns
    size = 2 * padded(rows, columns, real).size * np.dtype(real).itemsize
    states = f"both states take {readable(size)}"
    if size > TILED_BYTES and columns >= block_of(real):
        return "tiled", f"{states}, more than a cache holds: {LEVELS} steps per pass over memory"
    if threading_layer() != TEAM_LAYER:
        return "tiled", f"{states}; one parallel region for {LEVELS} steps, since layer {threading_layer()} has no team"
    if size > TILED_BYTES:
        return "team", f"rows of {columns} masses are too short for tiles; no parallel region per step"
    return "team", f"{states}, which fit into a cache: no parallel region per step"
