"""The lab's step as a scatter over springs on CUDA, for bench/experiments/findings/determinism.py, not for users.

One thread per spring evaluates it once and adds the force to both of its masses; a second kernel, one thread per mass,
does the step and clears the sums. Two variants keep two threads from adding to one mass at the same time:

- `atomics`: one launch for all springs, floating-point atomic additions. The order in which the forces on a mass are
  added depends on the scheduler, and rounding depends on the order: a run may not repeat.
- `colours`: four launches (even and odd springs along rows, then down columns), in each of which no two springs share a
  mass. Plain additions in a fixed order: a run repeats bit for bit.

Formulas, storage and the replayed CUDA graph are those of the lab's kernel `graph`, which gathers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda as numba_cuda

from softlab.gpu_backend.core.compile import Kernel, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.formulas import device_formulas, device_variant
from softlab.gpu_backend.core.launch import Graphs, can_capture
from softlab.gpu_backend.core.pairs import load_pair, store_pair
from softlab.gpu_backend.mass_spring.grid.kernels import make_tools
from softlab.gpu_backend.mass_spring.grid.point import grid_features, moves_of
from softlab.gpu_backend.mass_spring.grid.solver import MassSpring
from softlab.model.base.types import Real
from softlab.model.core.plan import Executor
from softlab.model.core.simulation import Options
from softlab.model.formulas import springs
from softlab.model.scene.scene import Scene

cuda: Any = numba_cuda  # numba infers the types of kernels when they are compiled
ATOMICS, COLOURS = "atomics", "colours"  # the kernels' names


class ScatterGrid(MassSpring):
    """Simulation (model/core/simulation.py) for scenes of the lab's grid (bench/peers/base.py: grid_refusal).

    `how`: ATOMICS or COLOURS. The state stays in one buffer, because all springs are done before a mass moves.
    """

    def __init__(self, scene: Scene, precision: str, how: str, math: str = "fast"):
        self._how = how
        super().__init__(scene, Options(precision, math))

    def _choose_kernel(self) -> None:
        self.kernel, self.tile = self._how, None

    def _build(self) -> None:
        self._tools = make_tools(self.real)
        self._graphs, self._tiles = None, None
        self._scatter = make_scatter(self.real, self.options.math, self.plan.parts)
        self._sums = cuda.to_device(np.zeros(2 * self.particle_count, self.real), stream=self.stream)
        self._launch = self._launch_scatter
        self._executor = Executor(self.plan, {}, self._advance_steps)
        if can_capture():
            self._advance_steps(0, 1)  # no module may be loaded while a graph is captured
            cuda.synchronize()
            self._graphs = Graphs(self.stream, self._launch, self._count_on)

    def _launch_scatter(self, parity: int, count: int) -> None:
        (across, down), block, stream = self._grid
        position, velocity = self.position[0], self.velocity[0]
        for number in range(count):
            if self._how == ATOMICS:
                both = (across, down, 2), (*block, 1), stream
                self._scatter.atomics[both](position, self._sums, self.record, *self.shape)
            else:
                for colour, kernel in enumerate(self._scatter.colours):
                    half = (-(-across // 2), down) if colour < 2 else (across, -(-down // 2))
                    kernel[half, block, stream](position, self._sums, self.record, *self.shape)
            self._scatter.move[self._grid](
                position, velocity, self._sums, self.record, self.integers, self._counter, np.int64(number),
                self._pinned_row, self.pinned, *self.shape,
            )  # fmt: skip
        self._current = 0


@cache
def make_scatter(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make the kernels `atomics`, `colours` (four of them) and `move`.

    `position`, `velocity`: complex (particles,); `sums` (2 particles,): the forces over mass along x, then those along
    y, all 0 between steps.
    """

    def kernel(function: Callable, words: Sequence[str] = ()) -> Kernel:
        return make_kernel(function, variant_name(real, math, parts, *words), **kernel_options(math))

    colours = [
        kernel(_colour_kernel(real, math, down, odd), ("down" if down else "along", "odd" if odd else "even"))
        for down in (False, True)
        for odd in (0, 1)
    ]
    return SimpleNamespace(
        atomics=kernel(_atomics_kernel(real, math)), colours=colours, move=kernel(_move_kernel(real, math, parts))
    )


