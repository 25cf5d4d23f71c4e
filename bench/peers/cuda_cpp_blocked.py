"""The grid in hand-written CUDA C++ with temporal blocking (grid_blocked.cu).

Several steps per pass over memory, or the whole grid kept on the chip. The tile for a size is not in a table: opening
the peer times the few candidates for some milliseconds on this GPU and selects the fastest.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from softlab.bench.peers import cuda_driver
from softlab.bench.peers.base import Opened, PeerError
from softlab.bench.peers.cuda_cpp import CudaConstants, CudaCpp, Sheet, addresses_of
from softlab.bench.peers.cuda_driver import checked
from softlab.model.scene.scene import Scene

if TYPE_CHECKING:
    from cuda.bindings import driver

SOURCE = Path(__file__).with_name("grid_blocked.cu")
LANES = 32
FLAG_STRIDE = 32  # int32: as in grid_blocked.cu
ONE_BLOCK, RESIDENT, TILES = "one-block", "resident", "tiles"
TRIAL_SECONDS = 0.01  # per candidate


@dataclass(frozen=True)
class Tile:
    """Masses of a block: `warps` strips of 32 `across` columns and `down` rows.

    Of these, `halo` rings belong to the neighbours; `together`: blocks per multiprocessor.
    """

    across: int
    down: int
    warps: int
    halo: int
    together: int = 1

    @property
    def width(self) -> int:
        return LANES * self.across

    @property
    def height(self) -> int:
        return self.warps * self.down

    @property
    def name(self) -> str:
        together = f", {self.together} together" if self.together > 1 else ""
        return f"{self.width}x{self.height}h{self.halo} of {self.warps} warps{together}"

    @property
    def definitions(self) -> tuple[str, ...]:
        numbers = {"ACROSS": self.across, "DOWN": self.down, "WARPS": self.warps, "HALO": self.halo}
        return tuple(f"-D{name}={number}" for name, number in (numbers | {"BLOCKS": self.together}).items())

    def blocks(self, rows: int, columns: int) -> tuple[int, int]:
        """Return the blocks (across, down) over a grid; the last tile is larger than its halo, so no halo spans two
        neighbours.
        """

        def along(masses: int, size: int) -> int:
            return 1 if masses <= size else -((2 * self.halo - masses) // (size - 2 * self.halo))

        return along(columns, self.width), along(rows, self.height)


ONE_BLOCK_TILES = (Tile(1, 1, 32, 1), Tile(1, 4, 8, 1), Tile(2, 3, 22, 1), Tile(2, 4, 16, 1))
RESIDENT_TILES = (
    Tile(1, 4, 8, 10), Tile(1, 4, 8, 8, 2), Tile(1, 4, 8, 8), Tile(1, 4, 12, 8), Tile(1, 4, 16, 8), Tile(1, 8, 8, 8),
    Tile(2, 4, 16, 8), Tile(2, 8, 8, 6), Tile(2, 8, 16, 4), Tile(2, 7, 22, 3), Tile(2, 8, 20, 3),
)  # fmt: skip
PASS_TILES = (Tile(2, 8, 8, 4, 2), Tile(2, 8, 16, 4), Tile(2, 8, 16, 6))
RESIDENT_CANDIDATES = 4
PASSES_FROM = 512 * 512  # masses: smaller grids are better kept on the chip


@cache
def compile_blocked(tile: Tile, architecture: str) -> bytes:
    """Return machine code of grid_blocked.cu, by cuda_driver.compile_source."""
    return cuda_driver.compile_source(SOURCE, tile.definitions, architecture)


def candidates(rows: int, columns: int, processors: int) -> list[tuple[str, Tile]]:
    """Return the (kernel, tile) pairs for a grid on a GPU with that many multiprocessors."""
    fitting = [tile for tile in ONE_BLOCK_TILES if rows <= tile.height and columns <= tile.width]
    whole = [(ONE_BLOCK, tile) for tile in fitting if tile.width == min(other.width for other in fitting)]
    resident = []
    for tile in RESIDENT_TILES:
        across, down = tile.blocks(rows, columns)
        if 1 < across * down <= processors * tile.together:
            per_processor = -(-across * down // processors)
            resident.append((per_processor * tile.width * tile.height, (RESIDENT, tile)))
    resident.sort(key=lambda entry: entry[0])
    choices = whole + [choice for _, choice in resident[:RESIDENT_CANDIDATES]]
    if rows * columns >= PASSES_FROM or not choices:
        choices += [(TILES, tile) for tile in PASS_TILES]
    return choices


class CudaCppBlocked(CudaCpp):
    """Several steps per launch, with the grid in registers, shuffles and shared memory."""

    name = "cuda_cpp_blocked"
    label = "CUDA C++, blocked"
    precisions = ("float32",)

    def compile(self, architecture: str) -> bytes:
        return compile_blocked(PASS_TILES[0], architecture)

    def open(self, scene: Scene, precision: str, threads: int) -> Opened:
        constants = CudaConstants(scene, precision)
        (processors,) = cuda_driver.attributes("MULTIPROCESSOR_COUNT")
        return quickest(constants, precision, candidates(constants.rows, constants.columns, processors))


def quickest(constants: CudaConstants, precision: str, choices: Sequence[tuple[str, Tile]]) -> Opened:
    """Return the choice that did a few steps fastest, opened. Raises PeerError if none can be opened."""
    best: tuple[float, Blocked] | None = None
    reasons = []
    for kernel, tile in choices:
        try:
            opened = Blocked(constants, precision, kernel, tile)
        except PeerError as error:  # this GPU has too few registers or too little memory for it
            reasons.append(f"{kernel} {tile.name}: {error}")
            continue
        seconds = _trial(opened) if len(choices) > 1 else 0.0
        if best is not None and best[0] <= seconds:
            opened.close()
            continue
        if best is not None:
            best[1].close()
        best = (seconds, opened)
    if best is None:
        raise PeerError("; ".join(reasons))
    best[1].load(constants.position, constants.velocity)
    return best[1]


def _trial(opened: Blocked) -> float:
    """Return the time [s] of a step."""
    steps = opened.steps_together if opened.kernel_kind == TILES else 256
    while True:
        opened.synchronize()
        begin = time.perf_counter()
        opened.advance(steps)
        opened.synchronize()
        seconds = time.perf_counter() - begin
        if seconds >= TRIAL_SECONDS:
            return seconds / steps
        steps *= 4


class Blocked(Sheet):
    """One of the kernels of grid_blocked.cu on one tile."""

    vector = 2

    def __init__(self, constants: CudaConstants, precision: str, kernel: str, tile: Tile):
        self.kernel_kind, self.tile = kernel, tile
        self.kernel = f"{kernel} {tile.name}"
        self.function = b"grid_resident" if kernel == RESIDENT else b"grid_tiles"
        self.block = (LANES, tile.warps)
        self.steps_together = tile.halo
        self._steps, self._counted_from = np.zeros(1, np.int32), np.zeros(1, np.int32)  # read at each launch
        self._epoch = 0
        self._exchanged: list[driver.CUdeviceptr] = []
        super().__init__(constants, precision)

    def _compiled(self, precision: str) -> bytes:
        return compile_blocked(self.tile, cuda_driver.architecture())

    def _blocks_over(self, rows: int, columns: int) -> tuple[int, int]:
        return self.tile.blocks(rows, columns)

    def _pins(self) -> list[driver.CUdeviceptr]:
        """Return the pins; also allocate the buffers of exchanges between blocks: borders of tiles, a flag per block,
        and an error flag."""
        pinned = np.zeros(self.constants.count, np.uint8)
        pinned[self.constants.pinned] = 1
        arrays = [pinned]
        if self.kernel_kind == RESIDENT:
            flags = np.zeros(self._blocks[0] * self._blocks[1] * FLAG_STRIDE, np.int32)
            arrays += [np.zeros((2, self.constants.count, 4), np.float32), flags, np.zeros(1, np.int32)]
        pins, *self._exchanged = self._uploaded(arrays)
        return [pins]

    def _argument_list(self, source: int) -> tuple[np.ndarray, list[np.ndarray]]:
        constants = self.constants
        shape = [np.array([number], np.int32) for number in (constants.rows, constants.columns)]
        arguments = [*self._pointers(source), *shape, self._steps, np.array(constants.in_order, constants.real)]
        if self.kernel_kind == RESIDENT:
            arguments += [*(np.array([int(memory)], np.uint64) for memory in self._exchanged), self._counted_from]
        return addresses_of(arguments), arguments

    def _launch(self, source: int, steps: int = 0) -> None:
        """Launch once from buffer `source` into the other; by default as many steps as the halo has rings."""
        self._steps[0] = steps or self.tile.halo
        if self.kernel_kind == RESIDENT:
            self._launch_together(source)
        else:
            super()._launch(source)
        self._steps[0] = self.tile.halo  # the value that graphs have captured

    def _launch_together(self, source: int) -> None:
        self._counted_from[0] = self._epoch
        addresses, _ = self._arguments[source]
        checked(
            self._driver.cuLaunchCooperativeKernel(
                self._function, *self._blocks, 1, *self.block, 1, 0, self._stream, addresses.ctypes.data
            ),
            "cuLaunchCooperativeKernel",
        )
        self._epoch += -(-int(self._steps[0]) // self.tile.halo) - 1

    def _capture(self) -> None:
        if self.kernel_kind == TILES:
            super()._capture()

    def _advance(self, steps: int) -> None:
        passes, rest = divmod(steps, self.tile.halo) if self.kernel_kind == TILES else (0, steps)
        super()._advance(passes)
        if rest:
            self._launch(self._current, rest)
            self._current = 1 - self._current

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        state = super().read()
        if self.kernel_kind == RESIDENT:
            failed = np.zeros(1, np.int32)
            checked(self._driver.cuMemcpyDtoH(failed.ctypes.data, self._exchanged[-1], failed.nbytes), "cuMemcpyDtoH")
            if failed[0]:
                raise PeerError("a block waited too long for its neighbours")
        return state
