"""Choice of the kernel that runs a grid, and of its tiles, from a small measured table, not by a search at run time.

The numbers are us per step of the lab grid on one NVIDIA H200, medians, springs, gravity, damping and two pins
(`softlab sweep --kernels --backend gpu` measures the kernels again, `--kernel resident:64x12x4h4` any single tile). A
choice depends only on their ratios, so it suits other GPUs well enough.
"""

from __future__ import annotations

from math import prod

import numpy as np

from softlab.gpu_backend.core.device import device_limits
from softlab.gpu_backend.core.launch import can_capture
from softlab.gpu_backend.core.tiling import MAX_THREADS, Tile, parsed_tile, why_no_block
from softlab.gpu_backend.mass_spring.grid.strips import shared_bytes
from softlab.gpu_backend.mass_spring.grid.tile_launch import blocks_of, why_no_tile
from softlab.gpu_backend.mass_spring.tile_choice import fastest, measured_tiles
from softlab.model.base.types import Real
from softlab.model.scene.scene import Scene

# us per step of `resident` on a tile, by the blocks that share a multiprocessor; all run at once, so the grid's size
# does not matter otherwise
# begin measured
RESIDENT: dict[Real, dict[str, dict[int, float]]] = {
    np.float32: {
        "32x8x4h10": {1: 0.56},
        "48x8x4h8": {1: 0.83},
        "64x12x4h4": {1: 1.78},
        "104x8x12h4": {1: 4.04},
    },
    np.float64: {
        "32x16x2h8": {1: 1.0},
        "36x17x2h6": {1: 1.31},
        "54x13x4h4": {1: 2.71},
    },
}
# of `tiles`: the tile; us per step at least, plus us per million masses of all tiles together, halos included
TILES: dict[Real, tuple[str, float, float]] = {
    np.float32: ("64x4x16h4", 1.4, 2.75),
    np.float64: ("64x4x8h4", 2.0, 4.91),
}
# end measured
# of `one-block`: us per step at least, plus us per thousand masses
ONE_BLOCK: dict[Real, tuple[float, float]] = {np.float32: (0.10, 0.33), np.float64: (0.15, 0.66)}
# of `graph`: us per launch, plus us per million masses
GRAPH: dict[Real, tuple[float, float]] = {np.float32: (1.35, 6.3), np.float64: (1.95, 12.5)}

MEASURED_ON = "NVIDIA H200"
MEASURED_LIMITS = (132, 227 << 10)  # its multiprocessors, and the bytes of shared memory that a block can have


def one_block_tile(rows: int, columns: int) -> Tile:
    """Return a tile that contains the whole grid, with as few masses per thread as possible, one for up to 1024 masses;
    its sides are powers of two, so that few variants are compiled."""
    width = 1 << (columns - 1).bit_length()
    strip = 1
    while strip < 16 and width * _halved(rows, strip) > MAX_THREADS:
        strip *= 2
    return Tile(width, _halved(rows, strip), strip)


def _halved(rows: int, strip: int) -> int:
    """Return the least power of two of strips that contains the rows."""
    return 1 << (-(-rows // strip) - 1).bit_length()


def _times(
    rows: int, columns: int, real: Real, limits: tuple[int, int] | None = None
) -> dict[tuple[str, Tile | None], float]:
    """Return the expected times of a step [us], for each kernel and tile that fits the grid, on this GPU or one of
    `limits` (multiprocessors, bytes of shared memory per block)."""
    processors, most_shared = limits or device_limits()
    launch, million = GRAPH[real]
    masses = rows * columns
    times: dict[tuple[str, Tile | None], float] = {("graph", None): launch + 1e-6 * masses * million}
    tile = one_block_tile(rows, columns)
    if not why_no_block(tile, shared_bytes(real, tile), most_shared):
        least, thousand = ONE_BLOCK[real]
        times["one-block", tile] = least + 1e-3 * tile.masses * thousand
    candidates = measured_tiles(
        RESIDENT[real],
        processors,
        lambda tile: prod(blocks_of(rows, columns, tile)),
        lambda tile: not why_no_tile("resident", rows, columns, real, tile, limits),
    )
    times |= {("resident", tile): time for tile, time in candidates if time is not None}
    name, launch, million = TILES[real]
    tile = parsed_tile(name)
    times["tiles", tile] = launch + 1e-6 * prod(blocks_of(rows, columns, tile)) * tile.masses * million
    return times


def default_kernel(scene: Scene, real: Real, limits: tuple[int, int] | None = None) -> tuple[str, Tile | None, str]:
    """Return (kernel, tile, reason) for a scene without a choice. `limits`: see `_times`; with MEASURED_LIMITS no GPU
    is needed."""
    if not can_capture():
        return "launch", None, "the simulator captures no graphs"
    if scene.method.integrator == "rk4":
        return "graph", None, "the kernels on tiles evaluate forces once per step, rk4 four times"
    if scene.springs and scene.springs.alternate:
        return "graph", None, "the kernels on tiles support one stiffness; these springs alternate"
    return fastest(_times(scene.grid.rows, scene.grid.columns, real, limits))


def step_seconds(rows: int, columns: int, real: Real, limits: tuple[int, int]) -> float:
    """Return the expected time of a step of the fastest kernel [s]; `limits`: see `_times`."""
    return 1e-6 * min(_times(rows, columns, real, limits).values())


def best_tile(kernel: str, rows: int, columns: int, real: Real) -> Tile | None:
    """Return the tile for a kernel on tiles, or None if none fits."""
    if kernel == "tiles":
        return parsed_tile(TILES[real][0])
    if kernel == "resident":
        times = {tile: time for (name, tile), time in _times(rows, columns, real).items() if name == kernel}
        return min(times, key=lambda tile: times[tile]) if times else None
    tile = one_block_tile(rows, columns)
    return None if why_no_block(tile, shared_bytes(real, tile), device_limits()[1]) else tile


def named_tile(option: str) -> tuple[str, Tile | None]:
    """Return (kernel, tile) of an option such as `resident`, or `resident:64x8x8h4` with a tile."""
    kernel, colon, text = option.partition(":")
    return kernel, parsed_tile(text) if colon else None
