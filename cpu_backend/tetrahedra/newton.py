"""Bodies of tetrahedra on CPU threads by implicit Euler: Newton's method, each step by preconditioned conjugate gradients.

The matrix is assembled, as 3 x 3 blocks in compressed rows: its product takes a quarter of the time of one taken tetrahedron
by tetrahedron (25 600, float32, one thread), and each particle sums up its own row. Passes: newton_steps.py.
"""

from __future__ import annotations

import numpy as np

from cpu_backend.core.simulation import ParticlesSimulation, chosen_kernel
from cpu_backend.tetrahedra.newton_elements import SUMMED
from cpu_backend.tetrahedra.newton_steps import DONE, SUMS, make_newton_advance
from cpu_backend.xpbd.mesh import WIDTH
from cpu_backend.xpbd.mesh_kernels import ALWAYS
from model.core.plan import Executor
from model.core.simulation import Options
from model.formulas.elastic import newton as passes
from model.mass_spring.cloth_parameters import collider_numbers
from model.scene.scene import Scene
from model.tetrahedra.aggregates import MODES, aggregates
from model.tetrahedra.block_rows import BLOCKS, block_rows
from model.tetrahedra.newton import DAMPED, element_materials, element_values, holding, newton_plan, rounding_floor
from model.tetrahedra.tables import surface_lists

VECTORS = 8  # see newton_rows.py


class TetrahedraNewton(ParticlesSimulation):
    """See model/core/simulation.py for the contract. `threads`: `1x`, `2x`, `4x` or a number. `done` (DONE,): what has been
    done so far."""

    def __init__(self, scene: Scene, options: Options, threads: str | int = "1x"):
        super().__init__(scene, options, threads)
        self.kernel = chosen_kernel(options.kernel, "implicit tetrahedral bodies", ("fused",))
        self.plan, self.integers = newton_plan(scene, options.live), self._seeds()
        real, found = self.real, scene.tetrahedra_set
        self._set_colliders(collider_numbers(scene, real))
        count, tetrahedra = found.particle_count, len(found.tetrahedra)
        self._position, self._velocity, self._before = (np.zeros((count, WIDTH), real) for _ in range(3))
        self._position[:, 3] = self.body.inverse_mass * scene.grid.mass
        self._kept = np.zeros((2, count, WIDTH), real)
        rows = block_rows(found.tetrahedra, count)
        blocks, dampers = len(rows.columns), len(rows.columns) if DAMPED in self.plan.parts else 0
        matrix = ((tetrahedra * BLOCKS, 9), (blocks, 9), (dampers, 9), (count, 6), (tetrahedra, 12))
        rigid = aggregates(found, rows, self.body.inverse_mass > 0)
        size = MODES * rigid.count
        coarse = ((rigid.count, 4), (size, rigid.width), (1, size), (1, size))
        hard = holding(found).astype(real)[:, None]
        groups = -(-max(count, tetrahedra) // SUMMED)
        self._solver = (
            (np.ascontiguousarray(found.tetrahedra, np.int32), element_materials(found), element_values(found).astype(real)),
            rows.arrays, tuple(np.zeros((count, 3), real) for _ in range(VECTORS)),
            (*(np.zeros(shape, real) for shape in matrix), hard), np.zeros((SUMS, groups), real), rigid.arrays,
            tuple(np.zeros(shape, real) for shape in coarse),
        )  # fmt: skip
        self._floor = real(rounding_floor(found, real))
        self._control = np.zeros(2 + len(passes.COUNTS), np.int64)
        self._values, self.done = np.zeros(len(passes.VALUES), real), np.zeros(len(DONE), np.int64)
        self._bands = max(1, min(self.threads, groups))
        self._bad, self._slots = np.zeros(self._bands, np.int64), WIDTH * np.arange(count)
        self._lists = surface_lists(found, False)
        self._executor = Executor(self.plan, {}, self._advance)
        self.reset()

    def _advance(self, step: int, steps: int) -> None:
        method = self.scene.method
        self._control[:] = 0
        make_newton_advance(self.real, self.options.math, self.plan.parts - ALWAYS)(
            self._bands, steps, step, method.substeps, method.iterations, self._floor,
            (self._position, self._velocity, self._before),
            (self.parameters, self.integers, self._lists, self.bodies, self.kinds), self._solver, self._control,
            self._values, self.done,
        )  # fmt: skip

    # ------------------------------------------------------------------ the contract

    def _keep(self) -> None:
        self._kept[0], self._kept[1] = self._position, self._velocity

    def _restore(self) -> None:
        self._position[...], self._velocity[...] = self._kept

    def _places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        return self._position.reshape(-1), self._velocity.reshape(-1), self._slots, 1

    def _download(self) -> tuple[np.ndarray, np.ndarray]:
        return np.ascontiguousarray(self._position[:, :3]), np.ascontiguousarray(self._velocity[:, :3])

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self._position[:, :3], self._velocity[:, :3] = position, velocity
