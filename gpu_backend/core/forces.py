"""Forces on single particles (model/core/own_forces.py) on CUDA, and their stages for all solvers of quads.

Accelerations are [m/s^2]; a force is divided by the sheet's mass, and multiplied by a particle's `weight`, that mass
over its own, if the scene has a `load`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import Kernel, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.device import DeviceArray
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.integers import knows_time
from softlab.gpu_backend.core.quads import AXES, SIZE, load_quad, store_quad
from softlab.gpu_backend.core.simulation import CudaSimulation
from softlab.model.base.types import Feature, Real
from softlab.model.base.variant import FEATURE, Open, features_of, filled, inlined_routine, inlined_throughout, routine
from softlab.model.core import own_forces
from softlab.model.core.own_forces import PARTICLE_FORCES, accelerated, particle_forces
from softlab.model.core.plan import StageRun
from softlab.model.tables.cloth import CONSTRAINT_KINDS

PARTICLE_FORCE_PARTS = frozenset(
    {"gravity", "load", *(force.part for force in PARTICLE_FORCES)}
)  # the parts that these functions depend on


add = inlined_throughout(own_forces.add)
particle_force = Open("particle_force(a, k, weight, parameters, integers, step): of `with_forces`")


@inlined_routine
def add_gravity(ax, ay, az, parameters):
    """Return an acceleration with gravity added, if there is any."""
    if FEATURE.gravity:
        ay = ay + parameters.gravity
    return ax, ay, az


@inlined_routine
def add_particle_force(ax, ay, az, k, weight, parameters, integers, step):
    """Return an acceleration with all forces on single particles added."""
    if FEATURE.axes == 2:
        ax, ay = particle_force((ax, ay), k, weight, parameters, integers, step)
        return ax, ay, az
    return particle_force((ax, ay, az), k, weight, parameters, integers, step)


@routine
def gravity(position, record, integers, step, a):
    k = np.int32(cuda.grid(1))
    if k < a.size // SIZE:
        b = load_quad(a, k)
        ax, ay, az = add_gravity(b[0], b[1], b[2], record[0])
        store_quad(a, k, ax, ay, az, 0.0)


@routine
def force(position, record, integers, step, a):
    k = np.int32(cuda.grid(1))
    if k < a.size // SIZE:
        b, p = load_quad(a, k), load_quad(position, k)
        ax, ay, az = particle_force((b[0], b[1], b[2]), k, p[3], record[0], integers, step)
        store_quad(a, k, ax, ay, az, 0.0)


def with_forces(kernel: Callable, parts: frozenset[str]) -> Callable:
    """Return a kernel whose `particle_force` is the sum of the forces on single particles in `parts`."""
    return filled(kernel, {"particle_force": inlined_throughout(accelerated(parts))})


def particle_features(parts: frozenset[str], axes: int = AXES) -> dict[str, Feature]:
    """Return the features of kernels that move particles: of their forces, their motion, colliders and the clock."""
    return {**features_of(parts), "axes": axes, "timed": knows_time(parts)}


@cache
def make_force_stages(real: Real, math: str, parts: frozenset[str]) -> dict[str, Kernel]:
    """Compile the stages of gravity and of own forces, by name: kernels (position, record, integers, step, a), which
    add to the accelerations `a` (quads); the weights are in `position`."""
    stages: dict[str, Callable] = {"gravity": gravity}
    for one in particle_forces(parts):
        stages[one.stage] = with_forces(force, frozenset({one.part}))
    variant = device_variant(real, math, particle_features(parts))
    label = variant_name(real, math, parts & PARTICLE_FORCE_PARTS)
    return {
        name: make_kernel(variant.copied(stage), f"forces_{label}", **kernel_options(math))
        for name, stage in stages.items()
    }


def bind_forces(
    sim: CudaSimulation, parts: frozenset[str], position: DeviceArray, a: DeviceArray
) -> dict[str, StageRun]:
    """Return the functions of those stages for `sim`, which read particles at `position` and add accelerations to
    `a`."""

    def bound(kernel: Kernel) -> StageRun:
        return lambda moment: kernel[sim._flat](position, sim.record, sim.integers, np.int64(moment.step), a)

    kernels = make_force_stages(sim.real, sim.options.math, parts)
    return {name: bound(kernel) for name, kernel in kernels.items()}


def forces_of(parts: frozenset[str]) -> frozenset[str]:
    """Return the parts that the kernels over masses depend on, without those of constraints."""
    return frozenset(part for part in parts if part.split("-")[0] not in CONSTRAINT_KINDS)
