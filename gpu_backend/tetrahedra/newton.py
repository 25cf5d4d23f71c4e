"""Bodies of tetrahedra on CUDA by implicit Euler: Newton's method, with preconditioned conjugate gradients.

One launch does whole steps, without the host (newton_kernel.py). In `exact` math the bits equal the CPU's.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from softlab.gpu_backend.core.cooperative import Cooperative
from softlab.gpu_backend.core.device import Arguments
from softlab.gpu_backend.core.driven import DrivenSimulation
from softlab.gpu_backend.core.quads import SIZE
from softlab.gpu_backend.core.sheet import make_cloth_tools, make_mesh_tools
from softlab.gpu_backend.tetrahedra.newton_arrays import Control, Limits, Solver, launch_sizes, mapped, solver_on_host
from softlab.gpu_backend.tetrahedra.newton_kernel import make_newton
from softlab.gpu_backend.tetrahedra.newton_sums import THREADS
from softlab.model.contact.cloth_parameters import PIN_FIELDS
from softlab.model.core.options import unknown_kernel
from softlab.model.core.plan import Executor
from softlab.model.core.simulation import Options
from softlab.model.formulas.elastic.newton import DONE
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.constraints import ITERATED
from softlab.model.tetrahedra.newton import newton_plan, rounding_floor, stages_of
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
        self._springs, free = springs(scene.tetrahedra_set, "newton"), self.body.inverse_mass > 0
        self._on_host = solver_on_host(
            scene.tetrahedra_set, self._springs, free, self.real, options.math, self.plan.parts
        )
        self._require_space()
        self._start()

    def _require_space(self) -> None:
        sizes: list[int] = []
        mapped(self._on_host, lambda array: sizes.append(array.nbytes))
        needed = sum(sizes) + 8 * SIZE * self.particle_count * np.dtype(self.real).itemsize
        tetrahedra = len(self.scene.tetrahedra_set.tetrahedra)
        self._require_memory(needed, "tetrahedral_body", f"{tetrahedra} tetrahedra")

    def _allocate(self) -> None:
        tetrahedra_set, real = self.scene.tetrahedra_set, self.real
        self._allocate_driven()
        self._weight = (self.body.inverse_mass * self.scene.grid.mass).astype(real)
        self._fourth = tetrahedra_set.damping_rates.astype(real)
        self._lists = [self.on_device(array) for array in surface_lists(tetrahedra_set, False)]
        pins = np.zeros(self.particle_count, np.int32)
        if self._first_pin:
            pins[self.body.pinned] = self._first_pin + PIN_FIELDS * np.arange(len(self.body.pinned))
        self._blocks, self._sums = launch_sizes(self._on_host)
        solver: Solver = mapped(self._on_host._replace(pins=pins), self.on_device)
        del self._on_host
        vectors = solver.vectors._replace(position=self.position[0], velocity=self.velocity[0])
        self._solver = solver._replace(vectors=vectors)
        self._done = self.on_device(np.zeros(len(DONE), np.int64))
        self._floor = real(
            rounding_floor(tetrahedra_set, real) + rounding_of(self._springs, tetrahedra_set.extent, real)
        )

    def _build(self) -> None:
        self._tools = SimpleNamespace(**vars(make_cloth_tools(self.real)) | vars(make_mesh_tools(self.real)))
        kernel = make_newton(self.real, self.options.math, self.plan.parts - CODELESS)
        self._steps = Cooperative(self, kernel, self._arguments, self._blocks, THREADS)
        self._control = Control(self.on_device(np.zeros(4 * self._sums, self.real)), self._steps.flags, self._done)
        self._executor = Executor(self.plan, {}, self._steps.advance)
        self._steps.prepare()

    def _arguments(self, steps: int) -> Arguments:
        method = self.scene.method
        solves = np.int64(method.substeps * stages_of(self.scene))
        limits = Limits(np.int64(steps), solves, np.int64(method.iterations), self._floor)
        return self._solver, self.record, self.bodies, self.integers, self._counter, self._control, limits

    @property
    def done(self) -> np.ndarray:
        """Return the counts so far (newton_kernel.py): solves, checks, matrices, products, steps."""
        host: np.ndarray = self._done.copy_to_host(stream=self.stream)
        self.synchronize()
        return host

    def _normal_arguments(self) -> Arguments:
        return tuple(self._lists)