def _atomics_kernel(real: Real, math: str) -> Callable:
    spring_acceleration_2d = device_formulas(springs, real, math).spring_acceleration_2d

    def scatter_atomics(position, sums, record, rows, columns):
        parameters = record[0]
        j = np.int32(cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x)
        i = np.int32(cuda.blockIdx.y * cuda.blockDim.y + cuda.threadIdx.y)
        rows, columns = np.int32(rows), np.int32(columns)
        k, count = np.int32(i * columns + j), np.int32(rows * columns)
        other, inside = k + np.int32(1), i < rows and j < columns - 1
        if cuda.blockIdx.z == 1:
            other, inside = k + columns, i < rows - 1 and j < columns
        if inside:
            here, there = load_pair(position, k), load_pair(position, other)
            x, y = spring_acceleration_2d(
                there.real - here.real, there.imag - here.imag, parameters.stiffness, parameters.stiffness_rest
            )
            cuda.atomic.add(sums, k, x)
            cuda.atomic.add(sums, count + k, y)
            cuda.atomic.add(sums, other, -x)
            cuda.atomic.add(sums, count + other, -y)

    return scatter_atomics


def _colour_kernel(real: Real, math: str, down: bool, odd: int) -> Callable:
    spring_acceleration_2d = device_formulas(springs, real, math).spring_acceleration_2d
    first = np.int32(odd)

    def scatter_colour(position, sums, record, rows, columns):
        parameters = record[0]
        j = np.int32(cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x)
        i = np.int32(cuda.blockIdx.y * cuda.blockDim.y + cuda.threadIdx.y)
        rows, columns = np.int32(rows), np.int32(columns)
        if down:
            i = np.int32(i + i + first)
            inside = i < rows - 1 and j < columns
        else:
            j = np.int32(j + j + first)
            inside = i < rows and j < columns - 1
        if inside:
            k, count = np.int32(i * columns + j), np.int32(rows * columns)
            other = np.int32(k + columns) if down else np.int32(k + 1)
            here, there = load_pair(position, k), load_pair(position, other)
            x, y = spring_acceleration_2d(
                there.real - here.real, there.imag - here.imag, parameters.stiffness, parameters.stiffness_rest
            )
            sums[k] += x
            sums[count + k] += y
            sums[other] -= x
            sums[count + other] -= y

    return scatter_colour


def _move_kernel(real: Real, math: str, parts: frozenset[str]) -> Callable:
    move = device_variant(real, math, grid_features("lab", parts))(moves_of("lab", parts)["step"])
    has_pins = "pins" in parts
    zero = real(0)

    def move_summed(
        position, velocity, sums, record, integers, counter, pass_number, pinned_row, pinned, rows, columns
    ):  # fmt: skip
        parameters = record[0]
        j = np.int32(cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x)
        i = np.int32(cuda.blockIdx.y * cuda.blockDim.y + cuda.threadIdx.y)
        rows, columns = np.int32(rows), np.int32(columns)
        if i < rows and j < columns:
            k, count = np.int32(i * columns + j), np.int32(rows * columns)
            p, v = load_pair(position, k), load_pair(velocity, k)
            ax, ay = sums[k], sums[count + k]
            px, py, vx, vy = move(k, ax, ay, p, v, parameters, integers, np.int64(0))
            if has_pins:
                if pinned_row[i] != 0:
                    if pinned[k] != 0:
                        px, py, vx, vy = p.real, p.imag, zero, zero
            store_pair(position, k, px, py)
            store_pair(velocity, k, vx, vy)
            sums[k] = zero
            sums[count + k] = zero

    return move_summed
