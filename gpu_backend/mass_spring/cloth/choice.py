"""Choice of the kernel that runs a cloth on the GPU, and of its tiles, from small measured tables.

The numbers are us per step on one NVIDIA H200, of the catalogue's cloth-hanging: velocity Verlet, 12 springs per mass,
gravity, damping and two pins. A choice depends only on their ratios, so it suits other scenes well enough.
"""

from __future__ import annotations

from math import prod

import numpy as np

from softlab.gpu_backend.core.device import device_limits
from softlab.gpu_backend.core.launch import can_capture
from softlab.gpu_backend.core.tiling import Tile, parsed_tile
from softlab.gpu_backend.mass_spring.cloth.block import MAX_THREADS, block_bytes
from softlab.gpu_backend.mass_spring.cloth.launch import cloth_blocks, why_no_cloth_tile
from softlab.gpu_backend.mass_spring.tile_choice import fastest, measured_tiles
from softlab.model.base.errors import SceneError
from softlab.model.base.types import Real
from softlab.model.core.options import unknown_kernel
from softlab.model.mass_spring.cloth_plan import kicks_coupled
from softlab.model.scene.scene import Scene

CLOTH_KERNELS = ("one-block", "resident", "graph", "launch", "stages")
# One block runs on one multiprocessor: above some size its arithmetic takes longer than a captured launch. On an H200,
# float32, 12 springs: 1.46 against 1.94 us per step at 32 x 32; in wind 4.5 against 5.4 at 24 x 24, but 7.2 against 5.5
# at 32 x 32.
ONE_BLOCK_MASSES = 1024
ONE_BLOCK_MASSES_IN_WIND = 576
# us per step of `resident` on a tile, by the blocks that share a multiprocessor; all run at once, so the sheet's size
# does not matter otherwise. Of tiles without measurements, the first one that fits is used on request.
# begin measured
RESIDENT: dict[Real, dict[str, dict[int, float]]] = {
    np.float32: {
        "16x8x1h1": {1: 0.99, 4: 1.54},
        "8x8x1h1": {1: 1.18, 2: 1.21, 8: 1.58},
        "32x8x2h1": {1: 1.34},
        "32x4x4h1": {4: 2.74},
        "64x8x4h1": {1: 2.73},
        "128x4x16h1": {1: 11.0},
    },
    np.float64: {
        "16x8x1h1": {1: 1.42},
        "8x8x1h1": {1: 1.52, 2: 1.64},
        "32x8x2h1": {1: 2.4},
        "64x4x8h1": {1: 5.95},
    },
}
# end measured
# of `one-block` and `graph`: us per step at least, plus us per million masses; `one-block` in float64 estimated as
# twice that
ONE_BLOCK: dict[Real, tuple[float, float]] = {np.float32: (0.1, 1330.0), np.float64: (0.2, 2660.0)}
GRAPH: dict[Real, tuple[float, float]] = {np.float32: (2.2, 18.6), np.float64: (3.2, 44.0)}


def why_not_one_block(scene: Scene, real: Real, parts: frozenset[str], limits: tuple[int, int] | None = None) -> str:
    """Return the reason why the kernel `one-block` cannot run the scene, or "". `limits`: of `device_limits`."""
    masses = scene.grid.particle_count
    if scene.method.integrator == "rk4":
        return "supports integrators with one force evaluation per step, not rk4; use graph"
    if masses > MAX_THREADS:
        return f"holds at most {MAX_THREADS} masses, this sheet has {masses}; use graph"
    needed, most = block_bytes(real, parts, masses), (limits or device_limits())[1]
    if needed > most:
        return f"needs {needed} bytes of shared memory here, a block has {most}; use graph"
    return ""


def why_not_resident(scene: Scene, parts: frozenset[str]) -> str:
    """Return the reason why `resident` cannot run the scene, whatever the tile, or ""."""
    if scene.method.integrator == "rk4":
        return "supports integrators with one force evaluation per step, not rk4; use graph"
    if scene.method.integrator == "velocity-verlet" and not kicks_coupled(parts):
        return (
            "supports velocity-verlet without forces that depend on velocities (wind, dampers along springs); use graph"
        )
    return ""


