"""Shape matching of a grid on CPU threads: the third solver, with the forces and the loop of the position-based ones.

Kernels: `fused` (many steps in one call, one pass over the grid per iteration) and `stages`; see
shape_matching/matching.py. In `exact` math both give the same bits, for any number of threads.
"""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import Layout, aligned_zeros, block_of, plain
from softlab.cpu_backend.core.own_forces import bind_forces
from softlab.cpu_backend.core.point_stages import make_point_stages
from softlab.cpu_backend.core.simulation import RowsSimulation, chosen_kernel
from softlab.cpu_backend.core.steps import Steps
from softlab.cpu_backend.shape_matching.matching import STATES, Grid, make_matching_advance, scratch_places
from softlab.cpu_backend.shape_matching.matching_rows import CLUSTER
from softlab.cpu_backend.shape_matching.matching_stages import make_matching_stages
from softlab.model.assets.lattice import TABLE, matching_axis
from softlab.model.base.types import Real
from softlab.model.core.plan import Executor, Moment, StageRun
from softlab.model.core.simulation import Options
from softlab.model.scene.scene import Scene
from softlab.model.shape_matching.plan import window_plan


def aligned(rows: int, columns: int, real: Real) -> Layout:
    """Return a layout whose rows begin at cache lines, an odd number of them apart; planes have no gap."""
    block = block_of(real)
    stride = -(-columns // block) * block
    stride += block * (stride // block % 2 == 0)
    return Layout(rows, columns, stride, rows * stride)


class ShapeMatching(RowsSimulation):
    """Shape matching of a grid; model/core/simulation.py defines the contract. `threads`: `1x`, `2x`, `4x` or a
    number."""

    def __init__(self, scene: Scene, options: Options, threads: str | int = "1x"):
        super().__init__(scene, options, threads)
        self.kernel = chosen_kernel(options.kernel, "a position-based solver")
        self.plan = window_plan(scene, options.live)
        self.integers = self._seeds(2)
        rows, columns, region = self.body.rows, self.body.columns, scene.method.region
        self._tables = tuple(matching_axis(count, region).table(self.real) for count in (rows, columns))
        self._weights = (self.body.inverse_mass > 0).astype(self.real).reshape(rows, columns)
        self._layout = plain(rows, columns) if self.kernel == "stages" else aligned(rows, columns, self.real)
        self._bands = min(self.threads, rows)
        self._current = 0
        self._set_pins()
        self._states = aligned_zeros((1 if self.kernel == "stages" else STATES) * self._layout.size, self.real)
        self._snapshot = np.zeros(self._layout.size, self.real)
        self._executor = self._staged() if self.kernel == "stages" else self._fused()
        self.reset()

    # ------------------------------------------------------------------ kernels

    def _staged(self) -> Executor:
        return Executor(self.plan, self._stages())

    def _stages(self) -> dict[str, StageRun]:
        real, math, region = self.real, self.options.math, self.scene.method.region
        parts = self.plan.parts & {"damping"}
        compiler = Compiler(f"matching_point_{np.dtype(real).name}_{math}_{''.join(parts)}", math)
        point = make_point_stages(compiler, real, parts)
        matching = make_matching_stages(real, math, region)
        position, velocity, weights = self.current[:2], self.current[2:], self._weights
        before, acceleration = np.zeros_like(position), np.zeros_like(position)
        clusters, aside = np.zeros((CLUSTER, *weights.shape), real), np.zeros_like(position)

        def predict(moment: Moment) -> None:
            point.predict(position, velocity, before, acceleration, weights, self.record)
            acceleration[...] = 0

        def move(moment: Moment) -> None:
            matching.move(position, clusters, *self._tables, weights, self.record, aside)
            position[...] = aside

        return bind_forces(self, acceleration) | {
            "predict": predict,
            "match clusters": lambda moment: matching.match(position, *self._tables, clusters),
            "move to goals": move,
            "update velocity": lambda moment: point.update_velocity(
                position, velocity, before, weights, self.record
            ),
        }  # fmt: skip

    def _fused(self) -> Executor:
        rows, region, layout = self.body.rows, self.scene.method.region, self._layout
        self._bounds = np.array([rows * k // self._bands for k in range(self._bands + 1)], np.int64)
        self._band_size, self._place_after = scratch_places(region)["COUNT"] * layout.stride, np.zeros(1, np.int64)
        self._scratch = aligned_zeros(self._bands * self._band_size, self.real)
        wide = np.zeros((TABLE, layout.stride), self.real)
        wide[:, : layout.columns] = self._tables[1]
        weights = np.zeros((rows, layout.stride), self.real)
        weights[:, : layout.columns] = self._weights
        self._wide_table, self._wide_weights = wide.reshape(-1), weights.reshape(-1)
        return Executor(self.plan, {}, self._advance)

    def _advance(self, step: int, steps: int) -> None:
        method, layout = self.scene.method, self._layout
        grid = Grid(
            self._bounds, layout.rows, layout.columns, layout.stride, self._tables[0], self._wide_table,
            self._wide_weights, self.parameters, self.integers,
        )  # fmt: skip
        advance = make_matching_advance(self.real, self.options.math, method.region, self.plan.parts)
        advance(
            self._bands, Steps(steps, step, method.substeps, method.iterations), grid, self._states, self._current,
            self._scratch, self._band_size, self._place_after,
        )  # fmt: skip
        self._current = int(self._place_after[0])
