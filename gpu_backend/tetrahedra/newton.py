"""Bodies of tetrahedra on CUDA by implicit Euler: Newton's method, with preconditioned conjugate gradients.

One launch does whole steps, without the host (newton_kernel.py). In `exact` math the bits equal the CPU's.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from softlab.gpu_backend.core.cooperative import Cooperative
from softlab.gpu_backend.core.device import Arguments, DeviceArray
from softlab.gpu_backend.core.driven import DrivenSimulation
from softlab.gpu_backend.core.quads import SIZE
from softlab.gpu_backend.core.sheet import make_cloth_tools, make_mesh_tools
from softlab.gpu_backend.tetrahedra.newton_kernel import WORKING, make_newton, packed
from softlab.gpu_backend.tetrahedra.newton_sums import THREADS, UNIT
from softlab.model.contact.cloth_parameters import PIN_FIELDS
from softlab.model.core.options import unknown_kernel
from softlab.model.core.plan import Executor
from softlab.model.core.simulation import Options
from softlab.model.formulas.elastic.newton import DONE
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.aggregates import aggregates, couplings
from softlab.model.tetrahedra.block_rows import BLOCKS, block_rows
from softlab.model.tetrahedra.constraints import ITERATED
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
from softlab.model.tetrahedra.springs import rounding_of, springs
from softlab.model.tetrahedra.tables import surface_lists

CODELESS = {"gauss-seidel", ITERATED}  # parts that change no kernel


class TetrahedraNewton(DrivenSimulation):
    """Implicit tetrahedra on CUDA; model/core/simulation.py defines the contract. `threads`: threads per block."""

    def __init__(self, scene: Scene, options: Options):
        super().__init__(scene, options)
        if options.kernel not in (None, "cooperative"):
            raise unknown_kernel(options.kernel, ("cooperative",), "for implicit tetrahedral bodies on the gpu")
        self.plan, self.kernel, self.threads = newton_plan(scene, options.live), "cooperative", THREADS
        self._working = WORKING + stage_vectors(self.plan.parts)
        self._make_tables()
        self._require_space()
        self._start()

    def _make_tables(self) -> None:
        tetrahedra_set, count = self.scene.tetrahedra_set, self.particle_count
        self._springs = springs(tetrahedra_set, "newton")
        rows = block_rows(tetrahedra_set.tetrahedra, count, self._springs.pairs)
        groups = aggregates(tetrahedra_set, rows, self.body.inverse_mass > 0)
        pairs = couplings(groups, rows)
        self._pins, spring_arrays = np.zeros(count if "motion" in self.plan.parts else 0, np.int32), self._springs
        self._tables = (
            tetrahedra_set.tetrahedra, material_of(tetrahedra_set), *rows, *groups, *pairs, self._pins,
            spring_arrays.meets, spring_arrays.entries, spring_arrays.corners,
        )  # fmt: skip
        tetrahedra, blocks, size = len(tetrahedra_set.tetrahedra), len(rows.columns), len(groups.reach)
        parts = max(-(-max(count, tetrahedra) // SUMMED), groups.number)
        self._sizes = (  # of the work arrays, in the kernel's order
            9 * (BLOCKS * tetrahedra + len(self._springs.blocks)), 9 * blocks, 6 * count, 4 * SIZE * tetrahedra,
        )  # fmt: skip
        inverse = int(pairs.places[-1]) if self.options.math != "exact" else 0
        self._coarse_sizes = SIZE * groups.number, size * groups.width, 3 * size, inverse
        self._sum_size, self._most_blocks = 4 * parts, max(-(-tetrahedra // UNIT), -(-count // SUMMED), groups.number)

    def _require_space(self) -> None:
        item, tetrahedra_set = np.dtype(self.real).itemsize, self.scene.tetrahedra_set
        needed = (8 + self._working) * SIZE * self.particle_count * item + sum(one.nbytes for one in self._tables)
        needed += (sum(self._sizes) + sum(self._coarse_sizes) + 14 * len(tetrahedra_set.tetrahedra)) * item
        self._require_memory(needed, "tetrahedral_body", f"{len(tetrahedra_set.tetrahedra)} tetrahedra")

    def _allocate(self) -> None:
        scene, real, tetrahedra_set = self.scene, self.real, self.scene.tetrahedra_set
        self._allocate_driven()
        self._weight = (self.body.inverse_mass * scene.grid.mass).astype(real)
        self._fourth = tetrahedra_set.damping_rates.astype(real)
        if self._first_pin:
            self._pins[self.body.pinned] = self._first_pin + PIN_FIELDS * np.arange(len(self.body.pinned))
        self._lists = [self.on_device(array) for array in surface_lists(tetrahedra_set, False)]

        def zeros(size: int) -> DeviceArray:
            return self.on_device(np.zeros(size, real))

        self._done = self.on_device(np.zeros(len(DONE), np.int64))
        self._arrays = (
            zeros(self._working * SIZE * self.particle_count), self.on_device(element_values(tetrahedra_set).T.astype(real)),
            *(zeros(size) for size in self._sizes), self.on_device(holding(tetrahedra_set).astype(real)),
            self.on_device(np.append(self._springs.values.ravel(), 0).astype(real)),
            *(zeros(size) for size in self._coarse_sizes), self.on_device(packed(self._tables)), zeros(self._sum_size),
        )  # fmt: skip
        spring_arrays = np.zeros(self._sizes[0], real)
        spring_arrays[9 * BLOCKS * len(tetrahedra_set.tetrahedra) :] = self._springs.blocks.ravel()
        self._arrays[2].copy_to_device(spring_arrays)
        self._floor = real(
            rounding_floor(tetrahedra_set, real) + rounding_of(self._springs, tetrahedra_set.extent, real)
        )

    def _build(self) -> None:
        self._tools = SimpleNamespace(**vars(make_cloth_tools(self.real)) | vars(make_mesh_tools(self.real)))
        kernel = make_newton(self.real, self.options.math, self.plan.parts - CODELESS)
        self._steps = Cooperative(self, kernel, self._arguments, self._most_blocks, THREADS)
        self._executor = Executor(self.plan, {}, self._steps.advance)
        self._steps.prepare()

    def _arguments(self, steps: int) -> Arguments:
        method = self.scene.method
        return (
            self.position[0], self.velocity[0], *self._arrays, self._steps.flags, self._done, self.record, self.bodies,
            self.integers, self._counter, np.int64(steps), np.int64(method.substeps * stages_of(self.scene)),
            np.int64(method.iterations), self._floor,
        )  # fmt: skip

    @property
    def done(self) -> np.ndarray:
        """Return the counts so far (newton_kernel.py): solves, checks, matrices, products, steps."""
        host: np.ndarray = self._done.copy_to_host(stream=self.stream)
        self.synchronize()
        return host

    def _normal_arguments(self) -> Arguments:
        return tuple(self._lists)
