"""Choice of the kernel that runs a position-based solver on the GPU, and of its tiles.

Bounds of a Gauss-Seidel iteration (float32, twelve colours, an H200): `graph` has one launch per colour, 12 x 1.3 us
however small the sheet. In a block a colour takes at least one constraint from load to store and the barrier after it,
about 160 cycles, 1 us for twelve; and at least 32 bytes per mass through shared memory at 128 bytes per cycle, 1.5 ns
per mass for twelve: 1.6 us at 32 x 32, 6 us at 64 x 64 in one block. `tiled` adds a launch and its loads, and
distributes the masses over 132 multiprocessors, halos included: 40 bytes per mass in and 40 out through the
second-level cache, multipliers included.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from softlab.gpu_backend.core.device import device_limits
from softlab.gpu_backend.core.launch import can_capture
from softlab.gpu_backend.xpbd.sweep import shared_bytes
from softlab.gpu_backend.xpbd.tile import SheetTile, span, whole
from softlab.model.base.errors import SceneError
from softlab.model.base.types import Real
from softlab.model.core.options import unknown_kernel
from softlab.model.position_based.plan import colour_order, families
from softlab.model.scene.scene import Scene
from softlab.model.xpbd.reach import PERIOD

XPBD_KERNELS = ("one-block", "tiled", "graph", "launch", "stages")
MAX_THREADS = 1024
ONE_BLOCK_MASSES = 4 * MAX_THREADS
OWNED = (8, 16, 24, 32, 48, 64)  # masses that a tile owns along an axis
MAX_DEPTH = 4  # iterations per launch
AIR_BYTES = 32  # of shared memory, for the wind's velocity
# us: a captured launch with the loads and stores of its tiles; a barrier of a colour with the waits around it; a mass
# of a tile through shared memory (16 bytes each way at 128 bytes per cycle); the same for a mass that gathers; and for
# one whose colour goes through device memory. ALL, FAMILY, FAR: a launch of `graph` that gathers, for each family, for
# each mass. Estimated, then compared with an NVIDIA H200, twelve neighbours in float32: for Gauss-Seidel the choice is
# the fastest that was measured from 32 x 32 to 1024 x 1024 (2.3, 4.1, 5.3, 8.9, 26.6 and 97 us per iteration). The last
# four are fitted: with them Jacobi uses `graph` instead of tiles from 512 x 512 on (10.4 against 12.8 us, at 1024 x
# 1024 64 against 97).
LAUNCH, BARRIER, MASS, STREAM = 1.8, 0.08, 1.3e-4, 1e-5
GATHER, ALL, FAMILY, FAR = 2.9e-3, 1.3, 0.35, 2.5e-5

CONTACTS_SPAN = "self_collision reaches across the sheet: no tile holds what a mass meets"


@dataclass(frozen=True)
class Choice:
    """A kernel, its tile for kernels on tiles, and for `tiled` the number of iterations per launch."""

    kernel: str
    tile: SheetTile | None = None
    depth: int = 1

    @property
    def name(self) -> str:
        """Name in the form of the option `--kernel`."""
        if self.kernel != "tiled" or self.tile is None:
            return self.kernel
        tile = self.tile
        return f"tiled:{tile.rows.owned}x{tile.columns.owned}x{tile.threads}d{self.depth}"


def threads_for(masses: int) -> int:
    """Return the threads of a block: one for each constraint of a colour, half as many as there are masses; in a Jacobi
    ordering one for two masses, whose up to 24 multipliers then fit its registers."""
    return min(MAX_THREADS, max(32, -(-masses // 64) * 32))


def block_tile(scene: Scene, threads: int | None = None) -> SheetTile:
    """Return the tile of `one-block`."""
    rows, columns = scene.grid.rows, scene.grid.columns
    return whole(rows, columns, threads or threads_for(rows * columns))


def cut(parts: frozenset[str], owned: tuple[int, int], depth: int, threads: int | None = None) -> SheetTile:
    """Return the tile that owns `owned` rows and columns, with the halo of `depth` iterations."""
    rows, columns = span(parts, True, owned[0], depth), span(parts, False, owned[1], depth)
    return SheetTile(rows, columns, threads or threads_for(rows.size * columns.size))


def _sweep_time(parts: frozenset[str], masses: int) -> float:
    """Return the time of one iteration on a block [us]."""
    if "gauss-seidel" in parts:
        return len(colour_order(parts)) * (BARRIER + MASS * masses)
    return BARRIER + len(families(parts)) / 6 * GATHER * masses


def estimate(scene: Scene, parts: frozenset[str], choice: Choice, processors: int) -> float:
    """Return the estimated time of one iteration [us]."""
    rows, columns = scene.grid.rows, scene.grid.columns
    if choice.tile is None:
        if "gauss-seidel" not in parts:
            return ALL + FAMILY * len(families(parts)) + FAR * rows * columns
        return max(1, len(colour_order(parts))) * (LAUNCH - 0.5 + STREAM * rows * columns)
    if choice.kernel == "one-block":
        return _sweep_time(parts, rows * columns)
    blocks = choice.tile.rows.count(rows) * choice.tile.columns.count(columns)
    blocks_each = -(-blocks // processors)  # for one multiprocessor, which runs them together or one after the other
    masses = choice.tile.rows.size * choice.tile.columns.size * blocks_each
    return LAUNCH / choice.depth + _sweep_time(parts, masses)


def best_tiled(scene: Scene, real: Real, parts: frozenset[str], limits: tuple[int, int]) -> Choice | None:
    """Return `tiled` with the tile that should be fastest, or None if none fits a block."""
    choices, most = [], ONE_BLOCK_MASSES if "gauss-seidel" in parts else MAX_THREADS
    for depth in range(1, min(MAX_DEPTH, scene.method.iterations) + 1):
        for owned in ((r, c) for r in OWNED for c in OWNED):
            tile = cut(parts, owned, depth)
            masses = tile.rows.size * tile.columns.size
            if masses <= most and shared_bytes(real, parts, tile) + AIR_BYTES <= limits[1]:
                choices.append(Choice("tiled", tile, depth))
    return min(choices, key=lambda choice: estimate(scene, parts, choice, limits[0]), default=None)


def why_not_one_block(scene: Scene, real: Real, parts: frozenset[str], limits: tuple[int, int]) -> str:
    """Return the reason why the kernel `one-block` cannot run the scene, or ""."""
    masses = scene.grid.particle_count
    if masses > ONE_BLOCK_MASSES:
        return f"holds at most {ONE_BLOCK_MASSES} masses, this sheet has {masses}; use tiled or graph"
    needed = shared_bytes(real, parts, block_tile(scene)) + AIR_BYTES
    if needed > limits[1]:
        return f"needs {needed} bytes of shared memory here, a block has {limits[1]}; use tiled or graph"
    return ""


def default_xpbd_kernel(
    scene: Scene, real: Real, parts: frozenset[str], limits: tuple[int, int] | None = None
) -> tuple[str, str]:
    """Return (kernel, reason) for a scene without a choice.

    `limits`: (multiprocessors, bytes of shared memory that a block can have); None: this GPU's.
    """
    if scene.self_collision:
        return "graph", CONTACTS_SPAN
    if scene.method.matches_shapes:
        return "graph", "two launches an iteration"
    limits = limits or device_limits()
    choice = default_choice(scene, real, parts, limits)
    return choice.name, f"{estimate(scene, parts, choice, limits[0]):.2g} us an iteration by the estimate"


def default_choice(scene: Scene, real: Real, parts: frozenset[str], limits: tuple[int, int]) -> Choice:
    """Return the kernel that should be fastest."""
    if scene.self_collision or scene.method.matches_shapes:
        return Choice("graph")
    choices = [Choice("graph")]
    if not why_not_one_block(scene, real, parts, limits):
        choices.append(Choice("one-block", block_tile(scene)))
    tiled = best_tiled(scene, real, parts, limits)
    if tiled:
        choices.append(tiled)
    return min(choices, key=lambda choice: estimate(scene, parts, choice, limits[0]))


def xpbd_kernel(scene: Scene, real: Real, parts: frozenset[str], asked: str | None) -> Choice:
    """Return the requested kernel, or the default. Raises SceneError for one that cannot run the scene.

    Also as `one-block:THREADS` or `tiled:ROWSxCOLUMNSxTHREADSdDEPTH`: a tile that owns so many rows and columns.
    """
    if asked is None:
        return default_choice(scene, real, parts, device_limits()) if can_capture() else Choice("launch")
    kernel, _, tile = asked.partition(":")
    if kernel not in XPBD_KERNELS or (tile and kernel not in ("tiled", "one-block")):
        raise unknown_kernel(asked, XPBD_KERNELS, "for a position-based solver on the gpu")
    if kernel == "graph" and not can_capture():
        raise SceneError("--kernel", asked, "the CUDA simulator cannot capture graphs; use launch")
    if scene.self_collision and kernel in ("tiled", "one-block"):
        raise SceneError("--kernel", asked, f"{CONTACTS_SPAN}; use graph")
    if scene.method.matches_shapes and kernel in ("tiled", "one-block"):
        raise SceneError("--kernel", asked, "knows constraints of springs only; of shape-matching use graph")
    limits = device_limits()
    if kernel == "tiled":
        return _tiled(scene, real, parts, asked, tile, limits)
    if kernel != "one-block":
        return Choice(kernel)
    reason = why_not_one_block(scene, real, parts, limits)
    if reason:
        raise SceneError("--kernel", asked, reason)
    threads = int(tile) if re.fullmatch(r"\d{2,4}", tile) else 0
    if tile and (threads % 32 or not 32 <= threads <= MAX_THREADS):
        raise SceneError("--kernel", asked, f"one-block:THREADS has a multiple of 32 threads, up to {MAX_THREADS}")
    return Choice("one-block", block_tile(scene, threads))


def _tiled(scene: Scene, real: Real, parts: frozenset[str], asked: str, name: str, limits: tuple[int, int]) -> Choice:
    """Return the choice `tiled`, on the tile of that name if there is one."""
    if not name:
        choice = best_tiled(scene, real, parts, limits)
        if choice is None:
            raise SceneError("--kernel", asked, f"no tile fits the {limits[1]} bytes of shared memory of a block")
        return choice
    match = re.fullmatch(r"(\d{1,3})x(\d{1,3})x(\d{1,4})d(\d)", name)
    rows, columns, threads, depth = (int(text) for text in match.groups()) if match else (0, 0, 0, 0)
    if min(rows, columns, depth) < 1 or rows % PERIOD or columns % PERIOD or not 32 <= threads <= MAX_THREADS:
        raise SceneError(
            "--kernel", asked, "a tile is ROWSxCOLUMNSxTHREADSdDEPTH, such as tiled:16x16x384d1: multiples of "
            f"{PERIOD}, 32 to {MAX_THREADS} threads, 1 to 9 iterations a launch",
        )  # fmt: skip
    tile = cut(parts, (rows, columns), depth, -(-threads // 32) * 32)
    needed = shared_bytes(real, parts, tile) + AIR_BYTES
    if needed > limits[1]:
        raise SceneError("--kernel", asked, f"needs {needed} bytes of shared memory, a block has {limits[1]}")
    return Choice("tiled", tile, depth)
