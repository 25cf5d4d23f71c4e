"""Bodies of tetrahedra on CPU threads by implicit Euler: Newton's method, with preconditioned conjugate gradients.

The matrix is assembled, as 3 x 3 blocks in compressed rows: its product takes a quarter of the time of a product
tetrahedron by tetrahedron (25 600, float32, one thread), and each particle sums its own row. newton_steps.py has the
passes.
"""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.core.simulation import QuadsSimulation, chosen_kernel
from softlab.cpu_backend.position_based.mesh_kernels import ALWAYS
from softlab.cpu_backend.tetrahedra.newton_arrays import Coarse, Inputs, Solver, Vectors
from softlab.cpu_backend.tetrahedra.newton_steps import SUMS, control_type, make_newton_advance
from softlab.model.core.plan import Executor
from softlab.model.core.simulation import Options
from softlab.model.formulas.elastic import newton as passes
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.aggregates import MODES, aggregates
from softlab.model.tetrahedra.block_rows import BLOCKS, block_rows
from softlab.model.tetrahedra.material import material_of
from softlab.model.tetrahedra.newton import (
    SUMMED,
    element_values,
    holding,
    newton_plan,
    rounding_floor,
    stage_vectors,
    stages_of,
)
from softlab.model.tetrahedra.newton_arrays import Elements, Matrix
from softlab.model.tetrahedra.springs import rounding_of, springs
from softlab.model.tetrahedra.tables import surface_lists

VECTORS = 8  # of every scheme; one more for order 2, three with dampers


class TetrahedraNewton(QuadsSimulation):
    """Implicit tetrahedra; model/core/simulation.py defines the contract. `threads`: `1x`, `2x`, `4x` or a number.
    `done` (DONE,): counters."""

    def __init__(self, scene: Scene, options: Options, threads: str | int = "1x"):
        super().__init__(scene, options, threads)
        self.kernel = chosen_kernel(options.kernel, "implicit tetrahedral bodies", ("fused",))
        self.plan, self.integers = newton_plan(scene, options.live), self._seeds()
        real, tetrahedra_set = self.real, scene.tetrahedra_set
        self._set_driven()
        count, tetrahedra = tetrahedra_set.particle_count, len(tetrahedra_set.tetrahedra)
        spring_arrays = springs(tetrahedra_set, "newton")
        rows = block_rows(tetrahedra_set.tetrahedra, count, spring_arrays.pairs)
        matrix = (
            (tetrahedra * BLOCKS + len(spring_arrays.blocks), 9),
            (len(rows.columns), 9),
            (count, 6),
            (tetrahedra, 12),
        )
        rigid = aggregates(tetrahedra_set, rows, self.body.inverse_mass > 0)
        size = MODES * rigid.number
        coarse = ((rigid.number, 4), (size, rigid.width), (1, size), (1, size))
        hard = holding(tetrahedra_set).astype(real)[:, None]
        groups, vectors = -(-max(count, tetrahedra) // SUMMED), VECTORS + stage_vectors(self.plan.parts)
        corners, values = (
            np.ascontiguousarray(tetrahedra_set.tetrahedra, np.int32),
            element_values(tetrahedra_set).astype(real),
        )
        self._solver = Solver(
            Elements(corners, material_of(tetrahedra_set), values), rows, spring_arrays.arrays(real),
            Vectors(*(np.zeros((count, 3), real) for _ in range(vectors))),
            Matrix(*[*(np.zeros(shape, real) for shape in matrix), hard]), np.zeros((SUMS, groups), real),
            rigid, Coarse(*(np.zeros(shape, real) for shape in coarse)),
        )  # fmt: skip
        self._solver.matrix.element_blocks[tetrahedra * BLOCKS :] = spring_arrays.blocks
        self._floor = real(
            rounding_floor(tetrahedra_set, real) + rounding_of(spring_arrays, tetrahedra_set.extent, real)
        )
        self._control, self.done = np.zeros(1, control_type(real)), np.zeros(len(passes.DONE), np.int64)
        self._allocate(groups)
        self._velocity[:, 3] = tetrahedra_set.damping_rates
        self._lists = surface_lists(tetrahedra_set, False)
        self._executor = Executor(self.plan, {}, self._advance)
        self.reset()

    def _advance(self, step: int, steps: int) -> None:
        method = self.scene.method
        self._control[...] = 0
        make_newton_advance(self.real, self.options.math, self.plan.parts - ALWAYS)(
            self._bands, steps, step, method.substeps * stages_of(self.scene), method.iterations, self._floor,
            (self._position, self._velocity, self._before),
            Inputs(self.parameters, self.integers, self._lists, self.bodies, self.kinds, self.driven), self._solver,
            self._control, self.done,
        )  # fmt: skip
