"""Implicit Euler on the cloth: one launch does whole steps, and decides on the device how often each pass runs.

Blocks are launched together (cooperatively) and synchronise at a barrier after every pass over the sheet. A block
processes segments of rows in turn, one mass per thread. The next pass depends on sums over all masses: each block
computes them from the segments' sums, in the CPU's order (cpu_backend/mass_spring/cloth/sums.py), so that all blocks
make the same decision, and get the CPU's bits.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import Kernel, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.cooperative import Cooperative
from softlab.gpu_backend.core.device import Arguments, simulated
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.meeting import barrier
from softlab.gpu_backend.core.quad_simulation import QuadSimulation
from softlab.gpu_backend.core.wind import air_now
from softlab.gpu_backend.core.world import Cell, World
from softlab.gpu_backend.mass_spring.cloth.implicit_point import (
    Work,
    finish,
    implicit_sums,
    move,
    product,
    residual,
    start,
    update,
)
from softlab.gpu_backend.mass_spring.cloth.point import cloth_features, current_step, of_scene
from softlab.model.base.errors import SceneError
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, filled, inlined_routine, real, routine
from softlab.model.formulas import implicit
from softlab.model.formulas.implicit import (
    FINISH,
    HALVINGS,
    ITERATIONS,
    MATRICES,
    MOVE,
    PRODUCT,
    RESIDUAL,
    RETREAT,
    START,
    STEPS,
    UPDATE,
    Counts,
    Values,
    after_product,
    after_residual,
)
from softlab.model.mass_spring.implicit_parameters import (
    LANES,
    SEGMENT,
    SUMS,
    TREE,
    segments_of,
    system_record,
    without_dampers,
)
from softlab.model.scene.scene import Scene

THREADS = LANES if simulated() else SEGMENT  # per block; the simulator's are Python threads
TOGETHER = 2  # minimum number of blocks per multiprocessor, which bounds their registers
SHARED = SUMS * TREE  # numbers in shared memory
WARPS = not simulated()
lanes, segment, tree, half_tree = np.int32(LANES), np.int32(SEGMENT), np.int32(TREE), np.int32(TREE // 2)


@inlined_routine
def halved(products, sums, half, stride, last):
    """Add up the 2 `half` numbers of each sum in halves, until `last` are left."""
    t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
    while half >= last:
        for n in range(sums):
            for k in range(t, half, threads):
                place = n * stride + k
                products[place] = products[place] + products[place + half]
        cuda.syncthreads()
        half = np.int32(half // 2)


@inlined_routine
def lanes_halved(products, sums, stride):
    """Replace the first of each sum's LANES numbers by their sum, added up in halves, by shuffles of one warp.

    Every thread of the block must call it; it does not synchronise at its end.
    """
    if WARPS:
        t = np.int32(cuda.threadIdx.x)
        if t < lanes:
            for n in range(sums):
                value = products[n * stride + t]
                value = value + cuda.shfl_down_sync(0xFFFFFFFF, value, 16)
                value = value + cuda.shfl_down_sync(0xFFFFFFFF, value, 8)
                value = value + cuda.shfl_down_sync(0xFFFFFFFF, value, 4)
                value = value + cuda.shfl_down_sync(0xFFFFFFFF, value, 2)
                value = value + cuda.shfl_down_sync(0xFFFFFFFF, value, 1)
                if t == 0:
                    products[n * stride] = value
    else:
        halved(products, sums, np.int32(lanes // 2), stride, np.int32(1))


@inlined_routine
def add_segment(products, sums, g, width, count, parts):
    t = np.int32(cuda.threadIdx.x)
    cuda.syncthreads()
    if t < lanes:
        for n in range(sums):
            running = 0.0
            for k in range(t, width, lanes):
                running = running + products[n * segment + k]
            products[n * segment + t] = running
    if not WARPS:
        cuda.syncthreads()
    lanes_halved(products, sums, segment)
    if t == 0:
        for n in range(sums):
            parts[n * count + g] = products[n * segment]
    cuda.syncthreads()


@inlined_routine
def total(products, sums, count, parts):
    t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
    for n in range(sums):
        for slot in range(t, tree, threads):
            running = 0.0
            for k in range(slot, count, tree):
                running = running + parts[n * count + k]
            products[n * tree + slot] = running
    cuda.syncthreads()
    halved(products, sums, half_tree, tree, lanes)
    lanes_halved(products, sums, tree)
    cuda.syncthreads()


@routine
def implicit_steps(
    position, velocity, base, x, u, r, s, q, aq, ar, begin, sums, flags, done, record, matrix, bodies, integers, counter,
    steps, rows, columns,
):  # fmt: skip
    parameters, system = record[0], matrix[0]
    world, work = World(parameters, bodies, integers), Work(base, x, u, r, s, q, aq, ar, begin)
    products = cuda.shared.array(SHARED, real)
    rows, columns = np.int32(rows), np.int32(columns)
    t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
    across = np.int32((columns + segment - 1) // segment)
    count, wanted = np.int32(rows * across), np.int32(cuda.gridDim.x)
    first_thread = cuda.blockIdx.x == 0 and t == 0
    for number in range(steps):
        step = current_step(counter, np.int64(number))
        kind, counts = START, Counts(np.int64(0), np.int64(0), np.int64(0))
        values = Values(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        while True:
            air = (0.0, 0.0, 0.0)
            if FEATURE.wind:
                if kind == START:
                    air = air_now(parameters, integers, step, 0.0)
            first_iteration, alpha, beta = counts.iterations == 1, values.alpha, values.beta
            for g in range(np.int32(cuda.blockIdx.x), count, np.int32(cuda.gridDim.x)):
                i, first = np.int32(g // across), np.int32((g % across) * segment)
                width = np.int32(min(segment, np.int32(columns - first)))
                for c in range(t, width, threads):
                    j = np.int32(first + c)
                    k = np.int32(i * columns + j)
                    if kind == PRODUCT:
                        a, b = product(work, k, Cell(i, j, rows, columns), system)
                        products[c], products[segment + c] = a, b
                    elif kind == UPDATE:
                        update(work, k, first_iteration, alpha, beta)
                    elif kind == RESIDUAL:
                        a, b, d = residual(work, k, Cell(i, j, rows, columns), parameters, system)
                        products[c], products[segment + c], products[2 * segment + c] = a, b, d
                    elif kind == START:
                        start(position, velocity, work, k, Cell(i, j, rows, columns), world, step, air)
                    elif kind == FINISH:
                        finish(position, velocity, work, k, step, world)
                    else:
                        move(position, work, k, kind == RETREAT, step, world)
                if kind == PRODUCT:
                    add_segment(products, np.int32(2), g, width, count, sums)
                elif kind == RESIDUAL:
                    add_segment(products, np.int32(SUMS), g, width, count, sums)
            wanted = barrier(flags, wanted)
            if kind == FINISH:
                break
            if kind == PRODUCT:
                total(products, np.int32(2), count, sums)
                kind, counts, values = after_product(counts, values, products[0], products[TREE])
                if first_thread:
                    done[ITERATIONS if kind == UPDATE else MATRICES] += 1
            elif kind == RESIDUAL:
                total(products, np.int32(SUMS), count, sums)
                total_products = products[0], products[TREE], products[2 * TREE]
                kind, counts, values = after_residual(
                    counts, values, total_products, system.speed_squared, system.roundoff
                )
                if first_thread and kind == RETREAT:
                    done[HALVINGS] += 1
            elif kind == UPDATE:
                kind = PRODUCT
            elif kind == MOVE and FEATURE.linear:
                kind = FINISH
            else:
                kind = RESIDUAL
            cuda.syncthreads()
        if first_thread:
            done[STEPS] += 1


@cache
def make_cloth_implicit(real: Real, math: str, linear: bool, parts: frozenset[str]) -> Kernel:
    """Compile kernel(position, velocity, base, x, u, r, s, q, aq, ar, begin, sums, flags, done, record, matrix, bodies,
    integers, counter, steps, rows, columns): `steps` steps of the state in `position` and `velocity`.

    The nine arrays of quads that follow are working memory; `sums` (SUMS * segments,); `flags` (1,) int32, 0 before the
    launch; `done` (len(DONE),) int64 is incremented; the rest is as in mass_spring/cloth/kernels.py. With `linear` a
    step ends after its first matrix.
    """
    kernel = of_scene(filled(implicit_steps, implicit_sums(parts)), "implicit-euler", parts)
    features = {**cloth_features("implicit-euler", parts), "implicit": True, "linear": linear}
    kernel = device_variant(real, math, features).copied(kernel)
    label = variant_name(real, math, linear, parts)
    return make_kernel(kernel, label, launch_bounds=(SEGMENT, TOGETHER), **kernel_options(math))


def implicit_kernel(scene: Scene, real: Real, parts: frozenset[str], asked: str | None) -> str:
    """Return the only kernel. Raises SceneError if another one was requested."""
    if asked not in (None, "cooperative"):
        raise SceneError("--kernel", asked, f"must be cooperative for {scene.method.integrator} on the gpu")
    return "cooperative"


class ImplicitSteps:
    """The steps of one simulation, a gpu_backend.mass_spring.cloth.solver.ClothMassSpring, and their arrays besides its
    state."""

    def __init__(self, simulation: QuadSimulation):
        self.simulation = simulation
        sim, real, body = simulation, simulation.real, simulation.body
        count = segments_of(body.rows, body.columns)
        self._vectors = [sim.new_array() for _ in range(9)]
        self._sums = cuda.to_device(np.zeros(SUMS * count, real), stream=sim.stream)
        self._done = cuda.to_device(np.zeros(len(implicit.DONE), np.int64), stream=sim.stream)
        self._system = cuda.to_device(system_record(sim.scene, real), stream=sim.stream)
        linear = sim.scene.method.integrator == "implicit-euler-linear"
        kernel = make_cloth_implicit(real, sim.options.math, linear, without_dampers(sim.plan.parts))
        self._steps = Cooperative(sim, kernel, self._arguments, count, THREADS)
        self._steps.prepare()
        self.advance = self._steps.advance

    @property
    def done(self) -> np.ndarray:
        """Return (steps, matrices, iterations of conjugate gradients, halved Newton steps) so far."""
        host = self._done.copy_to_host(stream=self.simulation.stream)
        self.simulation.synchronize()
        return host

    def renew(self) -> None:
        """Update the system from the scene's current fields."""
        sim = self.simulation
        self._system.copy_to_device(system_record(sim.scene, sim.real), stream=sim.stream)
        sim.synchronize()

    def _arguments(self, steps: int) -> Arguments:
        sim = self.simulation
        return (
            sim.position[sim._current], sim.velocity[sim._current], *self._vectors, self._sums, self._steps.flags, self._done,
            sim.record, self._system, sim.bodies, sim.integers, sim._counter, np.int64(steps), *sim.shape,
        )  # fmt: skip