def cloth_tiles_of(
    rows: int, columns: int, real: Real, parts: frozenset[str], limits: tuple[int, int] | None = None
) -> list[tuple[Tile, float | None]]:
    """Return (tile, us per step if measured) of the table's tiles that fit the sheet."""
    return measured_tiles(
        RESIDENT[real],
        (limits or device_limits())[0],
        lambda tile: prod(cloth_blocks(rows, columns, tile, parts)),
        lambda tile: not why_no_cloth_tile(rows, columns, real, tile, parts, limits),
    )


def choose_cloth(
    scene: Scene, real: Real, parts: frozenset[str], limits: tuple[int, int] | None = None
) -> tuple[str, Tile | None, str]:
    """Return (kernel, tile, reason) for a cloth without a choice. `limits`: of `device_limits`."""
    rows, columns, masses = scene.grid.rows, scene.grid.columns, scene.grid.particle_count
    small = masses <= (ONE_BLOCK_MASSES_IN_WIND if "wind" in parts else ONE_BLOCK_MASSES)
    times: dict[tuple[str, Tile | None], float] = {}
    for kernel, (least, million) in (("one-block", ONE_BLOCK[real]), ("graph", GRAPH[real])):
        if kernel == "graph" or (small and not why_not_one_block(scene, real, parts, limits)):
            times[kernel, None] = least + 1e-6 * masses * million
    if not why_not_resident(scene, parts):
        candidates = cloth_tiles_of(rows, columns, real, parts, limits)
        times |= {("resident", tile): time for tile, time in candidates if time is not None}
    return fastest(times)


def default_cloth_kernel(
    scene: Scene, real: Real, parts: frozenset[str], limits: tuple[int, int] | None = None
) -> tuple[str, str]:
    """Return (kernel, reason) for a cloth without a choice."""
    kernel, _, why = choose_cloth(scene, real, parts, limits)
    return kernel, why


def cloth_kernel(scene: Scene, real: Real, parts: frozenset[str], asked: str | None) -> str:
    """Return the requested kernel, without its tile, or the default. Raises SceneError for one that cannot run the
    scene."""
    if asked is None:
        return default_cloth_kernel(scene, real, parts)[0] if can_capture() else "launch"
    kernel, _, tile = asked.partition(":")
    if kernel == "tiles":
        raise SceneError("--kernel", asked, "runs grids only; for a cloth use resident, or graph beyond its sizes")
    if kernel not in CLOTH_KERNELS or (tile and kernel != "resident"):
        raise unknown_kernel(asked, CLOTH_KERNELS, "for a cloth on the gpu")
    if kernel == "graph" and not can_capture():
        raise SceneError("--kernel", asked, "the CUDA simulator cannot capture graphs; use launch")
    reason = why_not_one_block(scene, real, parts) if kernel == "one-block" else ""
    if kernel == "resident":
        reason = why_not_resident(scene, parts)
    if reason:
        raise SceneError("--kernel", asked, reason)
    return kernel


def cloth_tile(scene: Scene, real: Real, parts: frozenset[str], kernel: str, asked: str | None) -> Tile | None:
    """Return the tile of the kernel `resident`: the requested one, as in `resident:8x8x1h1`, or the table's. Raises
    SceneError."""
    if kernel != "resident":
        return None
    _, colon, text = (asked or "").partition(":")
    if colon:
        return parsed_tile(text)
    rows, columns = scene.grid.rows, scene.grid.columns
    candidates = cloth_tiles_of(rows, columns, real, parts)
    if not candidates:
        raise SceneError(
            "--kernel",
            kernel,
            f"{rows} x {columns} masses fit none of its tiles on this GPU; use graph, or name a tile",
        )
    return min(candidates, key=lambda pair: (pair[1] is None, pair[1] or 0))[0]
